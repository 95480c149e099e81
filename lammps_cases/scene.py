"""A scene: everything that defines one case, as validated data. No raw LAMMPS text, so safe from strangers.

The models are the file format: `lammps_cases/scene.schema.json` (for editors) is generated from them. Quantities
are in the scene's LAMMPS units; energies are per unit mass.
"""

from __future__ import annotations

import math
import re
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
from eos_ref.fixes import KernelStyle, PressureEntry

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
# YAML reads a single type as a number.
TypeRange = Annotated[
    str,
    BeforeValidator(lambda types: str(types) if type(types) is int else types),
    StringConstraints(pattern=r"^[0-9*-]{1,24}$"),  # nothing that LAMMPS could take for another word or command
    WithJsonSchema({"type": ["string", "integer"]}),
]
LocalFile = Annotated[str, AfterValidator(_inside)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class AtomType(_Model):
    """One atom type: mass, and the equilibrium density and speed of sound of fix rheo (default 1)."""

    mass: Positive
    rho0: Positive | None = None
    cs: Positive | None = None


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


class Lattice(_Model):
    """Particles on a lattice that fills the periodic box, moved by seeded uniform disorder."""

    lattice: LatticeStyle
    spacing: Positive = Field(description="nearest lattice constant (distance)")
    cells: tuple[int, ...] = Field(description="unit cells along each axis")
    disorder: Annotated[Finite, Field(ge=0, lt=0.5)] = Field(
        0.0, description="largest displacement along an axis, as a fraction of the spacing"
    )

    @model_validator(mode="after")
    def _size(self) -> Lattice:
        wanted = 2 if self.lattice in PLANAR else 3
        if len(self.cells) != wanted:
            raise ValueError(f"cells needs {wanted} numbers for {self.lattice}, found {len(self.cells)}")
        if min(self.cells) < 1:
            raise ValueError(f"the scene is empty: cells must be at least 1 along each axis, found {self.cells}")
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


class Evolve(_Model):
    """Time steps that LAMMPS takes before the comparison."""

    steps: int = Field(ge=1, le=100_000, strict=True)
    timestep: Positive
    velocity: Finite = Field(0.0, description="largest component of seeded random initial velocities")


class EngineSettings(_Model):
    """Settings of LAMMPS that do not change what is documented to come out."""

    kernel: KernelStyle = "quintic"
    cut: Positive | None = Field(None, description="kernel cutoff; default 3 spacings")
    zmin: int = Field(0, ge=0, strict=True)
    viscosity: Positive = 0.1
    newton: bool = True
    time_limit: Annotated[Finite, Field(gt=0, le=3600)] = Field(60.0, description="seconds")


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
    rho_sum: bool = Field(False, description="density summed by LAMMPS (fix rheo rho/sum)")
    evolve: Evolve | None = None
    compare: tuple[Literal["pressure"], ...] = Field(("pressure",), min_length=1)
    engine: EngineSettings = EngineSettings()
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
        return self

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
        return self.energy is not None or any(law.style == "ideal/gas" for law in self.pressure)

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
