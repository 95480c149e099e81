"""The particles of a scene: their types and equations of state, their positions, and their properties."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from eos_ref import EOS
from eos_ref.eos.registry import LAWS, PARAMETER, Style
from eos_ref.model.box import TILTED
from eos_ref.syntax.fixes import PressureEntry
from lammps_cases.scene.values import (
    NUMBER,
    OF_HOLDER,
    PER_TYPE,
    BrokenRule,
    Dim,
    Finite,
    LocalFile,
    NonNegative,
    Positive,
    Powers,
    SceneModel,
    TypeRange,
    Vector,
)

LatticeStyle = Literal["sq", "hex", "sc", "bcc", "fcc"]
PLANAR = ("sq", "hex")
Tilt = Annotated[
    tuple[Finite] | tuple[Finite, Finite, Finite] | None,
    Dim("x"),
    Field(description="tilt of the box: xy in 2D; xy, xz and yz in 3D"),
]


def _consistency(law: PowerLaw, _: object) -> Powers:
    return ("viscosity", 1.0), ("grad/v", 1 - law.n)


class PowerLaw(SceneModel):
    """Arguments of fix rheo/viscosity power."""

    eta: Annotated[NonNegative, Dim("viscosity")]
    gd0: Annotated[Positive, Dim("grad/v")]
    K: Annotated[NonNegative, Dim(_consistency, about="unit: viscosity times (strain rate)^(1 - n)")]
    n: Annotated[Finite, NUMBER]


# A mapping is a power law; the tags hold spaces, which keeps them out of the place named in messages.
ViscosityLaw = Annotated[
    Annotated[NonNegative, Tag("a number")] | Annotated[PowerLaw, Tag("power law")],
    Discriminator(lambda law: "power law" if isinstance(law, dict | PowerLaw) else "a number"),
]


class AtomType(SceneModel):
    """One atom type: mass, phase, and per-type values of the RHEO fixes (rho0 and cs: default 1)."""

    mass: Annotated[Positive, Dim("mass")]
    rho0: Annotated[Positive | None, Dim("rho", implied=1.0)] = None
    cs: Annotated[Positive | None, Dim("v", implied=1.0)] = None
    phase: Literal["fluid", "solid"] = Field("fluid", description="of all its particles, at the beginning")
    viscosity: Annotated[ViscosityLaw, Dim("viscosity")] = Field(
        0.1, description="constant, or eta, gd0, K, n of a power law"
    )
    conductivity: Annotated[NonNegative, Dim("conductivity")] = Field(0.1, description="of particles that carry energy")
    specific_heat: Annotated[Positive, Dim("cv")] = Field(1.0, description="of particles that carry energy")
    latent_heat: Annotated[NonNegative | None, Dim("latent heat")] = Field(None, description="needs T_freeze")
    T_freeze: Annotated[Finite | None, Dim("temperature")] = None
    velocity: Annotated[Vector | None, Dim("v")] = Field(
        None, description="initial velocity, instead of velocity.uniform: a moving wall"
    )

    @model_validator(mode="after")
    def _freezes(self) -> AtomType:
        if self.latent_heat is not None and self.T_freeze is None:
            raise BrokenRule("latent_heat needs T_freeze", "latent_heat")
        return self

    @property
    def thermal(self) -> bool:
        """Return whether a thermal property is given."""
        return bool({"conductivity", "specific_heat", "latent_heat", "T_freeze"} & self.model_fields_set)


def entries(law: EOS) -> list[dict[str, Any]]:
    """Return the entries of fix rheo/pressure, in a scene's form, that give all types one law."""
    argument = {} if law.law.parameter is None else {law.law.parameter: law.parameter}
    background = [{"types": "*", "style": "background", "P_b": law.background}] if law.background else []
    return [{"types": "*", "style": law.style, **argument}, *background]


class LawSettings(SceneModel):
    """One entry of fix rheo/pressure: a type range, a style and its argument."""

    types: TypeRange = Field(description="*, n, *n, m* or m*n, as in the manual")
    style: Style | Literal["background"]
    A3: Annotated[Finite | None, Dim("A3")] = None
    gamma: Annotated[Finite | None, NUMBER] = None
    P_b: Annotated[Finite | None, Dim("pressure")] = None

    @model_validator(mode="after")
    def _one_argument(self) -> LawSettings:
        wanted = PARAMETER.get(self.style)
        for name in dict.fromkeys(PARAMETER.values()):
            given = getattr(self, name) is not None
            if given != (name == wanted):
                raise BrokenRule(f"{self.style} {'needs' if name == wanted else 'does not take'} {name}", name)
        return self

    @property
    def value(self) -> float | None:
        """Return the style's argument."""
        name = PARAMETER.get(self.style)
        return None if name is None else getattr(self, name)

    @property
    def takes_cs(self) -> bool:
        """Return whether the law depends on the speed of sound."""
        return self.style == "background" or LAWS[self.style].takes_cs

    @property
    def needs_energy(self) -> bool:
        """Return whether the law depends on the internal energy."""
        return self.style != "background" and LAWS[self.style].needs_energy

    @property
    def entry(self) -> PressureEntry:
        """Return the entry in the reference's form."""
        return PressureEntry(self.types, self.style, self.value)


