r"""LAMMPS' systems of units: what quantities are measured in, and by which factor that differs from consistent numbers.

In lj, si, cgs, micro and nano every quantity is measured in products of the units of length, mass and time. In real
(Angstrom, g/mol, fs) and metal (Angstrom, g/mol, ps) energies are in kcal/mol or eV, pressures in atm or bar, densities
in g/cm^3, viscosities in Poise. By the manual (command units) the choice only sets conversion factors: a simulation can
be duplicated in every system. The digits of the factors are LAMMPS' own (NUMERICS.md, section 8).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

UnitStyle = Literal["lj", "si", "real", "metal", "cgs", "micro", "nano"]
Kind = Literal["energy", "pressure", "density", "viscosity"]

# The unit that LAMMPS measures a quantity or an input in, if the system has one of its own. Forces, heat flows,
# conductivities, specific heats and the acceleration of fix gravity (force/mass) are in that of energy.
KINDS: dict[Kind, tuple[str, ...]] = {
    "energy": ("f", "energy", "grad/energy", "heatflow", "conductivity", "cv", "latent heat", "acceleration"),
    "pressure": ("pressure", "pressure_used", "stress/v", "stress/t", "stress/atom", "virial", "press"),
    "density": ("rho", "rho_wall", "drho", "grad/rho"),
    "viscosity": ("viscosity",),
}
KIND_OF = {name: kind for kind, names in KINDS.items() for name in names}


@dataclass(frozen=True)
class Units:
    """A system of units.

    Attributes
    ----------
    length, mass, time : its base units in SI units; lj's may have any size, so one is chosen
    energy, pressure, density, viscosity : its units of these in products of its base units, in 3D
    """

    length: float
    mass: float
    time: float
    energy: float = 1.0
    pressure: float = 1.0
    density: float = 1.0
    viscosity: float = 1.0

    @property
    def consistent(self) -> bool:
        """Return whether all quantities are measured in products of the base units."""
        return (self.energy, self.pressure, self.density, self.viscosity) == (1.0, 1.0, 1.0, 1.0)

    def of(self, quantity: str) -> float:
        """Return the factor that turns LAMMPS' number of a quantity or an input into a consistent one."""
        if quantity == "A3":
            return 1 / self.density**2  # as the formula has it
        return float(getattr(self, KIND_OF[quantity])) if quantity in KIND_OF else 1.0


ATOMIC_MASS = 1.66053892e-27  # kg, of 1 g/mol
_REAL = 1 / 48.88821291**2  # kcal/mol in g/mol Angstrom^2/fs^2
_METAL = 1 / 1.0364269e-4  # eV in g/mol Angstrom^2/ps^2
_GRAM = 0.602214129  # g/cm^3 in g/mol/Angstrom^3
UNITS: dict[str, Units] = {
    "lj": Units(1e-3, 1e-6, 1e-3),
    "si": Units(1.0, 1.0, 1.0),
    "real": Units(1e-10, ATOMIC_MASS, 1e-15, _REAL, _REAL / 68568.415, _GRAM, _REAL * 14393.264316),
    "metal": Units(1e-10, ATOMIC_MASS, 1e-12, _METAL, _METAL / 1.6021765e6, _GRAM, _METAL * 0.6241509647),
    "cgs": Units(1e-2, 1e-3, 1.0),
    "micro": Units(1e-6, 1e-15, 1e-6),
    "nano": Units(1e-9, 1e-21, 1e-9),
}
