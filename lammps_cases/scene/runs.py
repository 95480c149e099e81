"""Runs of a scene, and the expected engine messages: stops, settings, a second run as a twin, required refusals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from eos_ref.model.units import UnitStyle
from lammps_cases.scene.values import NUMBER, BrokenRule, Dim, Finite, Positive, SceneModel, TypeRange, Vector

# Operations on the state at a stop, and why it must come out unchanged.
Route = Literal[
    "run",  # the next run begins with its own set-up
    "restart",  # write_restart, clear, read_restart: a binary file holds every attribute of an atom
    "data",  # write_data, clear, read_data: a text file holds them to the digits that it has
    "data nofix",  # the same without the fixes' sections in the file
    "redefined",  # fixes, compute and pair style removed and defined again: they hold no part of the state
    "other scene",  # write_restart, another scene in the same process, read_restart: clear leaves nothing behind
    "refused command",  # commands that LAMMPS refuses, one of them a run: a refusal changes nothing
    "minimize",  # a minimisation without iterations: it moves no atom and does not invoke the fixes
    "replicated",  # the box replicated once in each direction, which is the box
    "set",  # every attribute set to the value that it has
    "recreated",  # the last quarter of the atoms deleted, created again and set
    "by hand",  # a data file written line by line, as the manual describes it, clear, read_data
    "replaced",  # fix rheo defined again under its id, with other densities and speeds of sound for an evaluation
    "continued",  # the next run goes on without a set-up (pre no), by the time step that the stop gives
    "dt/reset",  # fix dt/reset sets the time step, at the set-up of the next run
]
ROUTES: tuple[Route, ...] = get_args(Route)
AS_TEXT: tuple[Route, ...] = ("data", "data nofix")
FROM_FILE: tuple[Route, ...] = ("restart", *AS_TEXT, "other scene", "by hand")
REDEFINED: tuple[Route, ...] = (*AS_TEXT, "redefined", "by hand")
MOST_RANKS = 64  # of one LAMMPS on one machine
QUARTER = 4  # one atom in this many is recreated
LOSES_MASSES: tuple[Route, ...] = (*AS_TEXT, "replicated", "recreated", "by hand")  # particles' own masses
FOR_EACH_ATOM: tuple[Route, ...] = ("set", "recreated", "by hand")  # commands that hold LAMMPS' values of every atom
Factor = Annotated[Finite, Field(ge=0.5, le=2.0), NUMBER]
Boundary = Literal["f", "s", "m", "fs", "sf", "fm", "mf", "sm", "ms"]


class Displacement(SceneModel):
    """A move of some atoms by displace_atoms."""

    x: Annotated[Finite, Dim("x")] = 0.0
    y: Annotated[Finite, Dim("x")] = 0.0
    z: Annotated[Finite, Dim("x")] = 0.0
    types: TypeRange | None = Field(None, description="default: all")

    @property
    def vector(self) -> tuple[float, float, float]:
        """Return the displacement."""
        return self.x, self.y, self.z


class Stretch(SceneModel):
    """A box whose edges change by factors, the lower corner staying, and all positions with them (change_box)."""

    x: Factor = 1.0
    y: Factor = 1.0
    z: Factor = 1.0

    @property
    def factors(self) -> tuple[float, float, float]:
        """Return the factors of the edges."""
        return self.x, self.y, self.z


class Stop(SceneModel):
    """A step at which a run ends and another begins, with a set-up of its own."""

    at: int = Field(ge=0, strict=True, description="step")
    by: Route = Field("run", description="what the state goes through")
    timestep: Annotated[Positive | None, Dim("time")] = Field(None, description="from here on")
    count: int | None = Field(None, ge=0, strict=True, description="LAMMPS counts on from here (reset_timestep)")
    displace: Displacement | None = None
    stretch: Stretch | None = None

    @model_validator(mode="after")
    def _by(self) -> Stop:
        if self.by == "dt/reset" and self.timestep is None:
            raise BrokenRule("dt/reset needs the time step that it sets", "timestep")
        if self.by == "continued" and (self.displace or self.stretch):
            raise BrokenRule("continued goes with neither displace nor stretch, which need a set-up", "by")
        return self

    def count_recreated_atoms(self, natoms: int) -> int:
        """Return how many atoms, those of the highest ids, are created again, or all if the fixes are redefined."""
        return natoms if self.by in REDEFINED else max(1, natoms // QUARTER) if self.by == "recreated" else 0


def counted(steps: tuple[int, ...], stops: tuple[Stop, ...]) -> tuple[int, ...]:
    """Return LAMMPS' own count at some steps, which a stop may set."""
    ahead = {stop.at: stop.count - stop.at for stop in stops if stop.count is not None}
    return tuple(step + next((ahead[at] for at in sorted(ahead, reverse=True) if at <= step), 0) for step in steps)


def upper_corners(stops: Sequence[Stop], low_c: Sequence[float], high_c: Sequence[float]) -> dict[int, list[float]]:
    """Return the upper corner of the box from every stop on at which it is stretched."""
    corners, last_c = {}, list(high_c)
    for stop in stops:
        if stop.stretch:
            ends = zip(low_c, last_c, stop.stretch.factors, strict=True)
            corners[stop.at] = last_c = [
                low + factor * (high - low) if factor != 1 else high for low, high, factor in ends
            ]
    return corners


