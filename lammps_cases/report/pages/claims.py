"""``claims.html`` and ``claims.json``: every claim by page and section, with its verdict on every engine."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lammps_cases.claims.model import KINDS, Claim, without_claim
from lammps_cases.claims.probes import PREFIX
from lammps_cases.claims.verdicts import (
    BROKEN,
    VERDICTS,
    ClaimVerdict,
    Evidence,
    Judged,
    Trace,
    counts,
    in_words,
    of_all,
    of_run,
    refuted_by,
    worst,
)
from lammps_cases.findings import LEDGER
from lammps_cases.records import wording
from lammps_cases.records.headline import Headline
from lammps_cases.records.levels import FailOn
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report.pages import frame

SHOWN = 4  # pieces of evidence per claim and engine; the rest is counted


@dataclass(frozen=True)
class Column:
    """An engine: its name, its description, the folder of its report, and its verdicts, one per claim."""

    engine: str
    who: EngineRecord
    report: Path | None
    judged: Sequence[Judged]


@dataclass(frozen=True)
class Proof:
    """A piece of evidence with the engines that gave it."""

    engines: tuple[str, ...]
    evidence: Evidence
    link: str


@dataclass(frozen=True)
class ClaimView:
    """A claim as shown on the page."""

    claim: Claim
    verdict: ClaimVerdict
    verdicts: tuple[ClaimVerdict, ...]
    proofs: tuple[Proof, ...]
    more: int
    cases: tuple[tuple[str, str], ...]
    remarks: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class JudgedRuns:
    """Claims judged by runs: a column each, unexpected cases without a claim, interrupted runs."""

    columns: Sequence[Column]
    unforeseen: Sequence[tuple[str, CaseRecord]]  # with the label of the run
    broken: Sequence[str]
    headline: Headline

    @property
    def exit_code(self) -> int:
        """Return 3 if cases broke off, 1 if a claim fails without a finding, else 0."""
        return 3 if self.broken else int(self.headline.state == "FAIL")


def judge_runs(
    chosen: Sequence[Claim], answers: Sequence[tuple[RunRecord, Path]], case_names: Sequence[str], fail_on: FailOn
) -> JudgedRuns:
    """Judge claims by runs, each with the folder of its report; none holds without all of its own of ``case_names``."""
    versions = [run.engine.label for run, _ in answers]
    chosen = [claim for claim in chosen if any(claim.made_in(run.engine.manual) for run, _ in answers)]
    columns, unforeseen, unclaimed = list[Column](), list[tuple[str, CaseRecord]](), without_claim()
    for version, (run, folder) in zip(versions, answers, strict=True):
        label = f"{version} ({folder})" if versions.count(version) > 1 else version
        columns.append(Column(label, run.engine, folder / "report.html", of_run(chosen, run, case_names)))
        unforeseen += [(label, case) for case in run.cases if case.case in unclaimed and not case.as_expected]
    broken = [case.case for run, _ in answers for case in run.cases if case.verdict in BROKEN]
    unexpected = dict.fromkeys([*broken, *(case.case for _, case in unforeseen)])
    headline = of_all([column.judged for column in columns], list(unexpected), fail_on)
    return JudgedRuns(columns, unforeseen, broken, headline)


def document(columns: Sequence[Column]) -> str:
    """Return ``claims.json``: every claim with its verdict over all engines, and the evidence of each."""
    rows = []
    for at, first in enumerate(columns[0].judged):
        of = {column.engine: column.judged[at] for column in columns}
        row = first.claim.model_dump(include={"id", "page", "section", "kind", "text", "consequence"}) | {
            "cases": list(first.cases),
            "verdict": worst(judged.verdict for judged in of.values()),
            "evidence": [
                {
                    "engine": engine,
                    "case": evidence.case,
                    "field": evidence.field,
                    "text": evidence.text,
                    "finding": wording.listed(evidence.findings),
                }
                for engine, judged in of.items()
                for evidence in judged.evidence
            ],
            "remarks": list(dict.fromkeys(remark for judged in of.values() for remark in judged.remarks)),
        }
        rows.append(
            row | ({"verdicts": {engine: one.verdict for engine, one in of.items()}} if len(columns) > 1 else {})
        )
    return json.dumps({"claims": rows}, indent=1) + "\n"


def write(columns: Sequence[Column], trace: Trace, path: Path, headline: Headline) -> str:
    """Return the page; links are relative to the folder of ``path``, where it will lie."""
    claims = [judged.claim for judged in columns[0].judged]
    rows = [_row(i, columns, path.parent) for i in range(len(claims))]
    grouped = itertools.groupby(rows, key=lambda row: (row.claim.page, row.claim.section))
    verdicts = {v: sum(row.verdict == v for row in rows) for v in VERDICTS}
    fallen = [judged for column in columns for judged in column.judged if judged.verdict == "does not hold"]
    refuting = {entry for judged in fallen for evidence in judged.evidence for entry in evidence.findings}
    return frame.page(
        frame.SHARED,
        "claims",
        headline.look.css,
        engine=", ".join(column.engine for column in columns),
        scripts=[frame.FILTER],
        headline=headline,
        described=[wording.engine(column.who) for column in columns],
        in_words=in_words,
        engines=[column.engine for column in columns],
        totals=[counts(column.judged) for column in columns],
        verdicts=verdicts,
        present={verdict: count for verdict, count in verdicts.items() if count},
        kinds=[kind for kind in KINDS if any(claim.kind == kind for claim in claims)],
        sections=[(page, title, list(group)) for (page, title), group in grouped],
        findings=[
            (entry, [r for r in rows if any(entry.id in p.evidence.findings for p in r.proofs)])
            for entry in LEDGER
            if entry.id in refuting
        ],
        number=len(rows),
        grounds=refuted_by([column.judged for column in columns]),
        trace=trace,
    )


def _row(at: int, columns: Sequence[Column], folder: Path) -> ClaimView:
    of = [column.judged[at] for column in columns]
    claim = of[0].claim
    proofs: dict[Evidence, list[str]] = {}
    for column, judged in zip(columns, of, strict=True):
        for evidence in judged.evidence[:SHOWN]:
            proofs.setdefault(evidence, []).append(column.engine)
    made = [
        Proof(tuple(engines), evidence, _link(evidence.case, columns, folder, engines[0]))
        for evidence, engines in proofs.items()
    ]
    cases = tuple((name, _link(name, columns, folder)) for name in of[0].cases)
    remarks = tuple(dict.fromkeys(remark for judged in of for remark in judged.remarks))
    words = (
        claim.id,
        claim.page,
        claim.section,
        claim.kind,
        claim.text,
        claim.consequence,
        *claim.refuted_by,
        *of[0].cases,
    )
    verdicts = tuple(judged.verdict for judged in of)
    more = max(len(judged.evidence) - SHOWN for judged in of)
    return ClaimView(
        claim, worst(verdicts), verdicts, tuple(made), max(0, more), cases, remarks, " ".join(words).lower()
    )


def _link(case: str, columns: Sequence[Column], folder: Path, engine: str = "") -> str:
    """Return the address of a case in the report of a run; empty for a probe."""
    if not case or case.startswith(PREFIX):
        return ""
    for column in columns:
        if column.report is not None and engine in ("", column.engine):
            return f"{Path(os.path.relpath(column.report, folder)).as_posix()}#case={case}"
    return ""
