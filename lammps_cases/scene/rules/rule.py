"""One rule of the reference: a branch, a term or a parameter that a scene exercises or does not, and how it is counted.

Nothing is declared: the particles and pairs of a rule are counted in the arrays of the reference, at the steps that a
scene compares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import IntArray
from eos_ref.model.state import State

Counted = Literal["particle", "pair"]


@dataclass(frozen=True)
class Evaluated:
    """The reference of a scene at one of the steps compared.

    Array names end in ``_n`` particle, ``_p`` directed pair.

    Attributes
    ----------
    sim : evaluated in arrays
    start : the state before the first evaluation
    compared : fields that the scene compares
    step : number of the step
    box : before the first evaluation
    step_changed : whether the time step was another one before
    """

    sim: Simulation
    start: State
    compared: tuple[str, ...]
    step: int
    box: Box
    step_changed: bool = False

    @cached_property
    def evaluator(self) -> ArrayEvaluator:
        """Return the evaluator, with the pairs of the last evaluation if the scene needs any."""
        return cast(ArrayEvaluator, self.sim.evaluator)

    @cached_property
    def solid_n(self) -> BoolArray:
        """Return which particles were solid in the last evaluation."""
        return self.evaluator.solid_n

    @cached_property
    def fluid_n(self) -> BoolArray:
        """Return which particles were fluid in the last evaluation."""
        return ~self.solid_n

    @cached_property
    def v_nc(self) -> FloatArray:
        """Return the velocities that the last evaluation had, (n, d)."""
        return cast(FloatArray, self.sim.evaluated.v_nc)

    @cached_property
    def rho_n(self) -> FloatArray:
        """Return the densities, (n,)."""
        return cast(FloatArray, self.sim.state.rho_n)

    @cached_property
    def chi_n(self) -> Any:
        """Return the same-phase fractions of a model with reconstructed walls, (n,)."""
        assert self.sim.chi_n is not None
        return self.sim.chi_n

    @cached_property
    def i(self) -> IntArray:
        """Return the collecting particle of every directed pair, (p,)."""
        return self.evaluator.i

    @cached_property
    def j(self) -> IntArray:
        """Return the other particle of every directed pair, (p,)."""
        return self.evaluator.j

    def of_type(self, name: str, laws: Any) -> Any:
        """Return an attribute of what every type has, for every particle, (n,)."""
        return self.evaluator.of_type(getattr(law, name) for law in laws)

    def differs_p(self, values_n: Any) -> BoolArray:
        """Return in which pairs the particles have different values, (p,); of vectors any component."""
        rows = np.asarray(values_n).reshape(len(values_n), -1)
        differs_p: BoolArray = (rows[self.i] != rows[self.j]).any(axis=1)
        return differs_p

    @cached_property
    def fluids_p(self) -> BoolArray:
        """Return the pairs of two fluid particles, (p,)."""
        return self.fluid_n[self.i] & self.fluid_n[self.j]

    @cached_property
    def solids_p(self) -> BoolArray:
        """Return the pairs of two solid particles, (p,)."""
        return self.solid_n[self.i] & self.solid_n[self.j]

    @cached_property
    def mixed_p(self) -> BoolArray:
        """Return the pairs of a fluid and a solid particle, (p,)."""
        return self.differs_p(self.solid_n)

    @cached_property
    def other_type_p(self) -> BoolArray:
        """Return the pairs of particles of different types, (p,)."""
        return self.differs_p(self.evaluator.type_n)

    def any_of_n(self, mask_p: BoolArray) -> BoolArray:
        """Return which particles collect from some pair of a class, (n,)."""
        return np.bincount(self.i[mask_p], minlength=self.evaluator.n) > 0


@dataclass(frozen=True)
class Rule:
    """A rule of the reference.

    Attributes
    ----------
    name : lower-case words joined by hyphens; of fields ``field/`` and LAMMPS' name
    sentence : what the reference does by it
    which : the particles (n,) or directed pairs (p,) that take it
    of : which of them
    needs : quantities of the evaluation that it is counted in; a scene without them has none
    faults : named mistakes that break it: a case in which one leaves its bound depends on the rule; none where no
        formula is the rule's own
    dimensions : in which there have to be witnesses; empty: the rule knows none
    """

    name: str
    sentence: str
    which: Callable[[Evaluated], Any]
    of: Counted = "particle"
    needs: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    dimensions: tuple[int, ...] = (2, 3)

    def count(self, evaluated: Evaluated) -> int:
        """Return the number of particles, or of pairs, that take the rule at a step."""
        if not set(self.needs) <= set(evaluated.sim.plan):
            return 0
        count = int(np.count_nonzero(self.which(evaluated)))
        return count if self.of == "particle" else (count + 1) // 2


def pair_rule(name: str, sentence: str, which: Callable[[Evaluated], Any], *faults: str, needs: str = "f") -> Rule:
    """Return a rule of pairs, of forces unless it says otherwise."""
    return Rule(name, sentence, which, "pair", ("pairs", needs), faults)


def rules_of(*needs: str) -> Callable[..., Rule]:
    """Return what makes rules of particles that need some quantities: of name, sentence, which, faults."""

    def rule(name: str, sentence: str, which: Callable[[Evaluated], Any], *faults: str) -> Rule:
        return Rule(name, sentence, which, needs=needs, faults=faults)

    return rule
