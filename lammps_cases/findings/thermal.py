"""Findings about heat and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.parameters import IntArray
from eos_ref.numbers.number import Array
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import Gap, ModelFinding, multiplied
from lammps_cases.findings.variants import Variant


class HeatAsTemperatureRate(ArrayEvaluator):
    """The heat flow is that of the diffusivity kappa/(rho0 cv), without the volume of the particle heated."""

    def heated_volume(self, rho_i: Array, rho_j: Array) -> Array:
        """Return no volume."""
        return 0 * rho_i + 1.0

    def conduction(self) -> Any:
        """Return the thermal diffusivity at the equilibrium density."""
        assert self.model.thermal is not None
        cv_n = self.of_type(p.specific_heat for p in self.model.thermal)
        return super().conduction() / (self.rho0_n * cv_n)


class HeatOverDensity(ArrayEvaluator):
    """The heat flow of a pair is divided by its mean density."""

    def heated_volume(self, rho_i: Array, rho_j: Array) -> Array:
        """Return the volume over the mean density."""
        return super().heated_volume(rho_i, rho_j) / (0.5 * (rho_i + rho_j))


class TemperatureWithoutMass(ArrayEvaluator):
    """The temperature is that of the particle's energy, not of its energy per unit mass."""

    def specific_energy(self, energy_n: Array) -> Array:
        """Return the energy as it is stored, (n,)."""
        return energy_n


def has_heat(problem: Problem) -> bool:
    """Return whether heat is conducted."""
    return problem.model.thermal is not None


def heated_masses(problem: Problem) -> Sequence[float]:
    """Return the masses by type, if all particles of each type have one mass and have temperatures."""
    return problem.model.mass_t if has_heat(problem) and problem.state.mass_n is None else ()


def heat_factors(problem: Problem) -> list[float]:
    """Return 1/(m cv) by type, 1 where no heat is conducted."""
    types = zip(heated_masses(problem), problem.model.thermal or (), strict=False)
    return [1 / (m * of.specific_heat) if of.conductivity else 1.0 for m, of in types]


def density_factors(problem: Problem) -> list[float]:
    """Return 1/rho0 by type, 1 where no heat is conducted."""
    types = zip(problem.model.eos.laws, problem.model.thermal or (), strict=False)
    return [1 / law.rho0 if of.conductivity else 1.0 for law, of in types]


HEAT_IS_TEMPERATURE_RATE = ModelFinding(
    **document("heat-is-temperature-rate"),
    variant=Variant(has_heat, HeatAsTemperatureRate, changes=("heatflow",)),
    acts=lambda setting: multiplied("heat flows", heat_factors(setting.problem)),
    replaces=("heated_volume",),
)


HEAT_OVER_DENSITY = ModelFinding(
    **document("heat-over-density"),
    variant=Variant(has_heat, HeatOverDensity, changes=("heatflow",)),
    acts=lambda setting: multiplied("heat flows", density_factors(setting.problem)),
)


TEMPERATURE_WITHOUT_MASS = ModelFinding(
    **document("temperature-without-mass"),
    variant=Variant(has_heat, TemperatureWithoutMass),
    acts=lambda setting: multiplied("temperatures", heated_masses(setting.problem)),
)


class EnergyByType(ArrayEvaluator):
    """Stages that compute the energy per mass of a gas with the mass of its type."""

    def by_type(self, energy_n: Array | None) -> Array | None:
        """Return the energies that, over the particles' masses, equal the energies over the masses of their types."""
        return None if energy_n is None else energy_n * (self.mass_n / self.of_type(self.model.mass))


class GasOfType(EnergyByType):
    """The pressure of a gas, and the density of a wall, use that energy."""

    def pressure(self, rho_n: Array, energy_n: Array | None = None) -> Array:
        """Return the pressures, with that energy."""
        return super().pressure(rho_n, self.by_type(energy_n))

    def wall_density(self, at: IntArray, p: Array, energy_n: Array | None) -> Array:
        """Return the densities of solids, with that energy."""
        return super().wall_density(at, p, self.by_type(energy_n))


class SoundOfType(EnergyByType):
    """The speed of sound of a gas uses that energy."""

    def sound_speed(self, energy_n: Array | None = None) -> Array:
        """Return the speeds of sound, with that energy."""
        return super().sound_speed(self.by_type(energy_n))


def has_gas_of_masses(problem: Problem) -> bool:
    """Return whether particles of a gas have masses other than those of their types."""
    model, state = problem.model, problem.state
    gas_n = np.array([law.needs_energy for law in model.eos])[state.type_n - 1]
    return state.mass_n is not None and bool((gas_n & (state.mass_n != model.mass[state.type_n - 1])).any())


def has_sound_of_masses(problem: Problem) -> bool:
    """Return whether the speed of sound of such particles is used: in artificial viscosity and repulsion by walls."""
    model = problem.model
    return has_gas_of_masses(problem) and (bool(model.pair.artificial_viscosity) or model.fix.interface_reconstruct)


GAS_OF_MASS_OF_TYPE = ModelFinding(
    **document("gas-of-mass-of-type"),
    gaps=(
        Gap(
            lambda scene: (
                not scene.whole_model and bool(scene.mass) and any(law.needs_energy for law in scene.pressure)
            ),
            "for an equation of state alone, the law is evaluated with the per-particle masses",
        ),
    ),
    variant=Variant(has_gas_of_masses, GasOfType, changes=("pressure",)),
)

SOUND_OF_MASS_OF_TYPE = ModelFinding(
    **document("sound-of-mass-of-type"),
    variant=Variant(has_sound_of_masses, SoundOfType),
)

ENTRIES = (
    HEAT_IS_TEMPERATURE_RATE,
    HEAT_OVER_DENSITY,
    TEMPERATURE_WITHOUT_MASS,
    GAS_OF_MASS_OF_TYPE,
    SOUND_OF_MASS_OF_TYPE,
)
