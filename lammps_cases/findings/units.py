"""Findings about systems of units."""

from __future__ import annotations

from typing import Any

from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.state import Gradients
from eos_ref.model.units import UNITS, Units
from eos_ref.numbers.number import Array
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import ModelFinding
from lammps_cases.findings.variants import Variant
from lammps_cases.findings.virials import OVERALL


class UnitsUnconverted(Simulation):
    """All numbers are taken as they are, except the force over mass of a time step."""

    def conversion(self) -> Units:
        """Return units without factors."""
        return UNITS["lj"]

    def acceleration(self) -> Array:
        """Return force over mass times the factor of forces."""
        return super().acceleration() * self.system.of("f")

    def virial_of_all(self) -> Array:
        """Return the virial of forces taken for energies over lengths."""
        return super().virial_of_all() * self.system.of("f")

    def output(self, field: str) -> Any:
        """Return virials in units of pressure, and all else without factors."""
        values = super().output(field)
        if field == "stress/atom":
            values = values * self.system.of("f")
        return values / self.system.of(field) if field in (*OVERALL, "stress/atom") else values


class DensityByForceFactor(Simulation):
    """Rates of density are integrated with the time step times the factor of forces."""

    def _continuity(self, dt: float, drho_n: Array, gradient: Gradients) -> None:
        super()._continuity(dt * self.system.of("f"), drho_n, gradient)


def has_own_units(problem: Problem) -> bool:
    """Return whether energies, pressures and densities have units of their own."""
    return not UNITS[problem.model.units].consistent


def integrates_density(problem: Problem) -> bool:
    """Return whether, in such units, time steps change densities."""
    return has_own_units(problem) and problem.steps[-1] > 0 and not problem.model.fix.rho_sum


UNITS_UNCONVERTED = ModelFinding(
    **document("units-unconverted"),
    variant=Variant(has_own_units, stepping=UnitsUnconverted),
    acts=lambda setting: has_own_units(setting.problem),
)


DENSITY_BY_FORCE_FACTOR = ModelFinding(
    **document("density-by-force-factor"),
    variant=Variant(integrates_density, stepping=DensityByForceFactor),
    acts=lambda setting: integrates_density(setting.problem),
)

ENTRIES = (UNITS_UNCONVERTED, DENSITY_BY_FORCE_FACTOR)
