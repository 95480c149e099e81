"""Stops of a run: where one run of LAMMPS ends, what is done to its state, and the next run begins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from lammps_cases.scene.values import BrokenRule, Finite, Positive, SceneModel, TypeRange

# What the state goes through at a stop, and why it must come out as it was.
Route = Literal[
    "run",  # the next run begins with a set-up of its own
    "restart",  # write_restart, clear, read_restart: a binary file holds every attribute of an atom
    "data",  # write_data, clear, read_data: a text file holds them to the digits that it has
    "data nofix",  # the same without what fixes add to the file
    "redefined",  # fixes, compute and pair style taken away and defined anew: they hold no part of the state
    "other scene",  # write_restart, another scene in the same process, read_restart: clear leaves nothing behind
    "refused command",  # commands that LAMMPS refuses, one of them a run: a refusal changes nothing
    "minimize",  # a minimisation without iterations: it moves no atom and does not invoke the fixes
    "replicated",  # the box replicated once in each direction, which is the box
    "set",  # every attribute set to the value that it has
    "recreated",  # the last quarter of the atoms deleted, created anew and set
    "by hand",  # a data file written line by line, as the manual describes it, clear, read_data
    "replaced",  # fix rheo defined again under its id, with other densities and speeds of sound for an evaluation
    "continued",  # the next run goes on without a set-up (pre no), by the time step that the stop gives
    "dt/reset",  # fix dt/reset sets the time step, at the set-up of the next run
]
ROUTES: tuple[Route, ...] = get_args(Route)
AS_TEXT: tuple[Route, ...] = ("data", "data nofix")
FROM_FILE: tuple[Route, ...] = ("restart", *AS_TEXT, "other scene", "by hand")
DEFINED_ANEW: tuple[Route, ...] = (*AS_TEXT, "redefined", "by hand")
QUARTER = 4  # of all atoms, those recreated are one part in so many
LOSES_MASSES: tuple[Route, ...] = (*AS_TEXT, "replicated", "recreated", "by hand")  # that particles have of their own
FOR_EACH_ATOM: tuple[Route, ...] = (
    "set",
    "recreated",
    "by hand",
)  # commands that hold LAMMPS' own values of every atom


Factor = Annotated[Finite, Field(ge=0.5, le=2.0)]


class Displacement(SceneModel):
    """A move of some atoms by displace_atoms."""

    x: Finite = 0.0
    y: Finite = 0.0
    z: Finite = 0.0
    types: TypeRange | None = Field(None, description="default: all")

    @property
    def vector(self) -> tuple[float, float, float]:
        """Return what is added to the positions."""
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
    timestep: Positive | None = Field(None, description="from here on")
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

    def renews(self, natoms: int) -> int:
        """Return how many atoms, those of the highest ids, are created anew, or all if the fixes are defined anew."""
        return natoms if self.by in DEFINED_ANEW else max(1, natoms // QUARTER) if self.by == "recreated" else 0


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
