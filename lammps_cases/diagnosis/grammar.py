"""The changes of the reference's formulas that are tried, in words and as classes.

Beside the mistakes that the lint knows and the variants of the ledger: every sum over neighbours times every factor,
of the particle or its neighbour; every pair class skipped or counted twice; values of other particles and types; stale
values; other kernels; parts of a time step left out or doubled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.parameters import Model
from eos_ref.model.state import Gradients
from eos_ref.numbers.elementary import where
from lammps_cases.diagnosis.changes import (
    MEETINGS,
    Change,
    Stages,
    Weight,
    corrected_gradient,
    density,
    gradient_sum,
    kernel_times,
    met,
    pair_sum,
    plain_gradient,
    scaled,
    stale,
    stale_input,
    sum_of,
    with_model,
)
from lammps_cases.diagnosis.parameter_changes import KEYWORDS, type_changes
from lammps_cases.diagnosis.step_changes import step_changes
from lammps_cases.findings import LEDGER
from lammps_cases.verdict import model_mistakes

# --- factors

Particle = Callable[[ArrayEvaluator], Any]
_OF_PARTICLE: dict[str, Particle] = {
    "volume": lambda e: e.mass_n / density(e),
    "mass": lambda e: e.mass_n,
    "density": density,
    "equilibrium density": lambda e: e.rho0_n,
    "equilibrium volume": lambda e: e.mass_n / e.rho0_n,
    "density over its equilibrium density": lambda e: density(e) / e.rho0_n,
    "speed of sound": lambda e: e.cs_n,
}
_NUMBERS: dict[str, Callable[[Model], float]] = {
    "were twice as large": lambda model: 2.0,
    "were half as large": lambda model: 0.5,
    "had the other sign": lambda model: -1.0,
    "were missing": lambda model: 0.0,
    "were multiplied by the dimension": lambda model: float(model.dimension),
    "were divided by the dimension": lambda model: 1.0 / model.dimension,
    "were multiplied by h": lambda model: model.h,
    "were divided by h": lambda model: 1 / model.h,
    "were multiplied by the cutoff": lambda model: model.cut,
    "were divided by the cutoff": lambda model: 1 / model.cut,
}
_PAIRS: dict[str, Callable[[ArrayEvaluator], Any]] = {
    "of one type": lambda e: e.type_n[e.i] == e.type_n[e.j],
    "of two types": lambda e: e.type_n[e.i] != e.type_n[e.j],
    "of two fluid particles": lambda e: ~e.solid_n[e.i] & ~e.solid_n[e.j],
    "of fluid and solid": lambda e: e.solid_n[e.i] != e.solid_n[e.j],
    "of two solid particles": lambda e: e.solid_n[e.i] & e.solid_n[e.j],
    "under which the particle has the higher number": lambda e: e.i > e.j,
}


def _as_due(values_n: Any, e: ArrayEvaluator, length: int, neighbour: bool) -> Any:
    if length != e.n or length == len(e.i):
        return values_n[e.j if neighbour else e.i]
    return values_n


def _number(factor: Callable[[Model], float]) -> Weight:
    return lambda e, length: factor(e.model)


def _particle(of: Particle, neighbour: bool, inverse: bool) -> Weight:
    def weight(e: ArrayEvaluator, length: int) -> Any:
        values = _as_due(of(e), e, length, neighbour)
        return 1 / values if inverse else values

    return weight


def _ratio(of: Particle, neighbour: bool) -> Weight:
    def weight(e: ArrayEvaluator, length: int) -> Any:
        values_n = of(e)
        return values_n[e.j] / values_n[e.i] if neighbour else values_n[e.i] / values_n[e.j]

    return weight


def _of_class(pairs: Callable[[ArrayEvaluator], Any], factor: float) -> Weight:
    return lambda e, length: where(pairs(e), factor, 1.0)


def numbers() -> Iterator[tuple[str, Weight]]:
    """Yield factors that are numbers."""
    for words, factor in _NUMBERS.items():
        yield words, _number(factor)


def of_particles(neighbours: bool) -> Iterator[tuple[str, Weight]]:
    """Yield factors that are values of particles, of their neighbours too."""
    for name, of in _OF_PARTICLE.items():
        for neighbour in (False, True) if neighbours else (False,):
            whose = "of the neighbour" if neighbour else "of the particle"
            yield f"were multiplied by the {name} {whose}", _particle(of, neighbour, False)
            yield f"were divided by the {name} {whose}", _particle(of, neighbour, True)
        if neighbours:
            yield f"used the {name} of the particle for that of its neighbour", _ratio(of, False)
            yield f"used the {name} of the neighbour for that of the particle", _ratio(of, True)


def of_pairs() -> Iterator[tuple[str, Weight]]:
    """Yield factors that are another for some classes of pairs."""
    for name, pairs in _PAIRS.items():
        yield f"skipped pairs {name}", _of_class(pairs, 0.0)
        yield f"counted pairs {name} twice", _of_class(pairs, 2.0)
        yield f"counted pairs {name} by half", _of_class(pairs, 0.5)
    yield "were multiplied by the distance", lambda e, length: e.r
    yield "were divided by the distance", lambda e, length: 1 / e.r


# --- what is changed

_TERMS = {
    "the force of pressures": ("pressure",),
    "the viscous force": ("viscous",),
    "the force of pairs": ("pressure", "viscous"),
    "the density diffusion": ("drho_n",),
    "the heat flow": ("heat_n",),
}
_GRADIENTS = {
    "the gradient of velocities": "v_ncc",
    "the gradient of densities": "rho_nc",
    "the gradient of energies": "energy_nc",
}
_SUMS = {
    "the gradients of all fields": "gradients",
    "the summed density, its own term aside,": "kernel_sum",
    "the moment matrix of the reproducing kernel": "moments",
    "the sums of the shifting velocity": "shift_sums",
    "the sums over other types": "color_sums",
    "the support by the same type": "same_type_support",
    "the sums of surface detection": "surface_sums",
    "the sums over the fluid at a wall": "wall_sums",
    "the sums of the same-phase fraction": "phase_sums",
}
_VALUES = {
    "the pressure": "pressure",
    "the viscosity": "viscosity",
    "the speed of sound": "sound_speed",
    "the temperature": "temperature",
    "the conductivity": "conduction",
    "the specific energy": "specific_energy",
    "the summed density": "density_sum",
    "the density of walls": "wall_density",
    "the same-phase fraction": "same_fraction",
    "the density diffusion": "diffusion",
    "the shifting velocity": "raw_shift",
    "the normal between types": "cross_type_normal",
}
_OF_PAIRS = {
    "the volume that a pair's force acts on": "collecting_volume",
    "the volume that a pair's heat flows into": "heated_volume",
    "the artificial viscosity": "artificial",
    "the repulsion by walls": "repulsion",
    "the no-slip ratio": "no_slip",
    "the velocity of a wall": "wall_velocity",
}
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
_INPUTS: dict[str, tuple[str, Any]] = {
    "the pressure": ("pressure_n", ("pressure",)),
    "the viscosity": ("viscosity_n", ("viscous",)),
    "the speed of sound": ("sound_n", ("pressure", "viscous")),
    "the conductivity": ("conduction", ("heat_n",)),
    "the temperature": ("temperature_n", ("heat_n",)),
    "the equilibrium density": ("rho0_n", ("drho_n",)),
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


def _sums() -> Iterator[tuple[str, Callable[[Weight], Stages]]]:
    for name, of in _TERMS.items():
        yield name, lambda weight, of=of: pair_sum(weight, of)  # type: ignore[misc]
    for name, part in _GRADIENTS.items():
        yield name, lambda weight, part=part: gradient_sum(weight, part)  # type: ignore[misc]
    for name, method in _SUMS.items():
        yield name, lambda weight, method=method: sum_of(method, weight)  # type: ignore[misc]


def _of_sums() -> Iterator[Change]:
    for target, make in _sums():
        for words, weight in (*numbers(), *of_particles(neighbours=True), *of_pairs()):
            yield Change(f"{target} {words}", target, make(weight), number=words in _NUMBERS)


def _of_values() -> Iterator[Change]:
    for target, method in _VALUES.items():
        for words, weight in (*numbers(), *of_particles(neighbours=False)):
            stages = scaled(method, weight)
            whose = f"{target} of every particle"
            yield Change(f"{whose} {words}", whose, stages, number=words in _NUMBERS)
    for target, method in _OF_PAIRS.items():
        for words, weight in (*numbers(), *of_particles(neighbours=True), *of_pairs()):
            yield Change(f"{target} {words}", target, scaled(method, weight), number=words in _NUMBERS)
    for target, method in _STALE.items():
        sentence = f"{target} of every particle were that of the evaluation before"
        yield Change(sentence, f"{target} of every particle, stale", stale(method))


def _of_meetings() -> Iterator[Change]:
    for what, (name, of) in _INPUTS.items():
        for meeting in MEETINGS:
            yield Change(f"pairs met {what} {meeting}", f"{what} that pairs meet", met(name, meeting, of))
    for what, name in _INPUTS_KEPT.items():
        sentence = f"the terms of pairs used {what} of the evaluation before"
        yield Change(sentence, f"{what} of pairs, stale", stale_input(name))
    for terms, of in _TERMS.items():
        for meeting in MEETINGS:
            yield Change(f"{terms} used the mass {meeting}", f"masses in {terms}", met("mass_n", meeting, of))


def _of_kernels() -> Iterator[Change]:
    for name, method in (("the terms of pairs", "pair_terms"), ("the gradients", "gradients")):
        yield Change(f"{name} used the gradient of the plain kernel", f"kernel of {name}", plain_gradient(method))
    for name, method in (
        ("shifting", "shift_sums"),
        ("surface detection", "surface_sums"),
        ("the sums over other types", "color_sums"),
    ):
        sentence = f"{name} used the gradient of the reproducing kernel"
        yield Change(sentence, f"kernel of {name}", corrected_gradient(method))
    for words, factor in _NUMBERS.items():
        for name, values, slopes in (
            ("the kernel", True, False),
            ("the gradient of the kernel", False, True),
            ("the kernel and its gradient", True, True),
        ):
            yield Change(f"{name} {words}", name, kernel_times(factor, values, slopes))


# --- all of them


class VelocitiesTransposed(ArrayEvaluator):
    """Gradients of velocities with their axes exchanged."""

    def gradients(self, *arguments: Any, **options: Any) -> Gradients:
        """Exchange the axes."""
        plain = super().gradients(*arguments, **options)
        if plain.v_ncc is None:
            return plain
        from eos_ref.numbers.columns import joined, matrix

        rows = matrix(plain.v_ncc)
        return replace(plain, v_ncc=joined([list(column) for column in zip(*rows, strict=True)]))


@cache
def changes(types: int) -> tuple[Change, ...]:
    """Return all changes that are tried in a scene of some number of types, the plainest first."""
    named = [
        Change(f"the reference made the mistake: {name}", name, mutant.stages)
        for name, mutant in model_mistakes.MUTANTS.items()
    ]
    variants = [
        Change(f"finding {entry.id} showed here", entry.id, variant.stages, variant.stepping)
        for entry in LEDGER
        if (variant := entry.model_variant) is not None
        and not variant.fit
        and not variant.lists
        and not variant.undefined
    ]
    keywords = [Change(words, words, with_model(change)) for words, change in KEYWORDS.items()]
    transposed = Change(
        "the gradient of velocities had its axes exchanged", "the gradient of velocities", VelocitiesTransposed
    )
    return (
        *type_changes(types),
        *_of_sums(),
        *_of_values(),
        *_of_meetings(),
        *_of_kernels(),
        *keywords,
        transposed,
        *step_changes(),
        *named,
        *variants,
    )
