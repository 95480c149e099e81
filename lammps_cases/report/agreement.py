"""The particle model on one table: each field at each step, over all cases of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from lammps_cases.records import wording
from lammps_cases.records.case_parts import StepRecord, Verdict
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.scene.fields import FIELDS, in_step_order


@dataclass
class WorstCase:
    """Number of cases with some verdict, the largest difference/bound among them and whose it is."""

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
        """Number of cases that compare the field at the step."""
        return self.agree + self.explained.cases + self.outside.cases

    @property
    def agree(self) -> int:
        """Number of cases inside the bound, the same bits included."""
        return self.exact.cases + self.inside.cases

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of the cases."""
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
    """Return LAMMPS against the reference and, where a run has such cases, against itself; empty without the model."""
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