def check_tilt(tilt: tuple[float, ...] | None, periodic: tuple[bool, ...] | None, dimension: int, *above: str) -> None:
    """Check that edges tilt only between periodic axes, and that there is one number for each possible tilt.

    Parameters
    ----------
    above : keys of what holds the tilt
    """
    if tilt is None:
        return
    wanted = dimension * (dimension - 1) // 2
    if len(tilt) != wanted:
        raise BrokenRule(f"tilt needs {wanted} numbers in {dimension}D", *above, "tilt", found=len(tilt))
    for lean, axes in zip(tilt, TILTED, strict=False):
        if lean and periodic and not all(periodic[axis] for axis in axes):
            raise BrokenRule("tilt must be 0 but between periodic axes", *above, "tilt", found=list(tilt))


class Region(SceneModel):
    """A block of the lattice whose particles have one type, or are removed."""

    type: int | None = Field(ge=1, strict=True, description="null removes the particles")
    low: Annotated[Vector, NUMBER] = Field(description="corner, in fractions of the lattice")
    high: Annotated[Vector, NUMBER] = Field(description="opposite corner; sites on it lie outside")


class Lattice(SceneModel):
    """Particles on a lattice that fills the box, moved by seeded uniform disorder."""

    lattice: LatticeStyle
    spacing: Annotated[Positive, Dim("x")] = Field(description="nearest lattice constant (distance)")
    cells: tuple[int, ...] = Field(description="unit cells along each axis")
    disorder: Annotated[Finite, Field(ge=0, lt=0.5), NUMBER] = Field(
        0.0, description="largest displacement along an axis, as a fraction of the spacing"
    )
    regions: tuple[Region, ...] = Field((), description="applied in order to the sites, before disorder")
    periodic: tuple[bool, ...] | None = Field(None, description="one flag per axis; default: all true")
    margin: Annotated[NonNegative, NUMBER] = Field(
        1.0, description="empty space beyond faces that are not periodic, in spacings"
    )
    tilt: Tilt = None

    @model_validator(mode="after")
    def _size(self) -> Lattice:
        wanted = 2 if self.lattice in PLANAR else 3
        if len(self.cells) != wanted:
            raise BrokenRule(
                f"cells needs {wanted} numbers for {self.lattice}, a lattice in {wanted}D",
                "cells",
                found=len(self.cells),
            )
        if min(self.cells) < 1:
            raise BrokenRule(
                "cells must be at least 1 along each axis, else the scene is empty", "cells", found=list(self.cells)
            )
        if self.periodic is not None and len(self.periodic) != wanted:
            raise BrokenRule(f"periodic needs {wanted} flags for {self.lattice}", "periodic", found=len(self.periodic))
        for region in self.regions:
            if not len(region.low) == len(region.high) == wanted:
                raise BrokenRule(f"low and high of a region need {wanted} numbers for {self.lattice}", "regions")
            if not all(low < high for low, high in zip(region.low, region.high, strict=True)):
                found = f"{list(region.low)} and {list(region.high)}"
                raise BrokenRule("a region needs low < high", "regions", found=found)
        check_tilt(self.tilt, self.periodic, wanted)
        return self


class FromFile(SceneModel):
    """Particles from a file next to the scene."""

    @property
    @abstractmethod
    def file(self) -> str:
        """Return the name of the file."""


class FromXYZ(FromFile):
    """Particles from an extended XYZ file, read by ASE; its cell is the box."""

    extxyz: LocalFile = Field(
        description="file next to the scene; per-atom arrays type, rho, e (energy per unit mass) are used if present"
    )

    @property
    def file(self) -> str:
        return self.extxyz


class FromData(FromFile):
    """Particles from a data file of LAMMPS (write_data) of atom_style rheo or rheo/thermal: all that it holds of them.

    Densities, energies and velocities are those of the file where the scene gives none.
    """

    data: LocalFile = Field(description="file next to the scene; solid particles must be of types that are solid here")
    periodic: tuple[bool, ...] | None = Field(None, description="one flag per axis, as no such file has; default: true")

    @property
    def file(self) -> str:
        return self.data


class Columns(SceneModel):
    """Columns of a dump that hold what it has no name of its own for."""

    rho: str | None = Field(None, description="of the density, c_ID[2] say; default: rho, if there is such a column")
    energy: str | None = Field(None, description="of the energy of a particle; default: energy")


class FromDump(FromFile):
    """Particles from a snapshot of a dump of LAMMPS as text (dump custom), with columns id, type, x, y and z.

    Velocities (vx, vy, vz), densities and energies are those of the file where the scene gives none, with the digits
    that are printed there.
    """

    dump: LocalFile = Field(description="file next to the scene")
    step: int | None = Field(None, ge=0, description="time step of the snapshot; default: the last one")
    columns: Columns = Columns()

    @property
    def file(self) -> str:
        return self.dump


