"""Plausible mistakes in a law or in the particle model, to find out what a scene can distinguish.

A mistake in a law takes the laws and the state and returns the pressure of the mistaken formula, or None if the scene
has nothing that the mistake could change. One in the model is a variant of the reference's stages, with the
quantities that it changes: it goes undetected where a scene compares these and every field of its first evaluation
stays within the bound. The lint names the mistakes that a scene cannot distinguish; tests insert them to prove that
some case detects each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref import EOS, EOSTable
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.blocks import in_blocks
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases.comparison.compare import EosState, evaluate, excess
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.thermal import HeatOverDensity, TemperatureWithoutMass
from lammps_cases.findings.walls import WallVelocityLost

Mutant = Callable[[EOSTable, EosState], FloatArray | None]


def _each_law(change: Callable[[EOS], EOS | None]) -> Mutant:
    """Return a mistake in the parameters of the laws it applies to."""

    def mutant(table: EOSTable, state: EosState) -> FloatArray | None:
        changed = [change(law) for law in table.laws]
        if all(law is None for law in changed):
            return None
        laws = tuple(new or old for new, old in zip(changed, table.laws, strict=True))
        return evaluate(EOSTable(laws), state)

    return mutant


def _with_cs(law: EOS, cs: float) -> EOS | None:
    return None if law.needs_energy else replace(law, cs=cs)


def _with_rho0(law: EOS, rho0: float) -> EOS | None:
    return None if law.needs_energy else replace(law, rho0=rho0)


def _as_linear(law: EOS) -> EOS | None:
    linear = EOS("linear", law.rho0, law.cs, None, law.background)
    return None if law.needs_energy or law == linear or law.exponent == 1 else linear


def _exchanged_types(table: EOSTable, state: EosState) -> FloatArray | None:
    if len(table) == 1:
        return None
    rolled = EOSTable((*table.laws[1:], table.laws[0]))
    if rolled.needs_energy and state.e_n is None:
        return None
    return evaluate(rolled, state)


def _energy_of_particle(table: EOSTable, state: EosState) -> FloatArray | None:
    if not table.needs_energy or state.energy_n is None:
        return None
    return evaluate(table, replace(state, mass_n=np.ones_like(state.mass_n)))


def _float32_density(table: EOSTable, state: EosState) -> FloatArray | None:
    return evaluate(table, replace(state, rho_n=state.rho_n.astype(np.float32).astype(float)))


def _float32_pressure(table: EOSTable, state: EosState) -> FloatArray | None:
    p_n = evaluate(table, state)
    with np.errstate(over="ignore"):
        return p_n.astype(np.float32).astype(float)


def _sign(table: EOSTable, state: EosState) -> FloatArray | None:
    return -evaluate(table, state)


LAW_MUTANTS: dict[str, Mutant] = {
    "cs instead of cs^2": _each_law(lambda law: _with_cs(law, law.cs**0.5)),
    "cs ignored": _each_law(lambda law: _with_cs(law, 1.0)),
    "rho0 ignored": _each_law(lambda law: _with_rho0(law, 1.0)),
    "rho0 and cs exchanged": _each_law(
        lambda law: None if law.needs_energy else replace(law, rho0=law.cs, cs=law.rho0)
    ),
    "cs off by 1e-6": _each_law(lambda law: _with_cs(law, law.cs * (1 + 1e-6))),
    "sign of the pressure": _sign,
    "background dropped": _each_law(lambda law: replace(law, background=0.0) if law.background else None),
    "background subtracted": _each_law(
        lambda law: replace(law, background=-law.background) if law.background else None
    ),
    "A3 dropped": _each_law(
        lambda law: replace(law, parameter=0.0) if law.law.parameter == "A3" and law.parameter else None
    ),
    "A3 of the wrong sign": _each_law(
        lambda law: replace(law, parameter=-law.parameter) if law.law.parameter == "A3" and law.parameter else None
    ),
    "exponent 7 for every Tait law": _each_law(
        lambda law: replace(law, parameter=7.0) if law.exponent is not None and law.parameter is not None else None
    ),
    "exponent off by one": _each_law(
        lambda law: (
            None
            if law.exponent is None
            else EOS("tait/general", law.rho0, law.cs, law.exponent + 1 or 0.5, law.background)
        )
    ),
    "linear instead of Tait or cubic": _each_law(_as_linear),
    "gamma instead of gamma - 1": _each_law(
        lambda law: replace(law, parameter=law.gamma + 1) if law.needs_energy and law.law.parameter == "gamma" else None
    ),
    "energy not per unit mass": _energy_of_particle,
    "types exchanged": _exchanged_types,
    "density in float32": _float32_density,
    "pressure in float32": _float32_pressure,
}


def undetected_in_laws(table: EOSTable, state: EosState, reference_n: FloatArray, bound_n: FloatArray) -> list[str]:
    """Return the names of the mistakes that stay within the bound on every particle, undetectable in the scene."""
    blind = []
    for name, mutant in LAW_MUTANTS.items():
        with np.errstate(all="ignore"):
            p_n = mutant(table, state)
            if p_n is not None and bool(np.all(excess(p_n, reference_n, bound_n)[1] <= 1)):
                blind.append(name)
    return blind


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


@dataclass(frozen=True)
class ModelMutant:
    """A mistake: the stages that make it, and the quantities it changes in a scene that it applies to."""

    stages: type[ArrayEvaluator]
    changes: tuple[str, ...]
    needs_walls: bool = False


MODEL_MUTANTS: dict[str, ModelMutant] = {
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


def undetected_in_model(problem: Problem, prediction: Prediction) -> list[str]:
    """Return the mistakes invisible in the first evaluation of a scene that compares the quantities they change."""
    compared = set(shown(problem))
    walls = problem.model.fix.interface_reconstruct and bool(problem.state.solid_n.any())
    return [
        name
        for name, mutant in MODEL_MUTANTS.items()
        if compared & set(mutant.changes)
        and (walls or not mutant.needs_walls)
        and cannot_distinguish(problem, prediction, mutant)
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


def cannot_distinguish(problem: Problem, prediction: Prediction, mutant: ModelMutant) -> bool:
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