class Rebuild(SceneModel):
    """When neighbour lists are rebuilt."""

    every: int = Field(1, ge=1, strict=True)
    delay: int = Field(0, ge=0, strict=True)
    check: bool = True

    @model_validator(mode="after")
    def _multiple(self) -> Rebuild:
        if self.delay % self.every:
            raise BrokenRule("delay must be 0 or a multiple of every", "delay", found=f"{self.delay} and {self.every}")
        return self


class EngineSettings(Rebuild):
    """Settings of LAMMPS that do not change what is documented to come out."""

    newton: bool = True
    newton_bond: bool | None = Field(None, description="newton of bonds; default: that of pairs")
    skin: Annotated[Positive, NUMBER] = Field(0.3, description="of neighbour lists, in spacings")
    ghosts: Annotated[Positive | None, NUMBER] = Field(
        None,
        description="distance from a process at which it has images and others' particles, in spacings",
    )
    ranks: int = Field(1, ge=1, le=MOST_RANKS, strict=True)
    processors: tuple[int, int, int] | None = Field(None, description="how processes share the box; default: LAMMPS'")
    communication: Literal["brick", "tiled"] = "brick"
    balance: Annotated[int, Field(ge=1, strict=True)] | None = Field(
        None,
        description="steps after which particles are distributed again to processes, which is done before the first",
    )
    sort: Annotated[int, Field(ge=0, strict=True)] | None = Field(
        None, description="steps after which particles are sorted in memory; 0: never"
    )
    search: Literal["bin", "nsq", "multi"] = Field("bin", description="how lists of neighbours are built")
    boundary: Boundary = Field(
        "f", description="of faces that are not periodic: one for both, or the lower and the upper one"
    )
    time_limit: Annotated[Finite, Field(gt=0, le=3600), NUMBER] = Field(60.0, description="seconds")

    @model_validator(mode="after")
    def _shared(self) -> EngineSettings:
        if self.processors is not None and math.prod(self.processors) != self.ranks:
            raise BrokenRule(
                f"processors must be as many as ranks ({self.ranks})", "processors", found=list(self.processors)
            )
        if self.balance is not None and self.communication != "tiled":  # the style shift rounds positions
            raise BrokenRule("balance (style rcb) needs communication tiled", "balance", found=self.communication)
        return self

    @property
    def newton_flags(self) -> tuple[bool, bool]:
        """Return newton of pairs and of bonds."""
        return self.newton, self.newton if self.newton_bond is None else self.newton_bond


Edges = Annotated[int, Field(ge=-8, le=8, strict=True)]


class TwinSettings(SceneModel):
    """A second run of LAMMPS, its own first one the reference: exactly one of the keys; see `lammps_cases.setup`."""

    translate: Annotated[Vector | None, Dim("x")] = Field(
        None, description="displacement of all particles, wrapped in periodic axes"
    )
    boost: Annotated[Vector | None, Dim("v")] = Field(
        None, description="velocity added to all particles, walls included"
    )
    relabel: Literal[True] | None = Field(None, description="ids assigned again at random (seeded)")
    rescale: Annotated[Positive | None, NUMBER] = Field(
        None, description="lengths times a power of two; densities and velocities stay"
    )
    units: UnitStyle | None = Field(None, description="everything measured in another system of units")
    newton: Annotated[bool, Field(strict=True)] | None = Field(None, description="the other setting")
    skin: Annotated[Positive | None, NUMBER] = Field(None, description="another skin, in spacings")
    rebuild: Rebuild | None = Field(None, description="neighbour lists built at other steps")
    split: Literal[True] | None = Field(None, description="one run against two, the second with pre no")
    ranks: Annotated[int, Field(ge=2, le=MOST_RANKS, strict=True)] | None = Field(
        None, description="several processes against one"
    )
    tilt: tuple[Edges] | tuple[Edges, Edges, Edges] | None = Field(
        None, description="by how many whole edges the box is tilted further: xy in 2D; xy, xz and yz in 3D"
    )

    @model_validator(mode="after")
    def _exactly_one(self) -> TwinSettings:
        given = [key for key in type(self).model_fields if getattr(self, key) is not None]
        if len(given) != 1:
            raise BrokenRule(f"needs exactly one of {', '.join(type(self).model_fields)}", found=" ".join(given) or 0)
        if self.rescale is not None and not 2.0**-20 <= self.rescale <= 2.0**20:
            raise BrokenRule("rescale must lie within 2^-20 to 2^20", "rescale", found=self.rescale)
        if self.rescale is not None and (math.frexp(self.rescale)[0] != 0.5 or self.rescale == 1):
            raise BrokenRule("rescale must be a power of two other than 1", "rescale", found=self.rescale)
        if self.tilt is not None and not any(self.tilt):
            raise BrokenRule("tilt must be other than 0 for some edge", "tilt", found=list(self.tilt))
        return self

    @property
    def kind(self) -> str:
        """Return the key given."""
        return next(key for key in type(self).model_fields if getattr(self, key) is not None)


class Expect(SceneModel):
    """How LAMMPS must refuse the scene."""

    refused: str = Field(min_length=8, description="text that LAMMPS' error message must contain")

    @model_validator(mode="after")
    def _specific(self) -> Expect:
        if len(self.refused.replace("ERROR", "").strip(" :")) < 8:
            raise BrokenRule("refused must hold words that only this refusal has", "refused", found=repr(self.refused))
        return self