class Listed(SceneModel):
    """Particles one by one, in order of id, in a box."""

    x: Annotated[tuple[Vector, ...], Dim("x")] = Field(min_length=1, description="one position per particle")
    types: tuple[Annotated[int, Field(ge=1, strict=True)], ...] | None = Field(
        None, description="one type per particle; default: all 1"
    )
    low: Annotated[Vector, Dim("x")] = Field(description="corner of the box")
    high: Annotated[Vector, Dim("x")] = Field(description="opposite corner")
    periodic: tuple[bool, ...] | None = Field(None, description="one flag per axis; default: all true")
    spacing: Annotated[Positive, Dim("x")] = Field(
        1.0, description="distance that the cutoff and the skin are given in by default"
    )
    tilt: Tilt = None

    @model_validator(mode="after")
    def _size(self) -> Listed:
        d = len(self.low)
        if any(len(x) != d for x in (self.high, *self.x)):
            raise BrokenRule(f"x, low and high need the same number of components, {d} as low has", "x")
        if not all(low < high for low, high in zip(self.low, self.high, strict=True)):
            raise BrokenRule("the box needs low < high", "low", found=f"{list(self.low)} and {list(self.high)}")
        if self.types is not None and len(self.types) != len(self.x):
            raise BrokenRule(f"types needs one value per particle ({len(self.x)})", "types", found=len(self.types))
        if self.periodic is not None and len(self.periodic) != d:
            raise BrokenRule(f"periodic needs {d} flags", "periodic", found=len(self.periodic))
        check_tilt(self.tilt, self.periodic, d)
        return self


_KINDS: dict[str, type[SceneModel]] = {"extxyz": FromXYZ, "data": FromData, "dump": FromDump, "x": Listed}


def _kind_of_positions(positions: object) -> str:
    for key, kind in _KINDS.items():
        if isinstance(positions, kind) or (isinstance(positions, dict) and key in positions):
            return f"by {key}"
    return "by lattice"


# One key decides the kind, so that a mistake in one kind is not reported as a mistake in another.
Positions = Annotated[
    Annotated[Lattice, Tag("by lattice")]
    | Annotated[FromXYZ, Tag("by extxyz")]
    | Annotated[FromData, Tag("by data")]
    | Annotated[FromDump, Tag("by dump")]
    | Annotated[Listed, Tag("by x")],
    Discriminator(_kind_of_positions),
]


class Offset(SceneModel):
    """Relative distances from the density of equilibrium, or a mass: rho = rho0 (1 +/- d), d spaced logarithmically."""

    low: Annotated[Positive, NUMBER]
    high: Annotated[Positive, NUMBER]
    sign: Literal["both", "+", "-"] = "both"

    @model_validator(mode="after")
    def _ordered(self) -> Offset:
        if self.low > self.high:
            raise BrokenRule("low must not exceed high", "low", found=f"{self.low!r} > {self.high!r}")
        return self


class ValueTable(SceneModel):
    """A column of a CSV file with a header line; one row per particle."""

    csv: LocalFile
    column: str


class Values(SceneModel):
    """Per-atom values of a field: exactly one of the keys; sequences are dealt out in a seeded random order."""

    constant: Annotated[Finite | None, OF_HOLDER] = None
    per_type: Annotated[tuple[Finite, ...] | None, OF_HOLDER, PER_TYPE] = Field(
        None, description="one value per atom type"
    )
    range: Annotated[tuple[Finite, Finite] | None, OF_HOLDER] = Field(None, description="from, to")
    ratio: Annotated[tuple[Finite, Finite] | None, NUMBER] = Field(
        None, description="from, to, in units of the type's rho0; of masses: of its mass"
    )
    offset: Offset | None = None
    values: Annotated[tuple[Finite, ...] | None, OF_HOLDER] = Field(
        None, description="one value per particle, in order of id"
    )
    table: ValueTable | None = None
    spacing: Literal["linear", "log"] = Field("linear", description="of range and ratio")

    @model_validator(mode="after")
    def _exactly_one(self) -> Values:
        keys = ("constant", "per_type", "range", "ratio", "offset", "values", "table")
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            raise BrokenRule(f"needs exactly one of {', '.join(keys)}", found=", ".join(given) or "none")
        ends = self.range or self.ratio
        if ends and self.spacing == "log" and ends[0] * ends[1] <= 0:
            raise BrokenRule("log spacing needs two ends of one sign, not 0", "spacing", found=list(ends))
        return self


class Velocity(SceneModel):
    """Initial velocities: a seeded random part, which solid types do not get, and one common to all."""

    random: Annotated[Finite, Dim("v")] = Field(0.0, description="largest component")
    uniform: Annotated[Vector | None, Dim("v")] = None
    values: Annotated[tuple[Vector, ...] | None, Dim("v")] = Field(
        None, description="one per particle, in order of id; instead of all else"
    )

    @model_validator(mode="after")
    def _one_way(self) -> Velocity:
        if self.values is not None and (self.random or self.uniform):
            raise BrokenRule("values goes with neither random nor uniform", "values")
        return self
