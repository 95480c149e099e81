"""A scene: everything that defines one case, as validated data. No raw LAMMPS text, so safe from strangers.

The models are the file format: `lammps_cases/scene.schema.json` (for editors) is generated from them. Quantities
are in the scene's LAMMPS units; energies are per unit mass.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
    WithJsonSchema,
    model_validator,
)

from eos_ref import EOSTable, InputError, resolve
from eos_ref.eos import PARAMETER, Style
from eos_ref.fixes import KernelStyle, PressureEntry, SurfaceStyle
from eos_ref.ranges import type_range

Units = Literal["lj", "si", "real", "metal", "cgs", "micro", "nano"]
LatticeStyle = Literal["sq", "hex", "sc", "bcc", "fcc"]
# Rules of the manual that a scene may break on purpose, to see LAMMPS refuse it.
Violation = Literal[
    "atom-style-atomic",
    "no-fix-rheo",
    "no-fix-pressure",
    "no-fix-pressure-read",
    "no-fix-viscosity",
    "pressure-before-rheo",
    "pressure-group",
    "pressure-twice",
    "rheo-group",
    "rheo-twice",
    "unknown-pressure-style",
    "missing-argument",
    "no-fix-thermal",
    "atom-style-rheo",
]
# What a scene can compare, by LAMMPS' names: columns of compute rheo/property/atom, then properties of atoms.
Column = Literal[
    "pressure",
    "rho",
    "coordination",
    "chi",
    "grad/v",
    "viscosity",
    "surface",
    "surface/r",
    "surface/n",
    "surface/divr",
    "shift/v",
    "temperature",
    "heatflow",
    "energy",
    "conductivity",
    "cv",
    "stress/v",
    "stress/t",
    "phase",
    "status",
]
AtomProperty = Literal["x", "v", "f", "drho", "pressure_used"]
THERMAL_FIELDS = ("temperature", "heatflow", "energy", "conductivity", "cv")
SNAPSHOTS = (0, 1, 10, 100)  # steps compared by default: the set-up, the first step, and the growth of rounding
MAX_ATOMS = 10_000_000
PLANAR = ("sq", "hex")


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"must be a finite number, found {value!r}")
    return value


def _inside(path: str) -> str:
    parts = PurePosixPath(path)
    if parts.is_absolute() or ".." in parts.parts or "\\" in path:
        raise ValueError(f"must be a file in the scene's own folder or below, found {path!r}")
    return path


# A number is a number: neither true nor "1.5" is taken for one.
Finite = Annotated[float, Field(strict=True), AfterValidator(_finite)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Vector = Annotated[tuple[Finite, ...], Field(min_length=2, max_length=3)]
# YAML reads a single type as a number.
_RANGE = {"type": ["string", "integer"]}
TypeRange = Annotated[
    str,
    BeforeValidator(lambda types: str(types) if type(types) is int else types),
    StringConstraints(pattern=r"^[0-9*-]{1,24}$"),  # nothing that LAMMPS could take for another word or command
    WithJsonSchema(_RANGE),
]
LocalFile = Annotated[str, AfterValidator(_inside)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PowerLaw(_Model):
    """Arguments of fix rheo/viscosity power."""

    eta: NonNegative
    gd0: Positive
    K: NonNegative
    n: Finite


# A mapping is a power law; the tags hold spaces, which keeps them out of the place named in messages.
ViscosityLaw = Annotated[
    Annotated[NonNegative, Tag("a number")] | Annotated[PowerLaw, Tag("power law")],
    Discriminator(lambda law: "power law" if isinstance(law, dict | PowerLaw) else "a number"),
]


class AtomType(_Model):
    """One atom type: mass, phase, and per-type values of the RHEO fixes (rho0 and cs: default 1)."""

    mass: Positive
    rho0: Positive | None = None
    cs: Positive | None = None
    phase: Literal["fluid", "solid"] = Field("fluid", description="of all its particles, at the beginning")
    viscosity: ViscosityLaw = Field(0.1, description="constant, or eta, gd0, K, n of a power law")
    conductivity: NonNegative = Field(0.1, description="of particles that carry energy")
    specific_heat: Positive = Field(1.0, description="of particles that carry energy")
    latent_heat: NonNegative | None = Field(None, description="energy per unit mass; needs T_freeze")
    T_freeze: Finite | None = None
    velocity: Vector | None = Field(None, description="initial velocity, instead of velocity.uniform: a moving wall")

    @model_validator(mode="after")
    def _freezes(self) -> AtomType:
        if self.latent_heat is not None and self.T_freeze is None:
            raise ValueError("latent_heat needs T_freeze")
        return self

    @property
    def thermal(self) -> bool:
        """Whether a thermal property is given."""
        return bool({"conductivity", "specific_heat", "latent_heat", "T_freeze"} & self.model_fields_set)


class Law(_Model):
    """One entry of fix rheo/pressure: a type range, a style and its argument."""

    types: TypeRange = Field(description="*, n, *n, m* or m*n, as in the manual")
    style: Style | Literal["background"]
    A3: Finite | None = None
    gamma: Finite | None = None
    P_b: Finite | None = None

    @model_validator(mode="after")
    def _one_argument(self) -> Law:
        wanted = PARAMETER.get(self.style)
        for name in ("A3", "gamma", "P_b"):
            given = getattr(self, name) is not None
            if given != (name == wanted):
                raise ValueError(f"{self.style} {'needs' if name == wanted else 'does not take'} {name}")
        return self

    @property
    def value(self) -> float | None:
        """The style's argument."""
        return next((v for v in (self.A3, self.gamma, self.P_b) if v is not None), None)

    @property
    def entry(self) -> PressureEntry:
        """The entry as the reference takes it."""
        return PressureEntry(self.types, self.style, self.value)


