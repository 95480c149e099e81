"""The scene model and the checks across its parts."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from eos_ref import EOSTable, InputError, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.model.box import TILTED
from eos_ref.model.quantities import keyword_of
from eos_ref.model.units import UNITS, UnitStyle
from eos_ref.syntax.manual import FIRST, Manual
from eos_ref.syntax.ranges import type_range
from lammps_cases.scene.fields import FieldName
from lammps_cases.scene.manual import ExampleSettings, Violation
from lammps_cases.scene.particles import (
    PLANAR,
    AtomType,
    FromFile,
    Lattice,
    LawSettings,
    Positions,
    PowerLaw,
    Values,
    Velocity,
    check_tilt,
)
from lammps_cases.scene.runs import AS_TEXT, FOR_EACH_ATOM, LOSES_MASSES, EngineSettings, Expect, Stretch, TwinSettings
from lammps_cases.scene.settings import DeformSettings, Evolve, ForceSettings, PairSettings, RheoSettings
from lammps_cases.scene.values import BrokenRule, Dim, SceneModel, lists

METHOD_KEYS = ("method", "tolerance")  # of the Python interface; a scene is judged with the reference's own method
MAX_ATOMS = 10_000_000
# Locations of broken rules about time steps.
STOPS, DEFORM = ("evolve", "stops"), ("evolve", "deform")


class Scene(SceneModel):
    """One case. See `lammps_cases/data/cases` for examples."""

    manual: Manual = Field(FIRST, description="version of the manual that the reference follows, set by the engine")
    units: UnitStyle = "lj"
    dimension: Literal[2, 3]
    types: tuple[AtomType, ...] = Field(min_length=1)
    positions: Positions
    arrangement: Literal["shuffled", "blocks"] = Field(
        "shuffled", description="how types, in equal shares, are dealt out to the particles"
    )
    pressure: tuple[LawSettings, ...] = Field(description="entries of fix rheo/pressure, in order")
    mass: Annotated[Values | None, Dim("mass")] = Field(
        None, description="masses of the particles instead of their types' (fix property/atom rmass)"
    )
    rho: Annotated[Values | None, Dim("rho")] = Field(
        None, description="density; not given if a file or the summation sets it"
    )
    energy: Annotated[Values | None, Dim("latent heat")] = Field(
        None, description="internal energy per unit mass (ideal/gas)"
    )
    velocity: Velocity = Velocity()
    rheo: RheoSettings = RheoSettings()
    pair: PairSettings = PairSettings()
    forces: tuple[ForceSettings, ...] = Field((), max_length=16)
    evolve: Evolve | None = None
    compare: tuple[FieldName, ...] = Field(
        ("pressure",), min_length=1, description="fields by LAMMPS' names; anything but pressure: the whole model"
    )
    engine: EngineSettings = EngineSettings()
    twin: TwinSettings | None = Field(None, description="compare LAMMPS with a second run of its own")
    violate: Violation | None = None
    example: ExampleSettings | None = Field(None, description="an example line of the manual, given to LAMMPS as it is")
    expect: Expect | None = None

    @model_validator(mode="before")
    @classmethod
    def _without_method(cls, content: Any) -> Any:
        """Reject the keys that choose a method, and name the location of one."""
        for key in METHOD_KEYS:
            if isinstance(content, Mapping) and key in content:
                raise BrokenRule(
                    f"{key} is no key of a scene, which is judged by the reference's own body: choose a method by "
                    'EOS.pressure(rho, method="auto", tolerance=1e-9) in Python, and compare methods by eos-ref chart',
                    key,
                )
        return content

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        if isinstance(self.positions, Lattice):
            planar = self.positions.lattice in PLANAR
            if planar != (self.dimension == 2):
                raise BrokenRule(
                    f"lattice {self.positions.lattice} does not fit dimension {self.dimension}", "positions", "lattice"
                )
            atoms = math.prod(self.positions.cells) * {"hex": 2, "bcc": 2, "fcc": 4}.get(self.positions.lattice, 1)
            if atoms > MAX_ATOMS:
                raise BrokenRule(f"at most {MAX_ATOMS} particles", "positions", "cells", found=atoms)
        if self.violate and not self.expect:
            raise BrokenRule("violate needs expect: {refused: TEXT}", "violate")
        for key in ("rho0", "cs"):
            given = [getattr(t, key) is not None for t in self.types]
            if any(given) and not all(given):
                raise BrokenRule(f"{key} must be given for every type or for none (fix rheo takes N values)", "types")
        self._check_types()
        self._check_lengths()
        if self.velocity.values is not None and any(t.velocity for t in self.types):
            raise BrokenRule("velocity.values stands instead of the velocity of a type", "velocity", "values")
        self._check_compare()
        self._check_stops()
        if self.evolve and self.evolve.deform:
            self._check_deform(self.evolve.deform)
        if self.twin:
            self._check_twin(self.twin)
        if self.example:
            self._check_example(self.example)
        return self

    def _check_example(self, example: ExampleSettings) -> None:
        if self.twin or self.violate:
            raise BrokenRule("example goes with neither twin nor violate, which change the line", "example")
        try:
            same = self._says(example)
        except InputError:
            return  # the line violates the manual's own syntax: no keys can state the same
        if not same:
            raise BrokenRule("the keys of the scene must say what the manual's line says", "example")

    def _says(self, example: ExampleSettings) -> bool:
        if line := example.line("pressure"):
            return parse_fix_rheo_pressure(line) == tuple(law.entry for law in self.pressure)
        fix = parse_fix_rheo(example.line("rheo") or "", len(self.types))
        plain = RheoSettings(cut=fix.cut, kernel=fix.kernel, zmin=fix.zmin)
        return self.rheo == plain and (self.thermal, self.rho0, self.cs) == (fix.thermal, fix.rho0, fix.cs)

    def _check_twin(self, twin: TwinSettings) -> None:
        if self.expect or not self.whole_model:
            raise BrokenRule("twin compares fields of the whole model: it needs more in compare than pressure", "twin")
        if twin.boost is not None and self.rheo.shift:
            raise BrokenRule(
                "twin.boost: shifting follows the speed of each particle, which depends on the frame", "twin", "boost"
            )
        if twin.boost is not None and "press" in self.compare:
            raise BrokenRule("twin.boost: press has a kinetic part, which depends on the frame", "twin", "boost")
        if twin.translate is not None and getattr(self.positions, "tilt", None):
            raise BrokenRule("twin.translate needs a box without tilt: take twin.tilt", "twin", "translate")
        if twin.tilt is not None:
            check_tilt(twin.tilt, getattr(self.positions, "periodic", None), self.dimension, "twin")
        if twin.split and (self.evolve is None or self.evolve.steps < 2):
            raise BrokenRule("twin.split needs two time steps or more", "twin", "split")
        if twin.split and self.evolve and self.evolve.every:
            raise BrokenRule(
                "twin.split goes without evolve.every, whose runs begin with set-ups that pre no leaves out",
                "twin",
                "split",
            )
        if twin.kind in ("newton", "skin", "ranks") and getattr(twin, twin.kind) == getattr(self.engine, twin.kind):
            raise BrokenRule(f"twin.{twin.kind} must differ from engine.{twin.kind}", "twin", twin.kind)
        if twin.units is not None:
            if twin.units == self.units:
                raise BrokenRule("twin.units must differ from units", "twin", "units")
            self._check_units(twin.units, "twin")
        if twin.rescale is not None:
            octaves = int(math.log2(twin.rescale))
            for law in (t.viscosity for t in self.types if isinstance(t.viscosity, PowerLaw)):
                if (Fraction(law.n) * octaves).denominator != 1:
                    raise BrokenRule(
                        f"twin.rescale must be exact: rescale to the power of n ({law.n!r}) is not", "twin", "rescale"
                    )

    def _check_units(self, units: UnitStyle, *above: str) -> None:
        if UNITS[units].consistent:
            return
        if self.dimension == 2:
            raise BrokenRule(
                f"units {units} need dimension 3: in a plane their pressures have no unit", *above, "units"
            )
        if not self.whole_model:
            raise BrokenRule(
                f"units {units} need more in compare than pressure: an equation of state alone is judged in numbers "
                "that are consistent, as those of lj, si, cgs, micro and nano",
                *above,
                "units",
            )

    def _check_types(self) -> None:
        n = len(self.types)
        for region in getattr(self.positions, "regions", ()):
            if region.type is not None and region.type > n:
                raise BrokenRule(
                    f"type of a region must lie within 1 to {n}", "positions", "regions", found=region.type
                )
        for types in self.rheo.shifting.exclude if self.rheo.shifting else ():
            _check_range(types, n, "rheo", "shift")
        for k, force in enumerate(self.forces):
            _check_range(force.types or "*", n, "forces", k, "types")
        if any(t.thermal for t in self.types) and self.energy is None and not isinstance(self.positions, FromFile):
            raise BrokenRule("conductivity, specific_heat, latent_heat and T_freeze need energy", "types")

    def _check_lengths(self) -> None:
        members = {"axis": self.dimension, "type": len(self.types)}
        for path, per, given in lists(self):
            if len(given) != members[per.of]:
                key = ".".join(part for part in path if isinstance(part, str))
                raise BrokenRule(f"{key} needs {members[per.of]} {per.members}", *path, found=len(given))

    def _check_stops(self) -> None:
        stops = self.evolve.stops if self.evolve else ()
        if stops and (not self.whole_model or self.expect):
            raise BrokenRule("stops compares fields of the whole model: it needs more in compare than pressure", *STOPS)
        if stops and self.twin:
            raise BrokenRule("stops go with no twin, whose runs are compared with each other", *STOPS)
        for stop in stops:
            if stop.by in FOR_EACH_ATOM and self.engine.ranks > 1:
                raise BrokenRule(
                    f"stops: {stop.by} needs all atoms on one rank", *STOPS, found=f"{self.engine.ranks} ranks"
                )
            if self.mass and stop.by in LOSES_MASSES:
                raise BrokenRule(f"stops: {stop.by} does not keep the per-particle masses given by mass", *STOPS)
            if self.mass and stop.stretch and stop.by == "restart":  # LAMMPS' rule, until the next run has begun
                raise BrokenRule("stretch needs another stop than a restart with per-particle masses", *STOPS)
            if stop.by == "replaced":
                self._check_replaced()
            changes = self.evolve and (self.evolve.deform or any(other.stretch for other in stops))
            if stop.by == "by hand" and (changes or getattr(self.positions, "tilt", None)):
                raise BrokenRule("stops: by hand needs a box that is upright and stays as it is", *STOPS)
            if stop.stretch:
                self._check_stretch(stop.stretch)
            if stop.displace:
                _check_range(stop.displace.types or "*", len(self.types), *STOPS)
                if stop.displace.z and self.dimension == 2:
                    raise BrokenRule("displace.z must be 0 in 2D", *STOPS, found=stop.displace.z)

    def _check_replaced(self) -> None:
        if not (self.rho0 and self.cs):
            raise BrokenRule("stops: replaced needs rho0 and cs, in whose place others come", *STOPS)
        # The evaluation with the replaced values leaves other densities.
        if self.rheo.interface_reconstruct or self.rheo.rho_sum:
            raise BrokenRule("stops: replaced goes with neither interface_reconstruct nor rho_sum", *STOPS)

    def _check_stretch(self, stretch: Stretch) -> None:
        if stretch.z != 1 and self.dimension == 2:
            raise BrokenRule("stretch.z must be 1 in 2D", *STOPS, found=stretch.z)
        if getattr(self.positions, "tilt", None):
            raise BrokenRule("stretch needs a box without tilt", *STOPS)
        self._check_faces("stretch", *STOPS)

    def _check_faces(self, key: str, *at: str) -> None:
        """Check that a box can change its size."""
        if self.engine.boundary != "f":  # LAMMPS sets such faces itself
            raise BrokenRule(
                f"{key} needs faces that are periodic or fixed", *at, found=f"boundary {self.engine.boundary}"
            )

    def _check_deform(self, deform: DeformSettings) -> None:
        assert self.evolve is not None
        if not self.whole_model or self.expect:
            raise BrokenRule(
                "deform compares fields of the whole model: it needs more in compare than pressure", *DEFORM
            )
        if deform.z and self.dimension == 2:
            raise BrokenRule("deform.z must be 0 in 2D", *DEFORM, "z", found=deform.z)
        self._check_shear(deform)
        self._check_faces("deform", *DEFORM)
        for stop in self.evolve.stops:
            if stop.stretch or stop.by in AS_TEXT:
                raise BrokenRule(
                    "deform goes with neither stretch nor a stop by data", *DEFORM, found=f"one at {stop.at}"
                )
        if self.twin and self.twin.kind in ("translate", "boost", "tilt"):
            raise BrokenRule(
                f"deform: a box that grows about its middle is another one under twin.{self.twin.kind}", *DEFORM
            )

    def _check_shear(self, deform: DeformSettings) -> None:
        if self.dimension == 2 and (deform.xz or deform.yz):
            found = f"{deform.xz!r} and {deform.yz!r}"
            raise BrokenRule("deform.xz and deform.yz must be 0 in 2D", *DEFORM, found=found)
        periodic = getattr(self.positions, "periodic", None) or (True,) * self.dimension
        for rate, axes in zip(deform.shears, TILTED, strict=True):
            if rate and not all(periodic[a] for a in axes):
                raise BrokenRule(
                    "deform: xy, xz and yz must be 0 but between periodic axes", *DEFORM, found=deform.shears
                )
        if deform.remap != "v":
            return
        assert self.evolve is not None
        if self.rheo.shift:
            raise BrokenRule("deform: remap v goes without shift, which follows the speed of each image", *DEFORM)
        if "press" in self.compare:
            raise BrokenRule("deform: press has a kinetic part, which with remap v depends on the image", *DEFORM)
        if "v" in self.compare and "x" not in self.compare:
            raise BrokenRule(
                "deform: with remap v compare v needs compare x, which tells the image that v is of", *DEFORM
            )
        if self.evolve.stops:
            raise BrokenRule("deform: remap v goes without stops", *DEFORM, found=f"one at {self.evolve.halts[0]}")

    def _check_compare(self) -> None:
        if len(set(self.compare)) < len(self.compare):
            raise BrokenRule("compare must name each field once", "compare")
        volume = {"virial", "press"}.intersection(self.compare)
        closed = not isinstance(self.positions, FromFile) and all(self.positions.periodic or (True,))
        if volume and "s" in self.engine.boundary and not closed:
            raise BrokenRule(
                f"{min(volume)} needs engine.boundary without s: a box that shrinks has its own volume", "compare"
            )
        self._check_units(self.units)
        given = {
            "interface/reconstruct": ("rheo.interface_reconstruct", self.rheo.interface_reconstruct),
            "shift": ("rheo.shift", self.rheo.shift),
            "surface/detection": ("rheo.surface_detection", self.rheo.surface_detection),
            "thermal": ("energy", self.thermal),
        }
        for field in self.compare:
            keyword = keyword_of(field)
            if keyword and not given[keyword][1]:
                raise BrokenRule(f"compare: {field} needs {given[keyword][0]}", "compare")

    @property
    def rho0(self) -> tuple[float, ...] | None:
        """Return the equilibrium densities per type; None: fix rheo's default of 1."""
        values = tuple(t.rho0 for t in self.types if t.rho0 is not None)
        return values or None

    @property
    def cs(self) -> tuple[float, ...] | None:
        """Return the speeds of sound per type; None: fix rheo's default of 1."""
        values = tuple(t.cs for t in self.types if t.cs is not None)
        return values or None

    @property
    def defaults(self) -> tuple[str, ...]:
        """Return the material constants that are not given although the laws and fields compared depend on them."""
        no = {
            "rho0 = 1": self.rho0 is None,
            "cs = 1": self.cs is None and any(law.takes_cs for law in self.pressure),
            "viscosity = 0.1": self.whole_model and any("viscosity" not in t.model_fields_set for t in self.types),
        }
        return tuple(text for text, taken in no.items() if taken)

    @property
    def thermal(self) -> bool:
        """Return whether particles carry energy (atom_style rheo/thermal)."""
        gas = any(law.needs_energy for law in self.pressure)
        return self.energy is not None or gas or any(t.thermal for t in self.types)

    @property
    def rho_sum(self) -> bool:
        """Return whether the density is summed over neighbours."""
        return self.rheo.rho_sum

    @property
    def files(self) -> tuple[str, ...]:
        """Return the other files that a scene is read from."""
        positions = (self.positions.file,) if isinstance(self.positions, FromFile) else ()
        tables = (values.table for values in (self.mass, self.rho, self.energy) if values)
        return (*positions, *(table.csv for table in tables if table))

    @property
    def whole_model(self) -> bool:
        """Return whether the particle model is compared, not only the equation of state."""
        return self.compare != ("pressure",) or (self.evolve is not None and self.evolve.compare_at is not None)

    @property
    def remaps_velocities(self) -> bool:
        """Return whether periodic images move with the box (fix deform, remap v)."""
        return bool(self.evolve and self.evolve.deform and self.evolve.deform.remap == "v")

    @property
    def interacts(self) -> bool:
        """Return whether particles have neighbours."""
        return self.whole_model or self.rho_sum or self.evolve is not None

    @property
    def snapshots(self) -> tuple[int, ...]:
        """Return the steps at which fields are compared; for an equation of state, only the last one."""
        if self.evolve is None:
            return (0,)
        return self.evolve.snapshots if self.whole_model else (self.evolve.steps,)

    @property
    def counts(self) -> tuple[int, ...]:
        """Return LAMMPS' own count at the compared steps; `reset_timestep` may set it."""
        return self.evolve.counted(self.snapshots) if self.evolve else self.snapshots

    def eos(self, where: str = "") -> EOSTable:
        """Return the reference's laws of all types.

        Raises
        ------
        InputError
            A type without law, a bad range or parameter.
        """
        return resolve([law.entry for law in self.pressure], len(self.types), self.rho0, self.cs, where)


NAME = re.compile(r"[a-z0-9]+(?:[-+][a-z0-9]+)*")


def check_name(name: str) -> None:
    """Check a part of a case's name: lower-case words joined by hyphens.

    Raises
    ------
    InputError
        Another character, or more than 60.
    """
    if not NAME.fullmatch(name) or len(name) > 60:
        raise InputError("name", "must be at most 60 lower-case letters, digits, hyphens and +", name)


def _check_range(types: str, ntypes: int, *at: str | int) -> None:
    try:
        type_range(types, ntypes)
    except InputError as error:
        raise BrokenRule(f"type range {error.rule}", *at, found=repr(types)) from None
