"""The findings of the ledger that a run shows, and its result: headline, exit code, accepted or not.

Also the particle model in one table: each field at each step, over all cases of a run.
"""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from lammps_cases.findings import KNOWN, LEDGER, Finding, accepted_cases, severities
from lammps_cases.findings.engines import nearest
from lammps_cases.records import deck_wording, wording
from lammps_cases.records.case_parts import StepRecord, Verdict
from lammps_cases.records.headline import Headline, headline, how_severe, of_decks
from lammps_cases.records.levels import SEVERITIES, Severity, fails
from lammps_cases.records.run_record import CarriedOver, CaseRecord, RunRecord
from lammps_cases.records.wording import counted
from lammps_cases.scene.fields import FIELDS, in_step_order

Status = Literal["seen", "unseen", "absent"]
STATUSES: tuple[Status, ...] = ("seen", "unseen", "absent")
NAMED = 3  # findings in the closing lines of a run without a severe one


@dataclass(frozen=True)
class RunFinding:
    """A finding with the cases of a run that show it, and those that would if it were still present."""

    entry: Finding
    cases: list[str]
    unseen: list[str]
    listed: bool
    new: bool = False  # shown, though neither this version nor the nearest known one had it

    @property
    def status(self) -> Status:
        """Return whether the run shows it, could have shown it, or neither."""
        return "seen" if self.cases else "unseen" if self.unseen else "absent"

    @property
    def words(self) -> str:
        """Return the status in words."""
        if self.cases:
            return f"seen in {counted(len(self.cases), 'case')} of this run"
        if self.unseen:
            return f"applies to {counted(len(self.unseen), 'case')}, not seen"
        return "not applicable in this run: " + (
            "no case of it" if self.listed else "not known of this version of LAMMPS"
        )


