"""``claims.html``: every claim by page and section, with its verdict on every engine."""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lammps_cases.claims.model import KINDS, Claim
from lammps_cases.claims.probes import PREFIX
from lammps_cases.claims.verdicts import (
    VERDICTS,
    ClaimVerdict,
    Evidence,
    Judged,
    Trace,
    counts,
    in_words,
    refuted_by,
    worst,
)
from lammps_cases.findings import LEDGER
from lammps_cases.records import wording
from lammps_cases.records.headline import Headline
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.report.pages import frame

SHOWN = 4  # pieces of evidence per claim and engine; the rest is counted


@dataclass(frozen=True)
class Column:
    """An engine: its name, what it is, the folder of its report, and its verdicts, one per claim."""

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
    """A claim as the page shows it."""

    claim: Claim
    verdict: ClaimVerdict
    verdicts: tuple[ClaimVerdict, ...]
    proofs: tuple[Proof, ...]
    more: int
    cases: tuple[tuple[str, str], ...]
    remarks: tuple[str, ...]
    text: str


def write(columns: Sequence[Column], trace: Trace, path: Path, headline: Headline) -> str:
    """Return the page; links are relative to the folder of ``path``, where it will lie."""
    claims = [judged.claim for judged in columns[0].judged]
    rows = [_row(i, columns, path.parent) for i in range(len(claims))]
    grouped = itertools.groupby(rows, key=lambda row: (row.claim.page, row.claim.section))
    verdicts = {v: sum(row.verdict == v for row in rows) for v in VERDICTS}
    refuting = {e for c in columns for j in c.judged if j.verdict == "does not hold" for e in _findings(j)}
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


def _findings(judged: Judged) -> set[str]:
    return {entry for evidence in judged.evidence for entry in evidence.findings}


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
    """Return the place where the report of a run shows a case; nothing for a probe."""
    if not case or case.startswith(PREFIX):
        return ""
    for column in columns:
        if column.report is not None and engine in ("", column.engine):
            return f"{Path(os.path.relpath(column.report, folder)).as_posix()}#case={case}"
    return ""