class Region(_Model):
    """A block of the lattice whose particles have one type, or are removed."""

    type: int | None = Field(ge=1, strict=True, description="null removes the particles")
    low: Vector = Field(description="corner, in fractions of the lattice")
    high: Vector = Field(description="opposite corner; sites on it lie outside")


class Lattice(_Model):
    """Particles on a lattice that fills the box, moved by seeded uniform disorder."""

    lattice: LatticeStyle
    spacing: Positive = Field(description="nearest lattice constant (distance)")
    cells: tuple[int, ...] = Field(description="unit cells along each axis")
    disorder: Annotated[Finite, Field(ge=0, lt=0.5)] = Field(
        0.0, description="largest displacement along an axis, as a fraction of the spacing"
    )
    regions: tuple[Region, ...] = Field((), description="applied in order to the sites, before disorder")
    periodic: tuple[bool, ...] | None = Field(None, description="one flag per axis; default: all true")
    margin: NonNegative = Field(1.0, description="empty space beyond faces that are not periodic, in spacings")

    @model_validator(mode="after")
    def _size(self) -> Lattice:
        wanted = 2 if self.lattice in PLANAR else 3
        if len(self.cells) != wanted:
            raise ValueError(f"cells needs {wanted} numbers for {self.lattice}, found {len(self.cells)}")
        if min(self.cells) < 1:
            raise ValueError(f"the scene is empty: cells must be at least 1 along each axis, found {self.cells}")
        if self.periodic is not None and len(self.periodic) != wanted:
            raise ValueError(f"periodic needs {wanted} flags for {self.lattice}, found {len(self.periodic)}")
        for region in self.regions:
            if not len(region.low) == len(region.high) == wanted:
                raise ValueError(f"low and high of a region need {wanted} numbers for {self.lattice}")
            if not all(low < high for low, high in zip(region.low, region.high, strict=True)):
                raise ValueError(f"a region needs low < high, found {region.low} and {region.high}")
        return self


class FromFile(_Model):
    """Particles from an extended XYZ file, read by ASE; its cell is the box."""

    extxyz: LocalFile = Field(
        description="file beside the scene; per-atom arrays type, rho, e (energy per unit mass) are used if present"
    )


def _kind_of_positions(positions: object) -> str:
    from_file = isinstance(positions, FromFile) or (isinstance(positions, dict) and "extxyz" in positions)
    return "from file" if from_file else "on lattice"