@dataclass(frozen=True)
class Outcome:
    """A run and all findings of a ledger, and the results of both."""

    run: RunRecord
    findings: list[RunFinding]

    @cached_property
    def of_decks(self) -> bool:
        """Return whether the run is the audit of one or more decks."""
        return bool(self.run.cases) and all("audit" in case.tags for case in self.run.cases)

    def change(self, finding: str) -> float:
        """Return the largest effect of a finding on a deck, relative to the largest correct value of a field."""
        changes = (deck_wording.change(case, finding) for case in self.run.cases if finding in case.findings)
        return max(changes, default=math.inf)

    def _severity(self, finding: str) -> Severity:
        """Return the severity of a finding on the deck on which it is most severe."""
        each = [deck_wording.severity(case, finding) for case in self.run.cases if finding in case.findings]
        return min(each, key=SEVERITIES.index, default="high")

    @cached_property
    def shown(self) -> list[RunFinding]:
        """Return the findings that the run shows: new ones, then the most severe, then those of most cases."""
        shown = [finding for finding in self.findings if finding.status == "seen"]
        severity = {name: SEVERITIES.index(level) for name, level in self.known.items()}
        return sorted(shown, key=lambda f: (not f.new, severity[f.entry.id], -len(f.cases), f.entry.number))

    @cached_property
    def regressions(self) -> list[str]:
        """Return the findings that are new on this version of LAMMPS and not allowed."""
        return [one.entry.id for one in self.shown if one.new and one.entry.id not in self.run.allowed]

    @property
    def milder(self) -> list[RunFinding]:
        """Return the shown findings that are not severe."""
        return [finding for finding in self.shown if self.known[finding.entry.id] != "high"]

    def effect(self, finding: RunFinding) -> str:
        """Return the effect of a finding: on the deck that it affects most, or in general."""
        name, general = finding.entry.id, finding.entry.effect
        decks = [case for case in self.run.cases if self.of_decks and name in case.findings]
        most = max(decks, key=lambda case: deck_wording.change(case, name), default=None)
        return general if most is None else deck_wording.effects(most).get(name, general)

    @cached_property
    def known(self) -> dict[str, Severity]:
        """Return the findings that the run shows with their severities; for decks by their changes there."""
        named = [finding.entry.id for finding in self.findings if finding.status == "seen"]
        named += [finding for case in self.run.cases for finding in case.findings]
        if self.of_decks:
            levels = {name: self._severity(name) for name in named}
            order = sorted(levels, key=lambda name: (SEVERITIES.index(levels[name]), -self.change(name)))
            return {name: levels[name] for name in order}
        return severities(named, [f.entry for f in self.findings])

    @cached_property
    def rejected(self) -> frozenset[str]:
        """Return the findings that fail the run, by its options."""
        if self.of_decks:
            return frozenset(name for case in self.run.cases for name in self._rejected_of(case))
        failing = (name for name, severity in self.known.items() if fails(severity, self.run.fail_on))
        return frozenset(failing) - self.run.allowed.keys() | set(self.regressions)

    @property
    def exit_code(self) -> int:
        """Return the exit code of the run."""
        return self.run.exit_code(self.rejected)

    @cached_property
    def headline(self) -> Headline:
        """Return the headline of the run."""
        new = [f"{counted(self.run.changed, 'change')} against the baseline"] if self.run.changed else []
        if self.run.faults:
            new.append(f"the report lacks {', '.join(fault.part for fault in self.run.faults)}")
        if self.run.missing:
            total = self.run.missing + len(self.run.cases)
            new.insert(0, f"interrupted: {self.run.missing} of {counted(total, 'case')} not judged")
        before = nearest(self.run.engine.distribution)
        first = [f"regression: {wording.some(self.regressions)}, not in {before}"] if self.regressions else []
        if self.of_decks:
            return of_decks(self.run.cases, [*first, *new], fail_on=self.run.fail_on, exempt=self.run.allowed)
        lacking = Counter(case.lacks for case in self.run.cases if case.lacks)
        new += [f"no {name!r} in this LAMMPS: {counted(count, 'case')} skipped" for name, count in lacking.items()]
        wrong = Counter(wording.kind(case) for case in self.run.cases if not case.as_expected)
        each = ", ".join(f"{count} {name}" for name, count in wording.by_severity(wrong).items())
        ended = [f"{counted(wrong.total(), 'case')} not as expected: {each}"] if wrong else []
        early = sum(case.as_expected and case.outlook is not None for case in self.run.cases)
        compared = any(case.verdict != "skipped" for case in self.run.cases)
        known = {name: severity for name, severity in self.known.items() if name not in self.regressions}
        return headline(
            known,
            [*first, *ended, *new],
            differences=f"LAMMPS ends {counted(early, 'case')} early" if early else "",
            fail_on=self.run.fail_on,
            compared=compared,
            allowed=self.run.allowed,
        )

    def accepted(self, case: CaseRecord) -> bool:
        """Return whether a case leaves the run green."""
        return case.accepted(self._rejected_of(case))

    def _rejected_of(self, case: CaseRecord) -> Collection[str]:
        if not self.of_decks:
            return self.rejected
        return set(deck_wording.rejected(case, self.run.fail_on)) - self.run.allowed.keys()

    def rank(self, case: CaseRecord) -> int:
        """Return the place of a case in a list by severity; all rejected cases come after all accepted ones."""
        return wording.rank(case, self.accepted(case))

    def sentence(self, case: CaseRecord) -> str:
        """Say in one sentence why a case is not accepted, or what it is; for a deck as its headline does."""
        if "audit" in case.tags:
            return of_decks([case], fail_on=self.run.fail_on, exempt=self.run.allowed).sentence
        return case.message or wording.kind(case)

    @property
    def unaccepted(self) -> list[CaseRecord]:
        """Return the cases that turn the run red, worst first."""
        return sorted((case for case in self.run.cases if not self.accepted(case)), key=lambda case: -self.rank(case))

    def closing(self) -> list[str]:
        """Return the lines after the headline on a terminal: new or severe findings, the others counted, the next step.

        Without severe ones the first few are named. For decks, the headline or the statements name them.
        """
        command = self.next_command
        then = [f"next: {command}"] if command else []
        if self.of_decks:
            return then
        named = [finding for finding in self.shown if finding.new or finding.entry.severity == "high"]
        named = named or self.shown[:NAMED]
        lines = [
            f"  {finding.entry.severity:4s}  {finding.entry.title} ({finding.entry.id}): "
            f"{counted(len(finding.cases), 'case')}"
            for finding in named
        ]
        ids = {finding.entry.id for finding in named}
        others = how_severe({name: severity for name, severity in self.known.items() if name not in ids})
        return [*lines, *([f"  and {others}"] if others else []), *then]

    @property
    def next_command(self) -> str:
        """Return the next command: the worst case alone, a bug report of the worst finding, or the manual's claims.

        After the audit of a deck: the finding that ends it early, a bug report of the worst finding, or nothing.
        """
        wrong = [case for case in self.unaccepted if not case.as_expected and case.reproduce]
        if wrong:
            outlook = wrong[0].outlook
            broken = outlook.findings if outlook is not None else []
            if broken:
                return shlex.join(["eos-ref", "findings", broken[0]])
            return "" if "audit" in wrong[0].tags else wrong[0].reproduce
        if self.shown:
            return self.report_bug(self.shown[0].entry)
        return "" if self.of_decks else self._command("claims")

    def report_bug(self, finding: Finding) -> str:
        """Return the command that writes a deck and an issue for a finding on the LAMMPS of this run."""
        return self._command("report-bug", finding.id)

    def _command(self, *words: str) -> str:
        engine = self.run.engine.name
        return shlex.join(["eos-ref", *words, *([] if engine == "env" else ["--engine", engine])])


