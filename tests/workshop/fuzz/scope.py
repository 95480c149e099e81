"""Properties shared by all parts of a drawn scene: scales, dimension, types, keys that may be given."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from tests.workshop.fuzz.chance import Chance

Content = dict[str, Any]


@dataclass
class Scope:
    """One draw: its content so far, and the properties shared by its parts.

    Attributes
    ----------
    chance : stream of the draw
    content : keys of the scene drawn so far, in the order of the schema
    """

    chance: Chance
    content: Content = field(default_factory=dict)

    # --- size of the numbers: time steps, forces and rates follow from them

    @cached_property
    def scaled(self) -> bool:
        """Whether the numbers are far from 1."""
        return self.chance.at("scaled").coin(0.15)

    def _scale(self, name: str, low: float, high: float) -> float:
        chance = self.chance.at(f"scale {name}")
        return chance.number(1e-3, 1e3) if self.scaled else chance.number(low, high)

    @cached_property
    def spacing(self) -> float:
        """Distance of neighbours."""
        return self._scale("spacing", 0.5, 2.0)

    @cached_property
    def density(self) -> float:
        """Density of the first type; 1 where no type has one, which is LAMMPS' default."""
        return self._scale("density", 0.5, 2.0) if self.gives_rho0 else 1.0

    @cached_property
    def sound(self) -> float:
        """Speed of sound."""
        return self._scale("sound", 3.0, 20.0) if self.gives("cs") else 1.0

    @cached_property
    def cut(self) -> float:
        """Support of the kernel, in spacings."""
        return 3.0 if self.default_cut else self.chance.at("cut").between(1.4, 3.3 if self.planar else 2.4)

    @property
    def default_cut(self) -> bool:
        """Whether the cutoff is left to its default."""
        return self.chance.at("default cut").coin(0.3 if self.planar else 0.05)

    @property
    def h(self) -> float:
        """Smoothing length."""
        return self.cut * self.spacing / 3

    @property
    def acceleration(self) -> float:
        """Acceleration that changes velocities by the speed of sound over some ten smoothing lengths."""
        return 0.03 * self.sound**2 / self.h

    @cached_property
    def speed(self) -> float:
        """Size of the velocities."""
        return self.sound * self.chance.at("speed").number(1e-3, 0.2)

    @property
    def spatial(self) -> bool:
        """Whether there are three dimensions."""
        return self.gives("third axis", 0.4)

    @property
    def own_units(self) -> bool:
        """Whether energies are measured in units of their own (real, metal): in 3D, and with the whole model."""
        return self.content.get("units") in ("real", "metal")

    @property
    def gives_rho0(self) -> bool:
        """Whether types have densities; with units of their own, as the default of 1 would be another number."""
        return self.own_units or self.gives("rho0")

    # --- what other parts have to know

    def gives(self, key: str, probability: float = 0.85) -> bool:
        """Return whether a key is given that all types have or none, or that several parts depend on."""
        return self.chance.at(f"gives {key}").coin(probability)

    @property
    def thermal(self) -> bool:
        """Whether particles carry energy."""
        return self.gives("energy", 0.4)

    @property
    def sums(self) -> bool:
        """Whether densities are summed."""
        return self.gives("rho_sum", 0.3)

    @property
    def listed(self) -> bool:
        """Whether particles are given one by one."""
        return self.gives("positions one by one", 0.2)

    @property
    def whole(self) -> bool:
        """Whether the whole model is compared."""
        return self.gives("whole model", 0.9)

    @property
    def evolves(self) -> bool:
        """Whether time steps are taken."""
        return self.gives("evolve", 0.8)

    @property
    def stops(self) -> bool:
        """Whether a run ends and another begins; not with a twin."""
        return self.whole and self.evolves and self.gives("stops", 0.25)

    @property
    def d(self) -> int:
        """Dimension."""
        return int(self.content["dimension"])

    @property
    def planar(self) -> bool:
        """Whether there are two dimensions."""
        return self.d == 2

    @property
    def count(self) -> int:
        """Number of types."""
        return len(self.content["types"])

    @property
    def particles(self) -> int:
        """Number of particles of those given one by one."""
        return len(self.content["positions"]["x"])

    @property
    def rho0(self) -> list[float]:
        """Equilibrium density of every type."""
        return [each.get("rho0", 1.0) for each in self.content["types"]]

    @property
    def solids(self) -> list[int]:
        """Solid types."""
        return [t for t, each in enumerate(self.content["types"], 1) if each.get("phase") == "solid"]

    @property
    def neighbours(self) -> int:
        """Number of neighbours of a particle within a fluid, about."""
        volume = 3.14 * self.cut**2 if self.planar else 4.19 * self.cut**3
        return max(2, int(volume))
