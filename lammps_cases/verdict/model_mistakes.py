"""Plausible mistakes in the particle model, to find out what a scene can tell apart.

Each is a variant of the reference's stages, with the quantities that it changes. A mistake whose quantities a scene
compares, and which leaves every field of its first evaluation within the bound, goes unseen there: the lint says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.blocks import in_blocks
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases.comparison.compare import excess
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.thermal import HeatOverDensity, TemperatureWithoutMass
from lammps_cases.findings.walls import WallVelocityLost


class _UnitMasses(ArrayEvaluator):
    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.mass_n = np.ones(self.n)

    def weigh(self, mass_n: FloatArray) -> None:
        """Ignore masses of the particles' own, too."""


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


@dataclass(frozen=True)
class ModelMutant:
    """A mistake: the stages that make it, and the quantities it changes in a scene that it applies to."""

    stages: type[ArrayEvaluator]
    changes: tuple[str, ...]
    needs_walls: bool = False


MUTANTS: dict[str, ModelMutant] = {
    "masses ignored": ModelMutant(_UnitMasses, ("grad/v", "f", "heatflow", "rho")),
    "rho0 for rho in volumes": ModelMutant(_EquilibriumVolumes, ("grad/v", "f", "heatflow")),
    "V_i for V_j": ModelMutant(_OwnVolumes, ("grad/v", "f", "heatflow")),
    "no volume in the force": ModelMutant(ForcePerVolume, ("f",)),
    "arithmetic for harmonic mean, or the reverse": ModelMutant(_OtherMean, ("f", "heatflow")),
    "speed of sound ignored in artificial viscosity": ModelMutant(_UnitSoundSpeed, ("artificial",)),
    "rho0 ignored in density diffusion": ModelMutant(_UnitDensity, ("drho",)),
    "no-slip extrapolation ignored": ModelMutant(_NoSlipIgnored, ("grad/v", "f"), needs_walls=True),
    "velocity of walls lost": ModelMutant(WallVelocityLost, ("moving walls",), needs_walls=True),
    "no lower limit to the density of walls": ModelMutant(_ThinWalls, ("f",), needs_walls=True),
    "temperature of the whole energy": ModelMutant(TemperatureWithoutMass, ("temperature",)),
    "heat divided by the density": ModelMutant(HeatOverDensity, ("heatflow",)),
    "one conductivity for all types": ModelMutant(_MostConductive, ("heatflow",)),
}


def unseen_in_model(problem: Problem, prediction: Prediction) -> list[str]:
    """Return the mistakes that the first evaluation of a scene does not show although it compares what they change."""
    compared = set(shown(problem))
    walls = problem.model.fix.interface_reconstruct and bool(problem.state.solid_n.any())
    return [
        name
        for name, mutant in MUTANTS.items()
        if compared & set(mutant.changes) and (walls or not mutant.needs_walls) and blind(problem, prediction, mutant)
    ]


def shown(problem: Problem) -> Iterator[str]:
    """Return the quantities that a scene compares in a way that a mistake in them could show."""
    model, state = problem.model, problem.state
    several = len(set(state.type_n[~state.solid_n].tolist())) > 1
    for name in problem.fields:
        if name == "rho" and not model.fix.rho_sum:
            continue
        if name == "drho" and (not model.pair.rho_damp or model.corrects_gradients or not several):
            continue  # rho0 of a single type cancels, and RK1 and RK2 do without
        yield name
    if "f" in problem.fields and model.pair.artificial_viscosity:
        yield "artificial"
    if "grad/v" in problem.fields and np.any(state.v_nc[state.solid_n]):
        yield "moving walls"


def blind(problem: Problem, prediction: Prediction, mutant: ModelMutant) -> bool:
    """Return whether the first evaluation with a mistake is within the bounds of the one without."""
    stages = in_blocks(mutant.stages, len(problem.state.x_nc))
    sim: Simulation = problem.simulation(stages)
    with np.errstate(all="ignore"):
        sim.setup()
        for field in problem.fields:
            reference_n, bound_n = np.broadcast_arrays(prediction.fields[0][field], prediction.bounds[0][field])
            if not np.all(excess(sim.output(field), reference_n, bound_n)[1] <= 1):
                return False
    return True