def outcome(run: RunRecord, ledger: Sequence[Finding] = LEDGER) -> Outcome:
    """Return the result of a run by a ledger."""
    return Outcome(run, of_run(run, ledger))


def of_run(run: RunRecord, ledger: Sequence[Finding]) -> list[RunFinding]:
    """Return every finding, the most severe first; of equal severity those that the run shows first."""
    explained = [(case, set(case.findings)) for case in run.cases]
    accepted = accepted_cases(nearest(run.engine.distribution))
    shown = [_finding(entry, explained, run.engine.distribution, accepted.get(entry.id, ())) for entry in ledger]
    return sorted(shown, key=lambda f: (SEVERITIES.index(f.entry.severity), STATUSES.index(f.status)))


def compare_with_ledger(run: RunRecord, ledger: Sequence[Finding] = LEDGER) -> CarriedOver | None:
    """Compare a run with the ledger; None on a known engine that shows the same findings as when it was adopted."""
    engine = run.engine.distribution
    if not engine:
        return None  # crashed before reporting its version
    every = of_run(run, ledger)
    first = {one.entry.id: len(one.cases) for one in every if one.new}
    expected = [one for one in every if one.listed and one.unseen]
    carried = CarriedOver(
        version=engine,
        nearest=nearest(engine),
        first_seen=first,
        partly={one.entry.id: len(one.unseen) for one in expected if one.cases},
        gone={one.entry.id: len(one.unseen) for one in expected if not one.cases},
        unexplained=sum(not case.as_expected for case in run.cases),
    )
    return carried if carried.first_seen or expected or engine not in KNOWN else None


def _finding(
    entry: Finding, explained: Sequence[tuple[CaseRecord, set[str]]], engine: str, accepted: Collection[str]
) -> RunFinding:
    showing, unseen, listed = [], [], entry.listed(engine)
    # Without LAMMPS' lists it is unknown whether a case would show what follows them: it did once.
    by_name = accepted if entry.model_variant is not None and entry.model_variant.lists else ()
    for case, entries in explained:
        shown = entry.id in entries
        would = entry.id in case.unseen
        # A finding of the particle model names the cases that would show it; the others cover cases by name.
        if not shown and listed and entry.model_variant is None and entry.covers(case.case):
            # For findings not reproduced yet, only the list says whether this engine has them.
            shown = case.verdict == "differs" and not entry.named_variant
            would = not shown and (case.verdict == "differs" or _tells(case))
        would |= listed and case.case in by_name and bool(case.fields) and _tells(case)  # not where LAMMPS refuses
        if shown:
            showing.append(case.case)
        elif would:
            unseen.append(case.case)
    return RunFinding(entry, showing, unseen, listed, bool(showing) and entry.new_on(engine))


