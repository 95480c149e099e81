"""Ways to change the reference: edits of its source, and classes to put before its stages and its stepping.

The classes hand on to the next one by `super`, so that any two can be combined: values of the evaluation before,
parameters of the model, parts of a time step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import PairInput
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.state import Gradients, PairTerms
from eos_ref.numbers.columns import joined, matrix
from eos_ref.numbers.rounded import Rounded, placed
from lammps_cases.verdict.diagnosis.edits import ExpressionEdit

Stages = type[ArrayEvaluator]


@dataclass(frozen=True)
class Change:
    """One change of the reference's formulas.

    Attributes
    ----------
    sentence : "as if ...", without these words
    target : what is changed, shared by changes that take each other's place
    stages, stepping : class to put before the evaluator's or the simulation's
    edit : of the reference's source
    """

    sentence: str
    target: str
    stages: Stages | None = None
    stepping: type[Simulation] | None = None
    edit: ExpressionEdit | None = None


class Watched(Simulation):
    """A simulation whose stages can look at the state, and at results of the evaluation before."""

    count = 0
    dt = 0.0

    def evaluate(self) -> dict[str, Any]:
        """Evaluate, and let the stages see the simulation."""
        self.count += 1
        self.evaluator.watched = self  # type: ignore[attr-defined]
        self.calls: dict[str, int] = {}
        self.__dict__.setdefault("memory", {})
        return super().evaluate()

    def step(self, dt: float) -> None:
        """Take a step whose length the stages know."""
        self.dt = dt
        super().step(dt)

    def rounded(self, *arguments: Any) -> Simulation:
        """Evaluate the present state once more, not the next one."""
        self.count -= 1
        try:
            return super().rounded(*arguments)
        finally:
            self.count += 1


# --- values of the evaluation before


def _before(e: ArrayEvaluator, name: str, fresh: Any) -> Any:
    """Return what stood in the place of some values in the evaluation before; at first themselves."""
    watched = getattr(e, "watched", None)
    if watched is None:
        return fresh
    call = watched.calls[name] = watched.calls.get(name, 0) + 1
    watched.memory.setdefault((name, call, watched.count), fresh)
    before = watched.memory.get((name, call, watched.count - 1), fresh)
    if isinstance(fresh, Rounded) and not isinstance(before, Rounded):
        return Rounded(before, 16 * EPS * np.abs(before))
    return before


class StaleWalls(ArrayEvaluator):
    """Stages whose solids have the density of the evaluation before: rho0 where none of the fluid was met then."""

    def wall_density(self, at: IntArray, p: Any, energy_n: Any) -> Any:
        """Return the density that each solid had, whichever solids meet fluid now."""
        fresh = super().wall_density(at, p, energy_n)
        return _before(self, "wall_density", placed(fresh, at, self.rho0_n))[at]


def stale(method: str) -> Stages:
    """Return stages of which a method returns what it returned in the evaluation before."""
    if method == "wall_density":
        return StaleWalls

    def result(self: Any, *arguments: Any, **options: Any) -> Any:
        return _before(self, method, getattr(super(Stale, self), method)(*arguments, **options))

    Stale = type("Stale", (ArrayEvaluator,), {method: result})
    return Stale


def stale_input(name: str) -> Stages:
    """Return stages whose terms of pairs are given one input as it was in the evaluation before."""

    class StaleInput(ArrayEvaluator):
        def pair_terms(self, fields: PairInput) -> PairTerms:
            fresh = getattr(fields, name)
            before: Any = None if fresh is None else _before(self, f"{name} of pairs", fresh)
            return super().pair_terms(fields._replace(**{name: before}))

    return StaleInput


class VelocitiesTransposed(ArrayEvaluator):
    """Stages whose gradients of velocities have their axes exchanged."""

    def gradients(self, *arguments: Any, **options: Any) -> Gradients:
        """Exchange the axes."""
        plain = super().gradients(*arguments, **options)
        if plain.v_ncc is None:
            return plain
        rows = matrix(plain.v_ncc)
        return replace(plain, v_ncc=joined([list(column) for column in zip(*rows, strict=True)]))


# --- parameters


def with_model(change: Callable[[Model], Model]) -> Stages:
    """Return stages of a changed model."""

    class Changed(ArrayEvaluator):
        def __init__(self, model: Model, *arguments: Any) -> None:
            super().__init__(change(model), *arguments)

    return Changed


# --- time steps


def step_part(method: str, call: Callable[[Callable[..., Any], Any, tuple[Any, ...]], Any]) -> type[Simulation]:
    """Return a stepping of which one part is called otherwise."""

    def result(self: Any, *arguments: Any) -> Any:
        return call(getattr(super(Part, self), method), self, arguments)

    Part = type("Part", (Watched,), {method: result})
    return Part


def kicked(first: float, second: float) -> type[Simulation]:
    """Return a stepping with more, or less, of the half kicks before and after the forces."""

    class Kicked(Watched):
        def step(self, dt: float) -> None:
            self._kick(first * dt)
            super().step(dt)
            self._kick(second * dt)

        def _kick(self, dt: float) -> None:
            if dt:
                self.state.v_nc = self.state.v_nc + 0.5 * dt * (self.fields["f"] / self.mass_n[:, None])

    return Kicked
