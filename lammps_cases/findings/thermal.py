"""Findings about heat and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.parameters import IntArray
from eos_ref.numbers.number import Array
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.entry import Finding, Gap, multiplied
from lammps_cases.findings.variants import Variant


class HeatAsTemperatureRate(ArrayEvaluator):
    """The heat flow is that of the diffusivity kappa/(rho0 cv), without the volume of the particle heated."""

    def heated_volume(self, rho_i: Array, rho_j: Array) -> Array:
        """Return no volume."""
        return 0 * rho_i + 1.0

    def conduction(self) -> Any:
        """Thermal diffusivity at the equilibrium density."""
        assert self.model.thermal is not None
        cv_n = self.of_type(p.specific_heat for p in self.model.thermal)
        return super().conduction() / (self.rho0_n * cv_n)


class HeatOverDensity(ArrayEvaluator):
    """The heat flow of a pair is divided by its mean density."""

    def heated_volume(self, rho_i: Array, rho_j: Array) -> Array:
        """Volume over the mean density."""
        return super().heated_volume(rho_i, rho_j) / (0.5 * (rho_i + rho_j))


class TemperatureWithoutMass(ArrayEvaluator):
    """The temperature is that of the energy of the particle, not per unit mass."""

    def specific_energy(self, energy_n: Array) -> Array:
        """Return the energy as it is stored, (n,)."""
        return energy_n


def has_heat(problem: Problem) -> bool:
    """Return whether heat is conducted."""
    return problem.model.thermal is not None


def heated_masses(problem: Problem) -> Sequence[float]:
    """Return the masses by type, if particles of a type have one mass and a temperature."""
    return problem.model.mass_t if has_heat(problem) and problem.state.mass_n is None else ()


def heat_factors(problem: Problem) -> list[float]:
    """Return 1/(m cv) by type, 1 where no heat is conducted."""
    types = zip(heated_masses(problem), problem.model.thermal or (), strict=False)
    return [1 / (m * of.specific_heat) if of.conductivity else 1.0 for m, of in types]


def density_factors(problem: Problem) -> list[float]:
    """Return 1/rho0 by type, 1 where no heat is conducted."""
    types = zip(problem.model.eos.laws, problem.model.thermal or (), strict=False)
    return [1 / law.rho0 if of.conductivity else 1.0 for law, of in types]


HEAT_IS_TEMPERATURE_RATE = Finding(
    id="heat-is-temperature-rate",
    number=19,
    title="The heat flow is a rate of temperature, but is added to the energy",
    severity="high",
    effect="Temperatures equalise at a wrong rate, about 1/(m cv) times the right one",
    documented="fix rheo/thermal: conductivity in power/(length temperature); Cleary & Monaghan 1999: the energy "
    "of a particle changes by sum 2 kappa V_i V_j (T_i - T_j) (x.grad W)/r^2.",
    observed="Since 2025.7.22.2.0 the output heatflow is sum 2 D V_j (T_i - T_j) (x.grad W)/r^2 with D the mean of "
    "kappa/(rho0 cv): the rate of T at the equilibrium density, without V_i. It is then integrated as if it were the "
    "rate of the particle's energy, which is m cv times larger.",
    argument="Two particles of masses 2 and 3 and temperatures 2 and 1 at distance 1 (2D, cutoff 3; rho, rho0, cv "
    "and kappa are 1) exchange -1.398 and +0.932 instead of -2.797 and +2.797: where m cv = 2 heat flows half as "
    "fast as the conductivity implies, and energy is not conserved.",
    workaround="Multiply the conductivity by m cv, with the same m/rho0 for every type; the factor rho/rho0 remains.",
    scene="two particles of different temperature and volume, cv different from 1",
    model_variant=Variant(has_heat, HeatAsTemperatureRate, changes=("heatflow",)),
    acts=lambda setting: multiplied("heat flows", heat_factors(setting.problem)),
    replaces=("heated_volume",),
)


HEAT_OVER_DENSITY = Finding(
    id="heat-over-density",
    number=20,
    title="The heat flow of a pair is divided by its mean density",
    severity="high",
    effect="Heat flows 1/rho times as fast as it should",
    documented="fix rheo/thermal: conductivity in power/(length temperature); Cleary & Monaghan 1999: the energy "
    "of a particle changes by sum 2 kappa V_i V_j (T_i - T_j) (x.grad W)/r^2.",
    observed="Every term of the sum is divided by (rho_i + rho_j)/2. From 2025.7.22.2.0 on the heat flow is wrong in "
    "another way (heat-is-temperature-rate).",
    argument="The flow between two particles of density 1.5 is 2/3 of what the conductivity implies; the unit of the "
    "result is power over density. At the density of water in SI units, 1000, heat flows a thousand times too slowly.",
    workaround="Multiply the conductivity by rho0, with the same rho0 for every type; the factor rho0 over the mean "
    "density of the pair remains.",
    scene="two particles of different temperature and a density different from 1",
    model_variant=Variant(has_heat, HeatOverDensity, changes=("heatflow",)),
    acts=lambda setting: multiplied("heat flows", density_factors(setting.problem)),
)


TEMPERATURE_WITHOUT_MASS = Finding(
    id="temperature-without-mass",
    number=21,
    title="The temperature is computed from the energy of the particle, not from its energy per mass",
    severity="high",
    effect="Temperatures are too large by a factor of the particle's mass",
    documented="fix rheo/thermal: specific heat in energy/(mass temperature), so T = E/(m cv) for the energy E "
    "of a particle.",
    observed="T = E/cv, while the heat flow changes E and ideal/gas uses E/m as the energy per mass. From "
    "2025.7.22.2.0 on T = E/(m cv).",
    argument="Two particles of masses 2 and 3 with energies 2 and 1 and cv = 1 have T = 1 and 1/3; LAMMPS reports 2 "
    "and 1. The temperature depends on how finely the fluid is resolved: with a quarter of the mass and energy per "
    "particle, it is a quarter.",
    workaround="Multiply the specific heat by the mass of a particle, or use 2025.7.22.2.0 or newer.",
    scene="one particle of a mass different from 1",
    model_variant=Variant(has_heat, TemperatureWithoutMass),
    acts=lambda setting: multiplied("temperatures", heated_masses(setting.problem)),
)


class EnergyByType(ArrayEvaluator):
    """What takes the energy per mass of a gas by the mass of its type."""

    def by_type(self, energy_n: Array | None) -> Array | None:
        """Return the energies that over the particles' masses are those over the masses of their types."""
        return None if energy_n is None else energy_n * (self.mass_n / self.of_type(self.model.mass))