def _tells(case: CaseRecord) -> bool:
    """Return whether a case without a finding proves that LAMMPS lacks it: not if it was not judged, or is red."""
    return case.as_expected and case.verdict != "skipped"


@dataclass
class WorstCase:
    """Number of cases with some verdict, the largest difference/bound among them and its case."""

    cases: int = 0
    ratio: float | None = None
    case: str = ""

    def add(self, case: str, ratio: float) -> None:
        """Count one case."""
        self.cases += 1
        if wording.size(ratio) > wording.size(self.ratio):
            self.ratio, self.case = ratio, case


@dataclass
class AgreementCell:
    """A field at a step: cases with the same bits, inside the bound, explained, and outside it."""

    exact: WorstCase = field(default_factory=WorstCase)
    inside: WorstCase = field(default_factory=WorstCase)
    explained: WorstCase = field(default_factory=WorstCase)
    outside: WorstCase = field(default_factory=WorstCase)

    def add(self, case: str, at: StepRecord) -> None:
        """Count a case by its verdict."""
        kinds = {"exact": self.exact, "pass": self.inside, "explained": self.explained}
        kinds.get(at.verdict, self.outside).add(case, at.max_over_bound)

    @property
    def cases(self) -> int:
        """Return the number of cases that compare the field at the step."""
        return self.agree + self.explained.cases + self.outside.cases

    @property
    def agree(self) -> int:
        """Number of cases inside the bound, the same bits included."""
        return self.exact.cases + self.inside.cases

    @property
    def verdict(self) -> Verdict:
        """Return the worst verdict of the cases."""
        if self.outside.cases:
            return "differs"
        return "explained" if self.explained.cases else "pass" if self.inside.cases else "exact"


@dataclass(frozen=True)
class AgreementRow:
    """A field with the stage of a step that it comes from."""

    field: str
    stage: str
    cells: list[AgreementCell | None]

    @property
    def exact(self) -> bool:
        """Return whether all cases have the same bits at all steps."""
        return all(cell is None or cell.verdict == "exact" for cell in self.cells)


@dataclass(frozen=True)
class Matrix:
    """Fields against steps."""

    title: str
    twins: bool
    cases: int
    steps: list[int]
    rows: list[AgreementRow]
    explained: list[str]


def matrices(run: RunRecord) -> list[Matrix]:
    """Return LAMMPS against the reference and, if a run has such cases, against itself; empty without the model."""
    stepped = [case for case in run.cases if any(record.steps for record in case.fields)]
    kinds = {
        "LAMMPS against the reference": [case for case in stepped if not case.twin],
        "LAMMPS against itself": [case for case in stepped if case.twin],
    }
    return [matrix(title, cases) for title, cases in kinds.items() if cases]


def matrix(title: str, cases: Sequence[CaseRecord]) -> Matrix:
    """Collect all fields that are compared at steps, in the order of a step."""
    cells: dict[str, dict[int, AgreementCell]] = {}
    for case in cases:
        for record in case.fields:
            for at in record.steps:
                cells.setdefault(record.field, {}).setdefault(at.step, AgreementCell()).add(case.case, at)
    steps = sorted({step for of_field in cells.values() for step in of_field})
    rows = [
        AgreementRow(name, FIELDS[name].stage if name in FIELDS else "", [cells[name].get(step) for step in steps])
        for name in in_step_order(cells)
    ]
    explained = dict.fromkeys(entry for case in cases for entry in case.findings)
    return Matrix(title, bool(cases[0].twin), len(cases), steps, rows, sorted(explained))
