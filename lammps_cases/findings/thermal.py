"""Findings about heat and temperature."""

from __future__ import annotations

from typing import Any

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.numbers.number import Array
from lammps_cases.comparison.trajectory import Problem
from lammps_cases.findings.entry import Finding
from lammps_cases.findings.variants import Variant


class HeatAsTemperatureRate(ArrayEvaluator):
    """The heat flow is that of the diffusivity kappa/(rho0 cv), without the volume of the particle heated."""

    def heated_volume(self, rho_i: Array, rho_j: Array) -> Array:
        """No volume."""
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


HEAT_IS_TEMPERATURE_RATE = Finding(
    id="heat-is-temperature-rate",
    number=19,
    title="The heat flow is a rate of temperature that is added to the energy",
    severity="high",
    effect="Temperatures even out at a wrong rate, about 1/(m cv) times the right one",
    documented="fix rheo/thermal: conductivity in power/(length temperature); Cleary & Monaghan 1999: the energy "
    "of a particle changes by sum 2 kappa V_i V_j (T_i - T_j) (x.grad W)/r^2.",
    observed="Since 2025.7.22.2.0 the output heatflow is sum 2 D V_j (T_i - T_j) (x.grad W)/r^2 with D the mean "
    "of kappa/(rho0 cv): the rate of T at the equilibrium density, without V_i. It is then integrated as if it were "
    "the rate of the energy of the particle, which is m cv times larger.",
    argument="Two particles of masses 2 and 3 and temperatures 2 and 1 at distance 1 (2D, cutoff 3; rho, rho0, cv and "
    "kappa are 1) exchange -1.398 and +0.932 in place of -2.797 and +2.797: where m cv = 2 heat flows half as fast as "
    "the conductivity says, and energy is not conserved.",
    workaround="Give the conductivity times m cv, with the same m/rho0 for every type; the factor rho/rho0 remains.",
    scene="two particles of different temperature and volume, cv other than 1",
    model_variant=Variant(has_heat, HeatAsTemperatureRate),
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
    observed="Every term of the sum is divided by (rho_i + rho_j)/2. From 2025.7.22.2.0 on the heat flow is "
    "another one (heat-is-temperature-rate).",
    argument="The flow between two particles of density 1.5 is 2/3 of what the conductivity says; the unit of the "
    "result is power over density. At the density of water in SI units, 1000, heat flows a thousand times too slowly.",
    workaround="Give the conductivity times rho0, with the same rho0 for every type; the factor rho0 over the mean "
    "density of the pair remains.",
    scene="two particles of different temperature and a density other than 1",
    model_variant=Variant(has_heat, HeatOverDensity),
)


TEMPERATURE_WITHOUT_MASS = Finding(
    id="temperature-without-mass",
    number=21,
    title="The temperature is taken from the energy of the particle, not per mass",
    severity="high",
    effect="Temperatures are the particle's mass times too large",
    documented="fix rheo/thermal: specific heat in energy/(mass temperature), so T = E/(m cv) for the energy E "
    "of a particle.",
    observed="T = E/cv, while the heat flow changes E and ideal/gas takes E/m for the energy per mass. From "
    "2025.7.22.2.0 on T = E/(m cv).",
    argument="Two particles of masses 2 and 3 with energies 2 and 1 and cv = 1 have T = 1 and 1/3; LAMMPS "
    "reports 2 and 1. The temperature depends on how finely the fluid is resolved: with a quarter of the mass and of "
    "the energy per particle it is a quarter.",
    workaround="Give the specific heat times the mass of a particle, or use 2025.7.22.2.0 or newer.",
    scene="one particle of mass other than 1",
    model_variant=Variant(has_heat, TemperatureWithoutMass),
)

ENTRIES = (HEAT_IS_TEMPERATURE_RATE, HEAT_OVER_DENSITY, TEMPERATURE_WITHOUT_MASS)