# The key extxyz decides, so that a mistake in one kind is not reported as a mistake in the other.
Positions = Annotated[
    Annotated[Lattice, Tag("on lattice")] | Annotated[FromFile, Tag("from file")], Discriminator(_kind_of_positions)
]


class Offset(_Model):
    """Relative distances from the equilibrium density: rho = rho0 (1 +/- d), d spaced logarithmically."""

    low: Positive
    high: Positive
    sign: Literal["both", "+", "-"] = "both"

    @model_validator(mode="after")
    def _ordered(self) -> Offset:
        if self.low > self.high:
            raise ValueError(f"low must not exceed high, found {self.low!r} > {self.high!r}")
        return self


class Table(_Model):
    """A column of a CSV file with a header line; one row per particle."""

    csv: LocalFile
    column: str


class Values(_Model):
    """Per-atom values of a field: exactly one of the keys; sequences are dealt out in a seeded random order."""

    constant: Finite | None = None
    per_type: tuple[Finite, ...] | None = Field(None, description="one value per atom type")
    range: tuple[Finite, Finite] | None = Field(None, description="from, to")
    ratio: tuple[Finite, Finite] | None = Field(None, description="from, to, in units of the type's rho0")
    offset: Offset | None = None
    values: tuple[Finite, ...] | None = Field(None, description="one value per particle, in order of id")
    table: Table | None = None
    spacing: Literal["linear", "log"] = Field("linear", description="of range and ratio")

    @model_validator(mode="after")
    def _exactly_one(self) -> Values:
        keys = ("constant", "per_type", "range", "ratio", "offset", "values", "table")
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"needs exactly one of {', '.join(keys)}, found {', '.join(given) or 'none'}")
        ends = self.range or self.ratio
        if ends and self.spacing == "log" and ends[0] * ends[1] <= 0:
            raise ValueError(f"log spacing needs two ends of one sign, not 0, found {ends}")
        return self


class Velocity(_Model):
    """Initial velocities: a seeded random part, which solid types do not get, and one common to all."""

    random: Finite = Field(0.0, description="largest component")
    uniform: Vector | None = None


class SurfaceDetectionSettings(_Model):
    """Arguments of surface/detection."""

    style: SurfaceStyle
    limit: Finite
    splash: int = Field(strict=True)

    @model_validator(mode="after")
    def _whole(self) -> SurfaceDetectionSettings:
        if self.style == "coordination" and not self.limit.is_integer():
            raise ValueError(f"limit of coordination counts neighbours: a whole number, found {self.limit!r}")
        return self


def _several(types: object) -> object:
    return types if isinstance(types, list | tuple) else (types,)


_ONE_OR_MORE = {"oneOf": [_RANGE, {"type": "array", "items": _RANGE}]}


class ShiftSettings(_Model):
    """Arguments of shift."""

    exclude: Annotated[tuple[TypeRange, ...], BeforeValidator(_several), WithJsonSchema(_ONE_OR_MORE)] = Field(
        (), description="types that are not shifted: a range, or a list of them"
    )
    scale_cross_type: tuple[Finite, Finite, Finite] | None = Field(None, description="shiftscale, cmin, wmin")


OnOrShift = Annotated[
    Annotated[bool, Field(strict=True), Tag("on or off")] | Annotated[ShiftSettings, Tag("with arguments")],
    Discriminator(lambda shift: "with arguments" if isinstance(shift, dict | ShiftSettings) else "on or off"),
]


class RheoSettings(_Model):
    """Arguments of fix rheo, but for those of the types."""

    kernel: KernelStyle = "quintic"
    cut: Positive | None = Field(None, description="kernel cutoff; default 3 spacings")
    zmin: int = Field(0, ge=0, strict=True)
    rho_sum: bool = Field(False, description="density summed over neighbours (rho/sum)")
    self_mass: bool = Field(False, description="argument of rho/sum")
    interface_reconstruct: bool = False
    surface_detection: SurfaceDetectionSettings | None = None
    shift: OnOrShift = False

    @model_validator(mode="after")
    def _arguments(self) -> RheoSettings:
        if self.self_mass and not self.rho_sum:
            raise ValueError("self_mass is an argument of rho_sum, which is off")
        return self

    @property
    def shifting(self) -> ShiftSettings | None:
        """Arguments of shift; None: off."""
        if isinstance(self.shift, bool):
            return ShiftSettings() if self.shift else None
        return self.shift


