"""Findings about systems of units."""

from __future__ import annotations

from typing import Any

from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.state import Gradients
from eos_ref.model.units import UNITS, Units
from eos_ref.numbers.number import Array
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.entry import Finding
from lammps_cases.findings.variants import Variant
from lammps_cases.findings.virials import OVERALL


class UnitsUnconverted(Simulation):
    """All numbers are taken as they are, but for the force over mass of a time step."""

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
    """Return whether energies, pressures and densities are in units of their own."""
    return not UNITS[problem.model.units].consistent


def integrates_density(problem: Problem) -> bool:
    """Return whether, in such units, time steps change densities."""
    return has_own_units(problem) and problem.steps[-1] > 0 and not problem.model.fix.rho_sum


UNITS_UNCONVERTED = Finding(
    id="units-unconverted",
    number=30,
    title="In units real and metal, only accelerations are converted",
    severity="high",
    effect="In units real and metal, pressures, forces, stresses and heat flows are wrong",
    documented="units: the choice sets conversion factors, and any simulation can be duplicated in any system; in "
    "real and metal densities are in g/cm^3 and viscosities in Poise, pressures in atm and bar, energies in kcal/mol "
    "and eV. fix rheo, fix rheo/pressure: values of density, speed/sound and background in the units of density, "
    "velocity and pressure; compute rheo/property/atom: values in the units of the attribute.",
    observed="All numbers are used as they stand. Volumes are m/rho in g/mol over g/cm^3, so gradients with the "
    "quintic kernel are 0.6022 times the right ones; pressures are c^2 (rho - rho0) in g/cm^3 times Angstrom^2/fs^2 "
    "or /ps^2, and a background in atm or bar is added to them; forces, stresses and heat flows follow from these. "
    "Only where a time step converts force over mass to an acceleration is a factor applied, 4.184e-4 in real and "
    "9649 in metal; the extrapolation to walls lacks it. LAMMPS' own virial computes treat these forces as energies "
    "over lengths, and convert them: compute stress/atom and compute pressure show 68568.415 times the number that "
    "follows from the forces in real, 1602176.5 times in metal.",
    argument="Water at 5 % above its density (1 g/cm^3, 0.015 Angstrom/fs) has a pressure of 1110 atm; LAMMPS "
    "reports 1.125e-5. In the same scene in units metal it reports 11.25 instead of 1125 bar. Pushed apart by this "
    "pressure, the particles accelerate by 2.52e-4 of what density and speed of sound imply in real, and by 5810 "
    "times that in metal, so sound travels at 0.0159 and 76.2 times the speed given (not counting the volumes of "
    "force-per-volume).",
    workaround="Use units lj, si, cgs, micro or nano, which need no conversion.",
    scene="compressed water in units real",
    model_variant=Variant(has_own_units, stepping=UnitsUnconverted),
    acts=lambda setting: has_own_units(setting.problem),
)


DENSITY_BY_FORCE_FACTOR = Finding(
    id="density-by-force-factor",
    number=31,
    title="In units real and metal, rates of density are multiplied by the conversion factor of forces",
    severity="high",
    effect="In units real densities change 2390 times too slowly, in metal 9649 times too fast",
    documented="fix rheo: densities are integrated with the rate of the equation of continuity, -rho div v, and that "
    "of rho/damp; units: any simulation can be duplicated in any system.",
    observed="The rate of density, damping included, is multiplied by the factor that converts force over mass to an "
    "acceleration: 4.184e-4 in real, 9649 in metal.",
    argument="A rate of density needs no factor: it has the unit of density over time in every system. Two particles "
    "of density 1 that approach each other with div v = -0.1/ns should be denser by 1e-4 after 0.001 ns; in real it "
    "is 4.184e-8, and in metal 0.965. In real, a fluid compressed to half its volume keeps its density and its "
    "pressure.",
    workaround="Use units lj, si, cgs, micro or nano. Summed densities (rho/sum) have no rates, but are 0.6022 times "
    "the right ones (units-unconverted).",
    scene="two particles approaching each other in units real",
    model_variant=Variant(integrates_density, stepping=DensityByForceFactor),
    acts=lambda setting: integrates_density(setting.problem),
)

ENTRIES = (UNITS_UNCONVERTED, DENSITY_BY_FORCE_FACTOR)
