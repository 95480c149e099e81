"""Variants of the reference's particle model: each replaces one small method and reproduces a finding of the ledger.

A variant is a class to put before `eos_ref.evaluation.array_evaluator.ArrayEvaluator` (``stages``) or
`eos_ref.evaluation.time_step.Simulation` (``stepping``), with the scenes to which it makes a difference. No variant
is part of the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import dependencies
from lammps_cases.comparison.changed import joined
from lammps_cases.comparison.problem import Problem

# LAMMPS' fields at one step, by the names of `eos_ref.model.quantities`; the first one may hold `lists`, of all steps.
Snapshot = dict[str, Any]


@dataclass(frozen=True)
class Variant:
    """A change of the reference, and the scenes that it changes.

    Attributes
    ----------
    applies : whether it makes a difference to a scene
    stages, stepping : class to put before the evaluator's or the simulation's
    fit : sets what only LAMMPS' numbers determine, from its first snapshot
    undefined : whether it leaves values without a bound
    lists : whether it follows LAMMPS' neighbour lists, which are read only for it
    changes : quantities that it changes; where they cannot be predicted, neither can what depends on them
    """

    applies: Callable[[Problem], bool]
    stages: type[ArrayEvaluator] | None = None
    stepping: type[Simulation] | None = None
    fit: Callable[[Problem, type[ArrayEvaluator], Snapshot], dict[str, Any] | None] | None = None
    undefined: bool = False
    lists: bool = False
    changes: tuple[str, ...] = ()

    @property
    def blind(self) -> bool:
        """Return whether it predicts something where no lists were read."""
        return self.undefined or not self.lists

    def reaches(self, model: Model, field: str) -> bool:
        """Return whether a field of a model depends on a quantity that it changes; True if these are not known."""
        return not self.changes or not dependencies(model, field).isdisjoint(self.changes)

    def within(self, other: Variant) -> bool:
        """Return whether another variant builds on this one, so that together with it this one changes nothing."""
        own = [(a, b) for a, b in ((self.stages, other.stages), (self.stepping, other.stepping)) if a is not None]
        return bool(own) and all(b is not None and issubclass(b, a) for a, b in own)


def combined(
    variants: Sequence[Variant], problem: Problem, snapshot: Snapshot
) -> tuple[type[ArrayEvaluator], type[Simulation]] | None:
    """Join several variants to an evaluator and a simulation; None if one cannot be fitted to LAMMPS' numbers."""
    stages: type[ArrayEvaluator] = joined("Evaluator", (v.stages for v in variants), ArrayEvaluator)
    for variant in sorted(variants, key=lambda each: not each.lists):  # others may evaluate stages that follow lists
        if variant.fit:
            fitted = variant.fit(problem, stages, snapshot)
            if fitted is None:
                return None
            stages = type("Fitted", (stages,), {**fitted, "__module__": __name__})
    return stages, joined("Stepping", (v.stepping for v in variants), Simulation)
