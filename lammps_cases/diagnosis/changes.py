"""Ways to change the reference's formulas: classes to put before its stages and its stepping.

All ask their neighbours by `super`, so that any two can be combined. What is changed is a sum over neighbours, a
value that a method returns, the value of a particle as a pair meets it, a parameter of the model, or a part of a
time step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import PairInput
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.state import Gradients, PairTerms
from eos_ref.numbers.rounded import Rounded, placed, value

Stages = type[ArrayEvaluator]
Weight = Callable[[ArrayEvaluator, int], Any]  # of particles (n,), pairs (p,) or a number; told which length is due
Components = tuple[str, ...]


@dataclass(frozen=True)
class Change:
    """One change of the reference's formulas.

    Attributes
    ----------
    sentence : "as if ...", without these words
    target : what is changed, shared by changes that take each other's place
    number : whether it is no more than a factor that all particles share
    stages, stepping : class to put before the evaluator's or the simulation's
    """

    sentence: str
    target: str
    stages: Stages | None = None
    stepping: type[Simulation] | None = None
    number: bool = False


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


def density(e: ArrayEvaluator) -> Any:
    """Return the densities that particles meet each other with, (n,)."""
    return e.apparent_density(e.watched.state.rho_n)  # type: ignore[attr-defined]


# --- sums over neighbours


@contextmanager
def _weighted(e: ArrayEvaluator, weight: Weight) -> Iterator[None]:
    plain = e.total  # another weight's, where two are combined

    def total(term_p: Any) -> Any:
        return plain(term_p * weight(e, len(e.i)))

    e.total = total  # type: ignore[method-assign]
    try:
        yield
    finally:
        e.total = plain  # type: ignore[method-assign]


def _combined_terms(plain: PairTerms, changed: PairTerms, of: Components) -> PairTerms:
    """Return terms of which some are the changed ones; ``viscous`` is the force without that of pressures."""
    if "pressure" in of and "viscous" in of:
        return replace(plain, force_nc=changed.force_nc, pressure_force_nc=changed.pressure_force_nc)
    if "pressure" in of:
        force_nc = changed.pressure_force_nc + (plain.force_nc - plain.pressure_force_nc)
        return replace(plain, force_nc=force_nc, pressure_force_nc=changed.pressure_force_nc)
    if "viscous" in of:
        force_nc = plain.pressure_force_nc + (changed.force_nc - changed.pressure_force_nc)
        return replace(plain, force_nc=force_nc)
    return replace(plain, **{name: getattr(changed, name) for name in of})


def pair_sum(weight: Weight, of: Components) -> Stages:
    """Return stages whose terms of pair_style rheo carry a weight."""

    class WeightedTerms(ArrayEvaluator):
        def pair_terms(self, fields: PairInput) -> PairTerms:
            plain = super().pair_terms(fields)
            with _weighted(self, weight):
                return _combined_terms(plain, super().pair_terms(fields), of)

    return WeightedTerms


def gradient_sum(weight: Weight, of: str) -> Stages:
    """Return stages whose gradients of one field carry a weight in their sums."""

    class WeightedGradients(ArrayEvaluator):
        def gradients(self, *arguments: Any, **options: Any) -> Gradients:
            plain = super().gradients(*arguments, **options)
            with _weighted(self, weight):
                return replace(plain, **{of: getattr(super().gradients(*arguments, **options), of)})

    return WeightedGradients


def sum_of(method: str, weight: Weight) -> Stages:
    """Return stages with a weight in all sums of a method."""

    def weighted(self: Any, *arguments: Any, **options: Any) -> Any:
        with _weighted(self, weight):
            return getattr(super(Weighted, self), method)(*arguments, **options)

    Weighted = type("Weighted", (ArrayEvaluator,), {method: weighted})
    return Weighted


# --- values


def scaled(method: str, weight: Weight) -> Stages:
    """Return stages of which a method returns its result times a weight."""

    def result(self: Any, *arguments: Any, **options: Any) -> Any:
        plain = getattr(super(Scaled, self), method)(*arguments, **options)
        if isinstance(plain, list):
            return [part * weight(self, len(part)) for part in plain]
        if len(np.shape(value(plain))) != 1:
            return plain
        factor = weight(self, len(plain))
        fits = np.shape(value(factor)) in ((), np.shape(value(plain)))  # a result may be that of some particles
        return plain * factor if fits else plain

    Scaled = type("Scaled", (ArrayEvaluator,), {method: result})
    return Scaled


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


class Met:
    """Values of particles, (n,), of which pairs meet others than they have."""

    def __init__(self, e: ArrayEvaluator, values_n: Any, at: Callable[[Any, Any], tuple[Any, Any]]) -> None:
        self.e, self.values_n = e, values_n
        self.pair = at(values_n[e.i], values_n[e.j])

    def __getitem__(self, index: Any) -> Any:
        if index is self.e.i:
            return self.pair[0]
        return self.pair[1] if index is self.e.j else self.values_n[index]


MEETINGS: dict[str, Callable[[Any, Any], tuple[Any, Any]]] = {
    "of the particle itself for that of its neighbour": lambda a, b: (a, a),
    "of the neighbour for that of the particle itself": lambda a, b: (b, b),
    "of either particle exchanged": lambda a, b: (b, a),
    "of the neighbour with the other sign": lambda a, b: (a, -b),
    "with the other sign": lambda a, b: (-a, -b),
    "twice as large": lambda a, b: (2 * a, 2 * b),
    "half as large": lambda a, b: (0.5 * a, 0.5 * b),
    "of the particle alone, and nothing of its neighbour": lambda a, b: (a, 0 * b),
    "of the neighbour alone, and nothing of the particle": lambda a, b: (0 * a, b),
}


def met(name: str, meeting: str, of: Components) -> Stages:
    """Return stages in whose terms of pairs one input of particles is met otherwise."""
    at = MEETINGS[meeting]

    class Meeting(ArrayEvaluator):
        def pair_terms(self, fields: PairInput) -> PairTerms:
            plain = super().pair_terms(fields)
            if name in ("mass_n", "rho0_n"):
                kept = getattr(self, name)
                setattr(self, name, Met(self, kept, at))
                try:
                    return _combined_terms(plain, super().pair_terms(fields), of)
                finally:
                    setattr(self, name, kept)
            if name == "conduction":
                flow_n = Met(self, self.conduction(), at)
                self.conduction = lambda: flow_n  # type: ignore[method-assign, assignment, return-value]
                try:
                    return _combined_terms(plain, super().pair_terms(fields), of)
                finally:
                    del self.conduction
            values_n = getattr(fields, name)
            if values_n is None:
                return plain
            met_n: Any = Met(self, values_n, at)
            other = fields._replace(**{name: met_n})
            return _combined_terms(plain, super().pair_terms(other), of)

    return Meeting


# --- kernels


def plain_gradient(method: str) -> Stages:
    """Return stages of which a method takes the gradient of the plain kernel for the corrected one."""

    def result(self: Any, *arguments: Any, **options: Any) -> Any:
        kept, self.g = self.g, self.gradw
        try:
            return getattr(super(Plain, self), method)(*arguments, **options)
        finally:
            self.g = kept

    Plain = type("Plain", (ArrayEvaluator,), {method: result})
    return Plain


def corrected_gradient(method: str) -> Stages:
    """Return stages of which a method takes the corrected gradient for that of the plain kernel."""

    def result(self: Any, *arguments: Any, **options: Any) -> Any:
        kept, self.gradw = self.gradw, self.g
        try:
            return getattr(super(Corrected, self), method)(*arguments, **options)
        finally:
            self.gradw = kept

    Corrected = type("Corrected", (ArrayEvaluator,), {method: result})
    return Corrected


def kernel_times(factor: Callable[[Model], float], values: bool, slopes: bool) -> Stages:
    """Return stages whose kernel, or its gradient, is multiplied by a number."""

    class Times(ArrayEvaluator):
        def move(self, x_nc: Any) -> None:
            super().move(x_nc)
            if values:
                self.w = self.w * factor(self.model)
            if slopes:
                self.gradw = [g_a * factor(self.model) for g_a in self.gradw]
                self.g = self.gradw

    return Times


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
