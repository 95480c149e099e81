"""The changes of the reference that are tried on a red case, in words and as classes before stages and stepping.

Named changes come first: parameters of other types, keywords left out, values of the evaluation before, parts of a
time step, mistakes known to the lint. Then follow all edits of the functions called by the case, the last one first.
Findings are not among them: those that reproduce a case have already explained it. The classes call the next one by
`super`, so that any two can be combined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
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
from lammps_cases.verdict import mistakes
from lammps_cases.verdict.diagnosis.edits import ExpressionEdit
from lammps_cases.verdict.diagnosis.laws import law_changes
from lammps_cases.verdict.diagnosis.reached import reached

Stages = type[ArrayEvaluator]
_STALE = {
    "the pressure": "pressure",
    "the viscosity": "viscosity",
    "the speed of sound": "sound_speed",
    "the temperature": "temperature",
    "the summed density": "density_sum",
    "the density that particles meet each other with": "apparent_density",
    "the same-phase fraction": "same_fraction",
    "the density of walls": "wall_density",
    "the shifting velocity": "raw_shift",
    "the viscosity of strain": "viscosity",
}
_INPUTS_KEPT = {
    "the pressures": "pressure_n",
    "the viscosities": "viscosity_n",
    "the speeds of sound": "sound_n",
    "the temperatures": "temperature_n",
    "the densities": "rho_n",
    "the velocities": "v_nc",
    "the same-phase fractions": "chi_n",
}


@dataclass(frozen=True)
class TriedChange:
    """One change of the reference's formulas.

    Attributes
    ----------
    sentence : "as if ...", without these words
    target : what is changed, the same for alternative changes
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
        """Evaluate, and give the stages access to the simulation."""
        self.count += 1
        self.evaluator.watched = self  # type: ignore[attr-defined]
        self.calls: dict[str, int] = {}
        self.__dict__.setdefault("memory", {})
        return super().evaluate()

    def step(self, dt: float) -> None:
        """Take a step of a length available to the stages."""
        self.dt = dt
        super().step(dt)

    def rounded(self, *arguments: Any) -> Simulation:
        """Evaluate the present state once more, not the next one."""
        self.count -= 1
        try:
            return super().rounded(*arguments)
        finally:
            self.count += 1


def _before(e: ArrayEvaluator, name: str, fresh: Any) -> Any:
    """Return the previous evaluation's values in place of these; at first these themselves."""
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
    """Stages whose solids have the density of the evaluation before: rho0 where they met no fluid then."""

    def wall_density(self, at: IntArray, p: Any, energy_n: Any) -> Any:
        """Return the density that each solid had, whichever solids meet fluid now."""
        fresh = super().wall_density(at, p, energy_n)
        return _before(self, "wall_density", placed(fresh, at, self.rho0_n))[at]


def stale(method: str) -> Stages:
    """Return stages in which a method returns its result of the evaluation before."""
    if method == "wall_density":
        return StaleWalls

    def result(self: Any, *arguments: Any, **options: Any) -> Any:
        return _before(self, method, getattr(super(Stale, self), method)(*arguments, **options))

    Stale = type("Stale", (ArrayEvaluator,), {method: result})
    return Stale


def stale_input(name: str) -> Stages:
    """Return stages whose pair terms use one input of the evaluation before."""

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


def with_model(change: Callable[[Model], Model]) -> Stages:
    """Return stages of a changed model."""

    class Changed(ArrayEvaluator):
        def __init__(self, model: Model, *arguments: Any) -> None:
            super().__init__(change(model), *arguments)

    return Changed


def step_part(method: str, call: Callable[[Callable[..., Any], Any, tuple[Any, ...]], Any]) -> type[Simulation]:
    """Return a stepping with one part called differently."""

    def result(self: Any, *arguments: Any) -> Any:
        return call(getattr(super(Part, self), method), self, arguments)

    Part = type("Part", (Watched,), {method: result})
    return Part