class GasOfType(EnergyByType):
    """The pressure of a gas takes that energy, and so does the density of a wall."""

    def pressure(self, rho_n: Array, energy_n: Array | None = None) -> Array:
        """Return the pressures, with that energy."""
        return super().pressure(rho_n, self.by_type(energy_n))

    def wall_density(self, at: IntArray, p: Array, energy_n: Array | None) -> Array:
        """Return the densities of solids, with that energy."""
        return super().wall_density(at, p, self.by_type(energy_n))


class SoundOfType(EnergyByType):
    """The speed of sound of a gas takes that energy."""

    def sound_speed(self, energy_n: Array | None = None) -> Array:
        """Return the speeds of sound, with that energy."""
        return super().sound_speed(self.by_type(energy_n))


def has_gas_of_masses(problem: Problem) -> bool:
    """Return whether particles of a gas have masses other than those of their types."""
    model, state = problem.model, problem.state
    gas_n = np.array([law.needs_energy for law in model.eos])[state.type_n - 1]
    return state.mass_n is not None and bool((gas_n & (state.mass_n != model.mass[state.type_n - 1])).any())


def has_sound_of_masses(problem: Problem) -> bool:
    """Return whether the speed of sound of such particles shows: in artificial viscosity and repulsion by walls."""
    model = problem.model
    return has_gas_of_masses(problem) and (bool(model.pair.artificial_viscosity) or model.fix.interface_reconstruct)


GAS_OF_MASS_OF_TYPE = Finding(
    id="gas-of-mass-of-type",
    number=62,
    title="With per-particle masses, the pressure of an ideal gas uses the mass of the type",
    effect="Pressures of a gas are wrong by the ratio of rmass to the mass of the type",
    severity="medium",
    documented="fix rheo/pressure: P = (gamma - 1) rho e, where e is the internal energy per unit mass; fix "
    "property/atom: rmass gives every particle its own mass, which replaces that of its type.",
    observed="e is the energy of the particle over the mass of its type. From 2025.7.22.2.0 on it is the energy over "
    "the particle's own mass.",
    argument="A particle of mass 3 and energy 6 has 2 per unit mass, and at the density 1.4 with gamma = 1.4 the "
    "pressure 1.12; with the mass 2 for its type LAMMPS reports 1.68, and with 1 it reports 3.36, although no mass "
    "of the scene has changed.",
    workaround="Give particles of a gas the mass of their type, or use 2025.7.22.2.0 or newer.",
    scene="a gas particle whose rmass is not the mass of its type",
    gaps=(
        Gap(
            lambda scene: (
                not scene.whole_model and bool(scene.mass) and any(law.needs_energy for law in scene.pressure)
            ),
            "for an equation of state alone, the law is evaluated with the per-particle masses",
        ),
    ),
    model_variant=Variant(has_gas_of_masses, GasOfType, changes=("pressure",)),
)

SOUND_OF_MASS_OF_TYPE = Finding(
    id="sound-of-mass-of-type",
    number=63,
    title="With per-particle masses, the speed of sound of an ideal gas uses the mass of the type",
    effect="Artificial viscosity and walls of a gas are wrong if rmass is not the mass of the type",
    severity="low",
    documented="fix rheo/pressure: c is ignored by ideal/gas, whose speed of sound is not constant; fix "
    "property/atom: rmass gives every particle its own mass, which replaces that of its type.",
    observed="In artificial viscosity and in the repulsion by reconstructed walls the speed of sound of a gas is the "
    "square root of (gamma - 1) e, where e is the energy of the particle over the mass of its type.",
    argument="Two particles of mass 1, density 1 and energy 2 that approach each other at 1 (gamma = 1.4, distance 1, "
    "2D, cutoff 3, artificial/visc 1) push each other apart with 0.958 in LAMMPS where their type has the mass 4, and "
    "with 1.275 where it has the mass 1.",
    workaround="Give particles of a gas the mass of their type.",
    scene="two gas particles whose rmass is not the mass of their type, with artificial viscosity",
    model_variant=Variant(has_sound_of_masses, SoundOfType),
)

ENTRIES = (
    HEAT_IS_TEMPERATURE_RATE,
    HEAT_OVER_DENSITY,
    TEMPERATURE_WITHOUT_MASS,
    GAS_OF_MASS_OF_TYPE,
    SOUND_OF_MASS_OF_TYPE,
)
