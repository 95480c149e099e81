"""Computation settings of a scene: arguments of the RHEO fixes and of pair_style rheo, forces, time steps."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from eos_ref.kernels.styles import KernelStyle
from eos_ref.model.box import Remap
from eos_ref.syntax.fixes import SurfaceStyle
from eos_ref.syntax.manual import weighs_distance
from lammps_cases.scene.runs import Stop, counted
from lammps_cases.scene.values import (
    NUMBER,
    PER_AXIS,
    RANGE_SCHEMA,
    BrokenRule,
    Dim,
    Finite,
    NonNegative,
    Positive,
    Powers,
    SceneModel,
    TypeRange,
)

if TYPE_CHECKING:
    from lammps_cases.scene.case import Scene

SNAPSHOTS = (0, 1, 10, 100)  # steps compared by default: the set-up, the first step, and the growth of rounding


class SurfaceDetectionSettings(SceneModel):
    """Arguments of surface/detection."""

    style: SurfaceStyle
    limit: Annotated[Finite, NUMBER]
    splash: int = Field(strict=True)

    @model_validator(mode="after")
    def _whole(self) -> SurfaceDetectionSettings:
        if self.style == "coordination" and not self.limit.is_integer():
            raise BrokenRule("limit of coordination counts neighbours: a whole number", "limit", found=self.limit)
        return self


def _several(types: object) -> object:
    return types if isinstance(types, list | tuple) else (types,)


_ONE_OR_MORE = {"oneOf": [RANGE_SCHEMA, {"type": "array", "items": RANGE_SCHEMA}]}


def _wmin(_: object, scene: Scene) -> Powers:
    return ("kernel", 1.0), ("x", float(weighs_distance(scene.manual)))


class ShiftSettings(SceneModel):
    """Arguments of shift."""

    exclude: Annotated[tuple[TypeRange, ...], BeforeValidator(_several), WithJsonSchema(_ONE_OR_MORE)] = Field(
        (), description="types that are not shifted: a range, or a list of them"
    )
    scale_cross_type: Annotated[
        tuple[Finite, Finite, Finite] | None,
        Dim("number", "number", _wmin, about="unit of wmin: of kernel values, or kernel values times distances"),
    ] = Field(None, description="shiftscale, cmin, wmin")


OnOrShift = Annotated[
    Annotated[bool, Field(strict=True), Tag("on or off")] | Annotated[ShiftSettings, Tag("with arguments")],
    Discriminator(lambda shift: "with arguments" if isinstance(shift, dict | ShiftSettings) else "on or off"),
]


class RheoSettings(SceneModel):
    """Arguments of fix rheo, except those of the types."""

    kernel: KernelStyle = "quintic"
    cut: Annotated[Positive | None, Dim("x")] = Field(None, description="kernel cutoff; default 3 spacings")
    zmin: int = Field(0, ge=0, strict=True)
    rho_sum: bool = Field(False, description="density summed over neighbours (rho/sum)")
    self_mass: bool = Field(False, description="argument of rho/sum")
    interface_reconstruct: bool = False
    surface_detection: SurfaceDetectionSettings | None = None
    shift: OnOrShift = False

    @model_validator(mode="after")
    def _arguments(self) -> RheoSettings:
        if self.self_mass and not self.rho_sum:
            raise BrokenRule("self_mass is an argument of rho_sum, which is off", "self_mass")
        return self

    @property
    def shifting(self) -> ShiftSettings | None:
        """Return the arguments of shift; None: off."""
        if isinstance(self.shift, bool):
            return ShiftSettings() if self.shift else None
        return self.shift


class PairSettings(SceneModel):
    """Arguments of pair_style rheo; 0 turns a term off."""

    artificial_visc: Annotated[NonNegative, NUMBER] = 0.0
    rho_damp: Annotated[NonNegative, Dim("diffusivity")] = 0.0
    harmonic_means: bool = False


def _of_force(force: ForceSettings, _: object) -> Powers:
    return (("acceleration" if force.style == "gravity" else "f", 1.0),)


class ForceSettings(SceneModel):
    """A fix gravity, addforce or setforce, in the order of the list."""

    style: Literal["gravity", "addforce", "setforce"]
    vector: Annotated[
        tuple[Finite | None, ...], PER_AXIS, Dim(_of_force, about="unit of accelerations (gravity) or forces")
    ] = Field(description="one component per axis; null: setforce leaves it")
    types: TypeRange | None = Field(None, description="default: all")

    @model_validator(mode="after")
    def _complete(self) -> ForceSettings:
        if self.style != "setforce" and None in self.vector:
            raise BrokenRule(f"{self.style} needs a number for every component", "vector")
        return self


Rate = Annotated[Finite, Dim(lambda *_: (("time", -1.0),), about="unit: 1/time")]


class DeformSettings(SceneModel):
    """A box that grows and tilts while particles move (fix deform 1, styles erate): engineering strain rates."""

    x: Rate = 0.0
    y: Rate = 0.0
    z: Rate = 0.0
    xy: Rate = 0.0
    xz: Rate = 0.0
    yz: Rate = 0.0
    remap: Remap = Field(
        "x", description="positions grow with the box (x), velocities change at its faces (v), or nothing does (none)"
    )

    @property
    def rates(self) -> tuple[float, float, float]:
        """Return the rates of the edges by axis."""
        return self.x, self.y, self.z

    @property
    def shears(self) -> tuple[float, float, float]:
        """Return the rates of the tilts, xy, xz and yz."""
        return self.xy, self.xz, self.yz


class Evolve(SceneModel):
    """Time steps that LAMMPS takes."""

    steps: int = Field(ge=1, le=100_000, strict=True)
    timestep: Annotated[Positive, Dim("time")]
    compare_at: tuple[Annotated[int, Field(ge=0, strict=True)], ...] | None = Field(
        None,
        min_length=1,
        description="steps compared; default: those of 0, 1, 10, 100 that there are, every stop, and the last",
    )
    stops: tuple[Stop, ...] = Field((), description="where a run ends and another begins, in order")
    every: int | None = Field(
        None, ge=1, strict=True, description="run N every M: a set-up every M steps; the last step alone is compared"
    )
    deform: DeformSettings | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Evolve:
        if self.compare_at is not None and not (
            list(self.compare_at) == sorted(set(self.compare_at)) and self.compare_at[-1] == self.steps
        ):
            raise BrokenRule(
                f"compare_at must increase and end with steps ({self.steps})", "compare_at", found=list(self.compare_at)
            )
        at = [stop.at for stop in self.stops]
        if at != sorted(set(at)) or (at and at[-1] > self.steps):
            raise BrokenRule(f"stops must increase and lie within 0 to steps ({self.steps})", "stops", found=at)
        kept = [stop.at for stop in self.stops if stop.by == "continued"]
        if kept and (self.every or self.deform):
            raise BrokenRule("stops: continued goes with neither every nor deform", "stops", found=f"one at {kept[0]}")
        timed = [stop for stop in self.stops if stop.timestep is not None]
        reset = next((k for k, stop in enumerate(timed) if stop.by == "dt/reset"), len(timed))
        if len({stop.timestep for stop in timed[reset:]}) > 1:
            given = [stop.timestep for stop in timed]
            raise BrokenRule("stops: dt/reset keeps its time step to the end", "stops", found=given)
        if any(stop.by == "dt/reset" for stop in self.stops) and any(stop.count is not None for stop in self.stops):
            raise BrokenRule("stops: dt/reset goes with no count, which LAMMPS refuses to set with it", "stops")
        if self.deform and self.every:
            raise BrokenRule(
                f"deform goes without every, whose runs all begin in a box of their own: {self.every}", "deform"
            )
        ends = (0, *at, self.steps)
        longest = self.timestep * max(end - begin for begin, end in itertools.pairwise(ends))
        if self.deform and not 1 + min(self.deform.rates) * longest > 0:
            shrunk = 1 + min(self.deform.rates) * longest
            raise BrokenRule(
                f"deform must leave every run a box: 1 + rate steps timestep is {shrunk:.3g} of an edge", "deform"
            )
        if self.every is not None and self.snapshots != (self.steps,):
            raise BrokenRule(
                f"every: such runs are read at the last step alone ({self.steps})", "every", found=list(self.snapshots)
            )
        return self

    @property
    def snapshots(self) -> tuple[int, ...]:
        """Return the steps compared."""
        if self.compare_at or self.every:
            return self.compare_at or (self.steps,)
        return tuple(sorted({*(step for step in SNAPSHOTS if step < self.steps), *self.halts, self.steps}))

    @property
    def halts(self) -> tuple[int, ...]:
        """Return the steps at which a run ends and another begins."""
        return tuple(stop.at for stop in self.stops)

    @property
    def beginnings(self) -> tuple[Stop, ...]:
        """Return the stops, and those that `every` makes between them: each of its pieces begins with a set-up."""
        begin, made = 0, list[Stop]()
        for end in sorted({*self.halts, self.steps}):
            made += [Stop(at=step) for step in range(begin, end, self.every or self.steps) if step > begin]
            begin = end
        return tuple(sorted((*self.stops, *made), key=lambda stop: stop.at))

    def counted(self, steps: tuple[int, ...]) -> tuple[int, ...]:
        """Return LAMMPS' own count at some steps."""
        return counted(steps, self.stops)