def kicked(first: float, second: float) -> type[Simulation]:
    """Return a stepping with more or less of the half kicks before and after the forces."""

    class Kicked(Watched):
        def step(self, dt: float) -> None:
            self._kick(first * dt)
            super().step(dt)
            self._kick(second * dt)

        def _kick(self, dt: float) -> None:
            if dt:
                self.state.v_nc = self.state.v_nc + 0.5 * dt * (self.fields["f"] / self.mass_n[:, None])

    return Kicked


def type_changes(types: int) -> Iterator[TriedChange]:
    """Yield laws of another form, and parameters of another type."""
    for words, law in law_changes(types):
        yield TriedChange(
            words,
            "the laws",
            with_model(lambda model, law=law: replace(model, eos=law(model.eos))),  # type: ignore[misc]
        )
    sources: list[tuple[str, Callable[[Any, int], Any]]] = []
    if types > 1:
        sources += [
            (f"that of type {k + 1} for every type", lambda values, t, k=k: values[k])  # type: ignore[misc]
            for k in range(types)
        ]
        sources.append(("that of the next type", lambda values, t: values[(t + 1) % len(values)]))
        sources.append(("that of the previous type", lambda values, t: values[t - 1]))
    for words, take in sources:
        for name, change in _PARAMETERS.items():
            yield TriedChange(
                f"{name} were {words}",
                f"{name} by type",
                with_model(lambda model, change=change, take=take: change(model, take)),  # type: ignore[misc]
            )


Take = Callable[[Any, int], Any]


def _taken(values: Any, take: Take) -> tuple[Any, ...]:
    return tuple(take(tuple(values), t) for t in range(len(values)))


def _thermal(name: str) -> Callable[[Model, Take], Model]:
    def change(model: Model, take: Take) -> Model:
        if model.thermal is None:
            return model
        taken = _taken([getattr(p, name) for p in model.thermal], take)
        return replace(model, thermal=tuple(replace(p, **{name: v}) for p, v in zip(model.thermal, taken, strict=True)))

    return change


_PARAMETERS: dict[str, Callable[[Model, Take], Model]] = {
    "the mass in all sums": lambda model, take: replace(model, mass_t=_taken(model.mass_t, take)),
    "the viscosity": lambda model, take: replace(model, viscosity=_taken(model.viscosity, take)),
    "the equilibrium density of fix rheo": lambda model, take: replace(
        model, fix=replace(model.fix, rho0=_taken(model.rho0, take))
    ),
    "the speed of sound of fix rheo": lambda model, take: replace(
        model, fix=replace(model.fix, cs=_taken(model.cs, take))
    ),
    "the conductivity": _thermal("conductivity"),
    "the specific heat": _thermal("specific_heat"),
    "the latent heat": _thermal("latent_heat"),
    "the freezing temperature": _thermal("T_freeze"),
}


def _pair(**change: Any) -> Callable[[Model], Model]:
    return lambda model: replace(model, pair=replace(model.pair, **change))


def _fix(**change: Any) -> Callable[[Model], Model]:
    return lambda model: replace(model, fix=replace(model.fix, **change))


def _shift(**change: Any) -> Callable[[Model], Model]:
    def changed(model: Model) -> Model:
        if model.fix.shift is None:
            return model
        return replace(model, fix=replace(model.fix, shift=replace(model.fix.shift, **change)))

    return changed


KEYWORDS: dict[str, Callable[[Model], Model]] = {
    "artificial/visc were ignored": _pair(artificial_viscosity=0.0),
    "rho/damp were ignored": _pair(rho_damp=0.0),
    "self/mass were ignored": _fix(self_mass=False),
    "self/mass were given": _fix(self_mass=True),
    "zmin were 0": _fix(zmin=0),
    "interface/reconstruct were ignored in sums": _fix(interface_reconstruct=False),
    "exclude/type were ignored": _shift(exclude_types=()),
    "scale/cross/type were ignored": _shift(scale_cross_type=None),
    "the kernel were quintic": _fix(kernel="quintic"),
    "the kernel were RK1": _fix(kernel="RK1"),
    "the kernel were RK2": _fix(kernel="RK2"),
}


