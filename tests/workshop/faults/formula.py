"""Planted faults in the formulas of the reference, which stands in for LAMMPS: the catalogue of changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.scene.changes import Change
from lammps_cases.verdict.mistakes import changes
from tests.workshop.faults.fault import Fault, by_id


@dataclass(frozen=True)
class FormulaFault(Fault):
    """A change of the catalogue, planted."""

    change: Change


@cache
def faults() -> dict[str, FormulaFault]:
    """Return all faults of this family by their id, in order."""
    return by_id(
        FormulaFault(f"formula.{of.id}", of.kind, of.what, of) for of in changes().values() if of.role != "hypothesis"
    )


def stages(fault: Fault) -> type[ArrayEvaluator] | None:
    """Return the stages that make a mistake of the particle model; None for an edit of the source."""
    return fault.change.stages if isinstance(fault, FormulaFault) else None
