"""Plausible mistakes in a law or in the particle model, to find out what a scene can distinguish.

They are the changes of the catalogue (`lammps_cases.scene.changes`) whose role is *mistake*. The report names those
that a scene cannot distinguish: in a law if they stay within the bound on every particle; in the model, where a scene
compares the quantities that they change, if every field of its first evaluation does.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from eos_ref import EOSTable
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.numbers.number import Array
from lammps_cases.comparison.changed import fields, pressure
from lammps_cases.comparison.compare import EosState, excess
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.thermal import HeatOverDensity, TemperatureWithoutMass
from lammps_cases.findings.walls import WallVelocityLost
from lammps_cases.scene.changes import Change, catalogue


class _UnitMasses(ArrayEvaluator):
    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.mass_n = np.ones(self.n)

    def weigh(self, mass_n: FloatArray) -> None:
        """Also ignore the particles' own masses."""


class _UnitDensity(ArrayEvaluator):
    """Equilibrium densities other than the law's own."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.rho0_n = np.ones(self.n)


class _EquilibriumVolumes(ArrayEvaluator):
    def density_pair(self, rho_n: Array) -> tuple[Array, Array]:
        rho0_n = 0 * rho_n + self.rho0_n
        return rho0_n[self.i], rho0_n[self.j]


class _OwnVolumes(ArrayEvaluator):
    def density_pair(self, rho_n: Array) -> tuple[Array, Array]:
        rho_i, _ = super().density_pair(rho_n)
        return rho_i, rho_i * (self.mass_n[self.j] / self.mass_n[self.i])


class _OtherMean(ArrayEvaluator):
    def __init__(self, model: Any, *arguments: Any) -> None:
        pair = replace(model.pair, harmonic_means=not model.pair.harmonic_means)
        super().__init__(replace(model, pair=pair), *arguments)


class _UnitSoundSpeed(ArrayEvaluator):
    def sound_speed(self, energy_n: Array | None = None) -> Array:
        return np.ones(self.n)


class _NoSlipIgnored(ArrayEvaluator):
    def wall_velocity(self, v_solid: Array, v_fluid: Array, ratio: Array) -> Array:
        return v_solid


class _ThinWalls(ArrayEvaluator):
    def apparent_density(self, rho_n: Array) -> Array:
        return rho_n


class _MostConductive(ArrayEvaluator):
    def conduction(self) -> Any:
        return 0 * super().conduction() + super().conduction().max()


# Classes, not edits: every case of a run evaluates them, in compiled loops where it has particles for these.
_STAGES = {
    "lint-masses-ignored": _UnitMasses,
    "lint-rho0-for-rho-in-volumes": _EquilibriumVolumes,
    "lint-v-i-for-v-j": _OwnVolumes,
    "lint-no-volume-in-the-force": ForcePerVolume,
    "lint-arithmetic-for-harmonic-mean-or-the-reverse": _OtherMean,
    "lint-speed-of-sound-ignored-in-artificial-viscosity": _UnitSoundSpeed,
    "lint-rho0-ignored-in-density-diffusion": _UnitDensity,
    "lint-no-slip-extrapolation-ignored": _NoSlipIgnored,
    "lint-velocity-of-walls-lost": WallVelocityLost,
    "lint-no-lower-limit-to-the-density-of-walls": _ThinWalls,
    "lint-temperature-of-the-whole-energy": TemperatureWithoutMass,
    "lint-heat-divided-by-the-density": HeatOverDensity,
    "lint-one-conductivity-for-all-types": _MostConductive,
}


@cache
def changes() -> dict[str, Change]:
    """Return the catalogue of changes, with the stages of those that are classes."""
    return {name: replace(change, stages=_STAGES.get(name)) for name, change in catalogue().items()}


def _mistakes(in_model: bool) -> list[Change]:
    return [each for each in changes().values() if each.role == "mistake" and bool(each.stages) == in_model]


def undetected_in_laws(table: EOSTable, state: EosState, reference_n: FloatArray, bound_n: FloatArray) -> list[str]:
    """Return the names of the mistakes that stay within the bound on every particle, undetectable in the scene."""
    blind = []
    for mistake in _mistakes(in_model=False):
        with np.errstate(all="ignore"):
            p_n = pressure(mistake, table, state)
            if p_n is not None and bool(np.all(excess(p_n, reference_n, bound_n)[1] <= 1)):
                blind.append(mistake.what)
    return blind


def undetected_in_model(problem: Problem, prediction: Prediction) -> list[str]:
    """Return the mistakes invisible in the first evaluation of a scene that compares the quantities they change."""
    compared = set(shown(problem))
    walls = problem.model.fix.interface_reconstruct and bool(problem.state.solid_n.any())
    return [
        mistake.what
        for mistake in _mistakes(in_model=True)
        if compared & set(mistake.shows)
        and (walls or not mistake.walls)
        and cannot_distinguish(problem, prediction, mistake)
    ]


def shown(problem: Problem) -> Iterator[str]:
    """Return the quantities that a scene compares in a way that a mistake in them could show."""
    model, state = problem.model, problem.state
    several = len(set(state.type_n[~state.solid_n].tolist())) > 1
    for name in problem.fields:
        if name == "rho" and not model.fix.rho_sum:
            continue
        if name == "drho" and (not model.pair.rho_damp or model.corrects_gradients or not several):
            continue  # rho0 of a single type cancels, and RK1 and RK2 do not use it
        yield name
    if "f" in problem.fields and model.pair.artificial_viscosity:
        yield "artificial"
    if "grad/v" in problem.fields and np.any(state.v_nc[state.solid_n]):
        yield "moving walls"


def cannot_distinguish(problem: Problem, prediction: Prediction, change: Change) -> bool:
    """Return whether the first evaluation with a change is within the bounds of the one without."""
    with np.errstate(all="ignore"), closing(fields(replace(problem, stops=()), [change])) as changed:
        for field, values in next(changed).items():
            reference_n, bound_n = np.broadcast_arrays(prediction.fields[0][field], prediction.bounds[0][field])
            if not np.all(excess(values, reference_n, bound_n)[1] <= 1):
                return False
    return True