def _without_half(which: int) -> Callable[..., Any]:
    """Return a function that omits every first (1) or second (0) call of a simulation's method."""

    def call(plain: Any, sim: Any, given: tuple[Any, ...]) -> Any:
        sim.halves = getattr(sim, "halves", 0) + 1
        return None if sim.halves % 2 == which else plain(*given)

    return call


def step_changes() -> Iterator[TriedChange]:
    """Yield parts of a time step that are left out, doubled or reversed."""
    parts = (
        ("the change of density in half a step", "_continuity"),
        ("the shift of a step", "_shift"),
    )
    for target, method in parts:
        for words, factor in (("were twice as large", 2.0), ("were half as large", 0.5), ("had the other sign", -1.0)):
            yield TriedChange(
                f"{target} {words}",
                target,
                stepping=step_part(
                    method,
                    lambda plain, sim, given, factor=factor: plain(factor * given[0], *given[1:]),  # type: ignore[misc]
                ),
            )
    for target, method in (
        *parts,
        ("the change of phases", "_change_phase"),
        ("the accelerations kept for walls", "keep_forces"),
    ):
        yield TriedChange(f"{target} were left out", target, stepping=step_part(method, lambda plain, sim, given: None))
    for which, words in ((1, "first"), (0, "second")):
        yield TriedChange(
            f"the {words} half of the change of density were left out",
            "the change of density in half a step",
            stepping=step_part("_continuity", _without_half(which)),
        )
    yield TriedChange(
        "the gradients of the first half step were those of the evaluation before",
        "the half-step gradients",
        stepping=step_part("_half_step_gradients", lambda plain, sim, given: sim.gradient),
    )
    for words, first, second in (
        ("the first half of the kick were left out", -1.0, 0.0),
        ("the second half of the kick were left out", 0.0, -1.0),
        ("the first half of the kick were a whole one", 1.0, 0.0),
        ("the second half of the kick were a whole one", 0.0, 1.0),
    ):
        yield TriedChange(words, "the kicks", stepping=kicked(first, second))
    yield TriedChange(
        "the forces of other fixes were left out",
        "other forces",
        stepping=step_part("_external", lambda plain, sim, given: given[0]),
    )
    yield TriedChange(
        "the forces of other fixes did not contain the mass",
        "other forces",
        stepping=step_part("_external", _without_mass),
    )


def _without_mass(plain: Any, sim: Any, given: tuple[Any, ...]) -> Any:
    return given[0] + (plain(*given) - given[0]) / sim.mass_n[:, None]


def candidates(types: int, run: Callable[[], Any]) -> Iterator[TriedChange]:
    """Yield the changes to try in a scene of some number of types, which ``run`` evaluates once."""
    yield from named_changes(types)
    for function in reached(run):
        for edit in function.edits():
            yield TriedChange(function.sentence(edit), edit.before, edit=edit)


@cache
def named_changes(types: int) -> tuple[TriedChange, ...]:
    """Return the changes with a name, in a scene of some number of types."""
    stale_values = [
        TriedChange(f"{what} of every particle were that of the evaluation before", f"{what}, stale", stale(method))
        for what, method in _STALE.items()
    ]
    stale_inputs = [
        TriedChange(
            f"the terms of pairs used {what} of the evaluation before", f"{what} of pairs, stale", stale_input(name)
        )
        for what, name in _INPUTS_KEPT.items()
    ]
    transposed = "the gradient of velocities had its axes exchanged"
    return (
        *type_changes(types),
        *(TriedChange(words, words, with_model(change)) for words, change in KEYWORDS.items()),
        *stale_values,
        *stale_inputs,
        TriedChange(transposed, transposed, VelocitiesTransposed),
        *step_changes(),
        *(
            TriedChange(f"the reference made the mistake: {name}", name, mutant.stages)
            for name, mutant in mistakes.MODEL_MUTANTS.items()
        ),
    )