class PairSettings(_Model):
    """Arguments of pair_style rheo; 0 turns a term off."""

    artificial_visc: NonNegative = 0.0
    rho_damp: NonNegative = 0.0
    harmonic_means: bool = False


class ForceSettings(_Model):
    """A fix gravity, addforce or setforce, in the order of the list."""

    style: Literal["gravity", "addforce", "setforce"]
    vector: tuple[Finite | None, ...] = Field(description="one component per axis; null: setforce leaves it")
    types: TypeRange | None = Field(None, description="default: all")

    @model_validator(mode="after")
    def _complete(self) -> ForceSettings:
        if self.style != "setforce" and None in self.vector:
            raise ValueError(f"{self.style} needs a number for every component")
        return self


class Evolve(_Model):
    """Time steps that LAMMPS takes."""

    steps: int = Field(ge=1, le=100_000, strict=True)
    timestep: Positive
    compare_at: tuple[Annotated[int, Field(ge=0, strict=True)], ...] | None = Field(
        None, min_length=1, description="steps compared; default: those of 0, 1, 10, 100 that there are, and the last"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Evolve:
        if self.compare_at is not None and not (
            list(self.compare_at) == sorted(set(self.compare_at)) and self.compare_at[-1] == self.steps
        ):
            raise ValueError(f"compare_at must increase and end with steps ({self.steps}), found {self.compare_at}")
        return self

    @property
    def snapshots(self) -> tuple[int, ...]:
        """Steps compared."""
        return self.compare_at or (*(step for step in SNAPSHOTS if step < self.steps), self.steps)


class Rebuild(_Model):
    """When neighbour lists are built anew."""

    every: int = Field(1, ge=1, strict=True)
    delay: int = Field(0, ge=0, strict=True)
    check: bool = True

    @model_validator(mode="after")
    def _multiple(self) -> Rebuild:
        if self.delay % self.every:
            raise ValueError(f"delay must be 0 or a multiple of every, found {self.delay} and {self.every}")
        return self


class EngineSettings(Rebuild):
    """Settings of LAMMPS that do not change what is documented to come out."""

    newton: bool = True
    skin: Positive = Field(0.3, description="of neighbour lists, in spacings")
    ranks: Literal[1, 2] = 1
    time_limit: Annotated[Finite, Field(gt=0, le=3600)] = Field(60.0, description="seconds")


class TwinSettings(_Model):
    """A second run of LAMMPS, its own first one the reference: exactly one of the keys. See `lammps_cases.twins`."""

    translate: Vector | None = Field(None, description="displacement of all particles, wrapped in periodic axes")
    boost: Vector | None = Field(None, description="velocity added to all particles, walls included")
    relabel: Literal[True] | None = Field(None, description="ids dealt out anew (seeded)")
    rescale: Positive | None = Field(None, description="lengths times a power of two; densities and velocities stay")
    newton: Annotated[bool, Field(strict=True)] | None = Field(None, description="the other setting")
    skin: Positive | None = Field(None, description="another skin, in spacings")
    rebuild: Rebuild | None = Field(None, description="neighbour lists built at other steps")
    split: Literal[True] | None = Field(None, description="one run against two, the second with pre no")
    ranks: Literal[2] | None = Field(None, description="two processes against one")

    @model_validator(mode="after")
    def _exactly_one(self) -> TwinSettings:
        given = [key for key in type(self).model_fields if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"needs exactly one of {', '.join(type(self).model_fields)}, found {' '.join(given) or 0}")
        if self.rescale is not None and not 2.0**-20 <= self.rescale <= 2.0**20:
            raise ValueError(f"rescale must lie within 2^-20 to 2^20, found {self.rescale!r}")
        if self.rescale is not None and (math.frexp(self.rescale)[0] != 0.5 or self.rescale == 1):
            raise ValueError(f"rescale must be a power of two other than 1, found {self.rescale!r}")
        return self

    @property
    def kind(self) -> str:
        """The key given."""
        return next(key for key in type(self).model_fields if getattr(self, key) is not None)


class Expect(_Model):
    """How LAMMPS must refuse the scene."""

    refused: str = Field(min_length=8, description="text that LAMMPS' error message must contain")

    @model_validator(mode="after")
    def _specific(self) -> Expect:
        if len(self.refused.replace("ERROR", "").strip(" :")) < 8:
            raise ValueError(f"refused must hold words that only this refusal has, found {self.refused!r}")
        return self


class Scene(_Model):
    """One case. See `lammps_cases/cases` for examples."""

    units: Units = "lj"
    dimension: Literal[2, 3]
    types: tuple[AtomType, ...] = Field(min_length=1)
    positions: Positions
    arrangement: Literal["shuffled", "blocks"] = Field(
        "shuffled", description="how types, in equal shares, are dealt out to the particles"
    )
    pressure: tuple[Law, ...] = Field(description="entries of fix rheo/pressure, in order")
    rho: Values | None = Field(None, description="density; not given if a file or the summation sets it")
    energy: Values | None = Field(None, description="internal energy per unit mass (ideal/gas)")
    velocity: Velocity = Velocity()
    rheo: RheoSettings = RheoSettings()
    pair: PairSettings = PairSettings()
    forces: tuple[ForceSettings, ...] = Field((), max_length=16)
    evolve: Evolve | None = None
    compare: tuple[Literal[Column, AtomProperty], ...] = Field(
        ("pressure",), min_length=1, description="fields by LAMMPS' names; anything but pressure: the whole model"
    )
    engine: EngineSettings = EngineSettings()
    twin: TwinSettings | None = Field(None, description="compare LAMMPS with a second run of its own")
    violate: Violation | None = None
    expect: Expect | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        if isinstance(self.positions, Lattice):
            planar = self.positions.lattice in PLANAR
            if planar != (self.dimension == 2):
                raise ValueError(f"lattice {self.positions.lattice} does not fit dimension {self.dimension}")
            atoms = math.prod(self.positions.cells) * {"hex": 2, "bcc": 2, "fcc": 4}.get(self.positions.lattice, 1)
            if atoms > MAX_ATOMS:
                raise ValueError(f"at most {MAX_ATOMS} particles, found {atoms}")
        if self.violate and not self.expect:
            raise ValueError("violate needs expect: {refused: TEXT}")
        for key in ("rho", "energy"):
            field = getattr(self, key)
            if field and field.per_type and len(field.per_type) != len(self.types):
                raise ValueError(f"{key}.per_type needs {len(self.types)} values, found {len(field.per_type)}")
        for key in ("rho0", "cs"):
            given = [getattr(t, key) is not None for t in self.types]
            if any(given) and not all(given):
                raise ValueError(f"{key} must be given for every type or for none (fix rheo takes N values)")
        self._check_types()
        self._check_vectors()
        self._check_compare()
        if self.twin:
            self._check_twin(self.twin)
        return self

    def _check_twin(self, twin: TwinSettings) -> None:
        if self.expect or not self.whole_model:
            raise ValueError("twin compares fields of the whole model: it needs more in compare than pressure")
        if twin.boost is not None and self.rheo.shift:
            raise ValueError("twin.boost: shifting follows the speed of each particle, which depends on the frame")
        if twin.split and (self.evolve is None or self.evolve.steps < 2):
            raise ValueError("twin.split needs two time steps or more")
        if twin.kind in ("newton", "skin", "ranks") and getattr(twin, twin.kind) == getattr(self.engine, twin.kind):
            raise ValueError(f"twin.{twin.kind} must differ from engine.{twin.kind}")
        if twin.rescale is not None:
            octaves = int(math.log2(twin.rescale))
            for law in (t.viscosity for t in self.types if isinstance(t.viscosity, PowerLaw)):
                if (Fraction(law.n) * octaves).denominator != 1:
                    raise ValueError(f"twin.rescale must be exact: rescale to the power of n ({law.n!r}) is not")

    def _check_types(self) -> None:
        n = len(self.types)
        for region in getattr(self.positions, "regions", ()):
            if region.type is not None and region.type > n:
                raise ValueError(f"type of a region must lie within 1 to {n}, found {region.type}")
        for types in (*(f.types for f in self.forces), *(self.rheo.shifting.exclude if self.rheo.shifting else ())):
            if types is not None:
                type_range(types, n)
        if any(t.thermal for t in self.types) and self.energy is None and isinstance(self.positions, Lattice):
            raise ValueError("conductivity, specific_heat, latent_heat and T_freeze need energy")

    def _check_vectors(self) -> None:
        vectors: dict[str, list[tuple[float | None, ...] | tuple[float, ...] | None]] = {
            "velocity.uniform": [self.velocity.uniform],
            "velocity of a type": [t.velocity for t in self.types],
            "vector of a force": [force.vector for force in self.forces],
            "vector of twin": [self.twin.translate or self.twin.boost] if self.twin else [],
        }
        for what, given in vectors.items():
            for vector in given:
                if vector is not None and len(vector) != self.dimension:
                    raise ValueError(f"{what} needs {self.dimension} components, found {len(vector)}")

    def _check_compare(self) -> None:
        if len(set(self.compare)) < len(self.compare):
            raise ValueError("compare must name each field once")
        if self.whole_model and self.units in ("real", "metal"):
            fit = "only in lj, si, cgs, micro and nano is force over mass an acceleration"
            raise ValueError(f"units {self.units} serve to compare the pressure alone: {fit}")
        for field in self.compare:
            needed = {
                "chi": ("rheo.interface_reconstruct", self.rheo.interface_reconstruct),
                "shift/v": ("rheo.shift", self.rheo.shift),
                **dict.fromkeys(THERMAL_FIELDS, ("energy", self.thermal)),
                **dict.fromkeys(
                    ("surface", "surface/r", "surface/n", "surface/divr"),
                    ("rheo.surface_detection", self.rheo.surface_detection),
                ),
            }.get(field)
            if needed and not needed[1]:
                raise ValueError(f"compare: {field} needs {needed[0]}")

    @property
    def rho0(self) -> tuple[float, ...] | None:
        """Equilibrium densities per type; None: fix rheo's default of 1."""
        values = tuple(t.rho0 for t in self.types if t.rho0 is not None)
        return values or None

    @property
    def cs(self) -> tuple[float, ...] | None:
        """Speeds of sound per type; None: fix rheo's default of 1."""
        values = tuple(t.cs for t in self.types if t.cs is not None)
        return values or None

    @property
    def thermal(self) -> bool:
        """Whether particles carry energy (atom_style rheo/thermal)."""
        gas = any(law.style == "ideal/gas" for law in self.pressure)
        return self.energy is not None or gas or any(t.thermal for t in self.types)

    @property
    def rho_sum(self) -> bool:
        """Whether the density is summed over neighbours."""
        return self.rheo.rho_sum

    @property
    def whole_model(self) -> bool:
        """Whether the particle model is compared, not the equation of state alone."""
        return self.compare != ("pressure",) or (self.evolve is not None and self.evolve.compare_at is not None)

    @property
    def interacts(self) -> bool:
        """Whether particles have neighbours."""
        return self.whole_model or self.rho_sum or self.evolve is not None

    @property
    def snapshots(self) -> tuple[int, ...]:
        """Steps at which fields are compared; those of an equation of state at the end alone."""
        if self.evolve is None:
            return (0,)
        return self.evolve.snapshots if self.whole_model else (self.evolve.steps,)

    def eos(self, where: str = "") -> EOSTable:
        """The reference's laws of all types.

        Raises
        ------
        InputError
            A type without law, a bad range or parameter.
        """
        return resolve([law.entry for law in self.pressure], len(self.types), self.rho0, self.cs, where)


NAME = re.compile(r"[a-z0-9]+(?:[-+][a-z0-9]+)*")


def check_name(name: str, where: str) -> str:
    """A part of a case's name: lower-case words joined by hyphens.

    Raises
    ------
    InputError
    """
    if not NAME.fullmatch(name) or len(name) > 60:
        raise InputError("name", "must be at most 60 lower-case letters, digits, hyphens and +", name, where)
    return name
