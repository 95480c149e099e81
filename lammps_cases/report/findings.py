"""Which findings of the ledger a run shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from lammps_cases.findings import KNOWN, LEDGER, Finding
from lammps_cases.findings.engines import nearest
from lammps_cases.records import wording
from lammps_cases.records.run_record import CarriedOver, CaseRecord, RunRecord
from lammps_cases.records.wording import counted

Status = Literal["seen", "unseen", "absent"]
STATUSES: tuple[Status, ...] = ("seen", "unseen", "absent")
SEVERITIES = ("high", "medium", "low")


@dataclass(frozen=True)
class RunFinding:
    """A ledger entry with the cases of a run that show it, and those that would if it were still there."""

    entry: Finding
    cases: list[str]
    unseen: list[str]
    listed: bool

    @property
    def status(self) -> Status:
        """Return whether the run shows it, could have shown it, or neither."""
        return "seen" if self.cases else "unseen" if self.unseen else "absent"

    @property
    def words(self) -> str:
        """The status in words."""
        if self.cases:
            return f"seen in {counted(len(self.cases), 'case')} of this run"
        if self.unseen:
            return f"applies to {counted(len(self.unseen), 'case')}, not seen"
        return "not applicable in this run: " + (
            "no case of it" if self.listed else "not known of this version of LAMMPS"
        )


def of_run(run: RunRecord, ledger: Sequence[Finding]) -> list[RunFinding]:
    """Return every finding, the most severe first; of equal severity those that the run shows first."""
    explained = [(case, set(wording.explained_by(case))) for case in run.cases]
    shown = [_finding(entry, explained, run.engine.distribution) for entry in ledger]
    return sorted(shown, key=lambda f: (SEVERITIES.index(f.entry.severity), STATUSES.index(f.status)))


def carried_over(run: RunRecord, ledger: Sequence[Finding] = LEDGER) -> CarriedOver | None:
    """Return what a run says of the ledger; None on a known engine that shows what it showed when it was taken in."""
    engine = run.engine.distribution
    if not engine:
        return None  # LAMMPS did not live to say who it is
    every = of_run(run, ledger)
    seen = {one.entry.id: len(one.cases) for one in every if one.cases and engine not in one.entry.engines}
    expected = [one for one in every if one.listed and one.unseen]
    carried = CarriedOver(
        version=engine,
        nearest=nearest(engine),
        first_seen=seen,
        partly={one.entry.id: len(one.unseen) for one in expected if one.cases},
        gone={one.entry.id: len(one.unseen) for one in expected if not one.cases},
        unexplained=sum(not case.as_expected for case in run.cases),
    )
    return carried if carried.first_seen or expected or engine not in KNOWN else None


def _finding(entry: Finding, explained: Sequence[tuple[CaseRecord, set[str]]], engine: str) -> RunFinding:
    showing, unseen = [], []
    for case, entries in explained:
        shown = entry.id in entries
        would = entry.id in case.unseen
        # A finding of the particle model names the cases that would show it; the others speak of cases by name.
        if not shown and entry.model_variant is None and entry.covers(case.case) and case.verdict != "skipped":
            # Of what nothing reproduces yet only the list says whether it is the same on this engine.
            shown = case.verdict == "differs" and not entry.named_variant and entry.listed(engine)
            would = not shown and entry.listed(engine)
        if shown:
            showing.append(case.case)
        elif would:
            unseen.append(case.case)
    return RunFinding(entry, showing, unseen, entry.listed(engine))
