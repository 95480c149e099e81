"""The changes of the reference that are tried on a red case.

First those of the catalogue that the case can show, then changes made for it: laws and parameters of other types,
values of the evaluation before. Then follow all edits of the functions called by the case, the
last one first. Findings are not among them: those that reproduce a case have already explained it. The classes call the
next one by `super`, so that any two can be combined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from eos_ref import EOS, EOSTable
from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import PairInput
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.state import PairTerms
from eos_ref.numbers.rounded import Rounded, placed
from lammps_cases.comparison.changed import codes_of, reaches
from lammps_cases.scene.changes import Change, hypothesis
from lammps_cases.verdict import mistakes
from lammps_cases.verdict.diagnosis.reached import reached

Stages = type[ArrayEvaluator]
Take = Callable[[Any, int], Any]  # of the values of all types, for a type from 0
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
_LAW = {
    "speed of sound": "cs",
    "equilibrium density": "rho0",
    "parameter": "parameter",
    "background": "background",
}


# --- values of the evaluation before


class Watched(Simulation):
    """A simulation whose stages can look at results of the evaluation before."""

    count = 0

    def evaluate(self) -> dict[str, Any]:
        """Evaluate, and give the stages access to the simulation."""
        self.count += 1
        self.evaluator.watched = self  # type: ignore[attr-defined]
        self.calls: dict[str, int] = {}
        self.__dict__.setdefault("memory", {})
        return super().evaluate()

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


def _stale_values() -> Iterator[Change]:
    for words, method in _STALE.items():
        yield hypothesis(
            f"{words} of every particle were that of the evaluation before", stages=stale(method), stepping=Watched
        )
    for words, name in _INPUTS_KEPT.items():
        yield hypothesis(
            f"the terms of pairs used {words} of the evaluation before", stages=stale_input(name), stepping=Watched
        )


# --- laws and parameters


def with_model(change: Callable[[Model], Model]) -> Stages:
    """Return stages of a changed model."""

    class Changed(ArrayEvaluator):
        def __init__(self, model: Model, *arguments: Any) -> None:
            super().__init__(change(model), *arguments)

    return Changed


def _of_laws(what: str, change: Callable[[EOS, int, EOSTable], EOS]) -> Change:
    """Return a change of the law of every type, from 0; it may be undefined for some laws, and raise there."""

    def changed(table: EOSTable) -> EOSTable:
        return EOSTable(tuple(change(law, t, table) for t, law in enumerate(table.laws)))

    return hypothesis(what, table=changed, stages=with_model(lambda model: replace(model, eos=changed(model.eos))))


def law_changes(types: int) -> Iterator[Change]:
    """Yield changes of the laws of all types: of another form, or with numbers of another type."""
    others: list[tuple[str, Callable[[int, int], int]]] = []
    if types > 1:
        others += [(f"type {k + 1}", lambda t, count, k=k: k) for k in range(types)]  # type: ignore[misc]
        others += [("the next type", lambda t, count: (t + 1) % count), ("the previous type", lambda t, count: t - 1)]
    for words, other in others:
        for name, key in _LAW.items():
            yield _of_laws(
                f"the pressure of every particle used the {name} of {words}",
                lambda law, t, table, key=key, other=other: replace(  # type: ignore[misc]
                    law, **{key: getattr(table.laws[other(t, len(table))], key)}
                ),
            )
        yield _of_laws(
            f"the pressure of every particle followed the law of {words}",
            lambda law, t, table, other=other: table.laws[other(t, len(table))],  # type: ignore[misc]
        )


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


def _parameters(types: int) -> Iterator[Change]:
    sources: dict[str, Take] = {f"type {k + 1} for every type": lambda values, t, k=k: values[k] for k in range(types)}  # type: ignore[misc]
    sources |= {"the next type": lambda values, t: values[(t + 1) % len(values)]}
    sources |= {"the previous type": lambda values, t: values[t - 1]}
    for words, take in sources.items() if types > 1 else ():
        for name, change in _PARAMETERS.items():
            stages = with_model(lambda model, change=change, take=take: change(model, take))  # type: ignore[misc]
            yield hypothesis(f"{name} were that of {words}", stages=stages)


def candidates(types: int, run: Callable[[], Any]) -> Iterator[Change]:
    """Yield the changes to try in a scene of some number of types, which ``run`` evaluates once."""
    codes = codes_of(run)
    yield from (change for change in (*mistakes.changes().values(), *_named(types)) if reaches(change, codes))
    for function in reached(run):
        yield from function.edits()


@cache
def _named(types: int) -> tuple[Change, ...]:
    """Return the changes that are made from lists, for a number of types."""
    return (*law_changes(types), *_parameters(types), *_stale_values())
