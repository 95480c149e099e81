"""Measured limits of the time step and of tension, small enough to ship, as the basis of advice."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mode
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.model.parameters import Model
from eos_ref.model.state import State, masses
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import DATA
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability.model import Boundary, Engine, Kind, StabilityMap

FILE = DATA / "atlas-limits.json"


@dataclass(frozen=True)
class Numbers:
    r"""A time step in units of what limits it.

    ``c``, ``nu`` and ``h`` are the largest speed of sound plus flow, the largest diffusivity (kinematic viscosity,
    conductivity/(rho cv)), cut/3; ``conducts``: whether the diffusivity is that of heat. Source of the criteria:
    Morris, Fox & Zhu (1997), see `lammps_cases.studies.flows.flow.time_step`.
    """

    c: float
    nu: float
    h: float
    dt: float
    conducts: bool = False

    @property
    def acoustic(self) -> float:
        """Time step over h/4c."""
        return 4 * self.c * self.dt / self.h

    @property
    def viscous(self) -> float:
        """Time step over h^2/8nu."""
        return 8 * self.nu * self.dt / self.h**2

    @property
    def fraction(self) -> float:
        """Time step over the smaller of both."""
        return max(self.acoustic, self.viscous)

    @property
    def ratio(self) -> float:
        """nu/hc, independent of the time step: from 1/2 on viscosity limits the step."""
        return self.nu / (self.c * self.h) if self.c > 0 else math.inf


def numbers(model: Model, state: State, dt: float) -> Numbers:
    """Return the numbers of a state; particles at which the law has no speed of sound do not count."""
    types = state.type_n - 1
    rho_n = np.asarray(state.rho_n, float)
    e_n = None if state.energy_n is None else np.asarray(state.energy_n, float) / masses(model, state)
    sound_n = np.full(len(rho_n), np.nan)
    nu_n, heat_n = np.zeros(len(rho_n)), np.zeros(len(rho_n))
    for t, law in enumerate(model.eos):
        at = types == t
        sound_n[at] = law.sound_speed(rho_n[at], None if e_n is None else e_n[at])
        heat = model.thermal[t] if model.thermal is not None else None
        rho = np.where(rho_n[at] > 0, rho_n[at], np.nan)
        nu_n[at] = model.viscosity[t].eta / rho
        heat_n[at] = heat.conductivity / heat.specific_heat / rho if heat else 0.0
    speed_n = np.sqrt(np.sum(np.square(np.asarray(state.v_nc, float)), axis=1))
    nu, diffusivity = _largest(nu_n), _largest(heat_n)
    return Numbers(_largest(sound_n + speed_n), max(nu, diffusivity), model.h, dt, diffusivity > nu)


def _largest(values_n: Any) -> float:
    finite = values_n[np.isfinite(values_n)]
    return float(finite.max()) if finite.size else 0.0


@dataclass(frozen=True)
class LimitPoint:
    """A measured limit: ``fraction`` of `Numbers` between ``low`` and ``high``, at a ``ratio``."""

    ratio: float
    low: float
    high: float


@dataclass(frozen=True)
class LimitCurve:
    """Limits of one layer of a map on one engine, in the order of their ratio; ``above``: the failure beyond."""

    map: str
    layer: str
    engine: Engine
    above: Kind
    points: tuple[LimitPoint, ...]

    def at(self, ratio: float) -> LimitPoint:
        """Interpolate the limit at a ratio, in logarithms; beyond the ratios measured it is that of the nearest one."""
        ratios, *ends = np.log([(p.ratio, p.low, p.high) for p in self.points]).T
        low, high = (float(np.exp(np.interp(math.log(ratio), ratios, end))) for end in ends)
        return LimitPoint(ratio, low, high)

    def covers(self, ratio: float) -> bool:
        """Return whether a ratio lies within those measured."""
        return self.points[0].ratio <= ratio <= self.points[-1].ratio


@dataclass(frozen=True)
class Tension:
    """Interval of the mean pressure over rho0 c^2 in which particles begin to clump, with shift or without.

    Taken from the line of a layer with the weakest tension.
    """

    map: str
    layer: str
    engine: Engine
    shift: bool
    low: float
    high: float


@dataclass(frozen=True)
class Limits:
    """Limits of time step and tension of an atlas, and the LAMMPS that it was measured on."""

    engine: str
    curves: tuple[LimitCurve, ...]
    tensions: tuple[Tension, ...] = ()
    schema: str = SCHEMAS["stability-limits"]


_DOCUMENT = Document("stability-limits", Limits)


def measured(boundaries: Iterable[Boundary], maps: Mapping[str, StabilityMap], engine: str) -> Limits:
    """Extract the limits of an atlas: boundaries of stable runs along an axis of time step alone, or of pressure."""
    boundaries = [b for b in boundaries if b.map in maps]
    return Limits(engine, _curves(boundaries, maps), _tensions(boundaries, maps))


def _curves(boundaries: Sequence[Boundary], maps: Mapping[str, StabilityMap]) -> tuple[LimitCurve, ...]:
    by_layer: dict[tuple[str, str, Engine], list[tuple[LimitPoint, Kind]]] = defaultdict(list)
    for b in boundaries:
        point = _point(*_ends(b, maps)) if b.below == "stable" and b.above != "stable" else None
        if point is not None:
            by_layer[b.map, b.layer, b.engine].append((point, b.above))
    curves = []
    for layer, points in sorted(by_layer.items(), key=lambda item: item[0]):
        # Lines that differ in something other than their ratio: the lowest limit counts.
        lowest: dict[float, tuple[LimitPoint, Kind]] = {}
        for point, kind in sorted(points, key=lambda pair: pair[0].low):
            lowest.setdefault(float(f"{point.ratio:.4g}"), (point, kind))
        chosen = sorted(lowest.values(), key=lambda pair: pair[0].ratio)
        above = mode(kind for _, kind in chosen)
        curves.append(LimitCurve(*layer, above, tuple(point for point, _ in chosen)))
    return tuple(curves)


def _ends(boundary: Boundary, maps: Mapping[str, StabilityMap]) -> tuple[Start, Start]:
    """Return the starts at both ends of a boundary."""
    start = maps[boundary.map].start
    return start(boundary.cell(boundary.low)), start(boundary.cell(boundary.high))


def _point(*ends: Start) -> LimitPoint | None:
    """Return the limit between two starts that differ only in the time step."""
    if not _same(*ends) or ends[0].timestep == ends[1].timestep:
        return None
    low, high = (numbers(*_reference(start), start.timestep) for start in ends)
    if not (0 < low.fraction < math.inf and 0 < low.ratio < math.inf):
        return None
    return LimitPoint(low.ratio, low.fraction, high.fraction)


def _tensions(boundaries: Sequence[Boundary], maps: Mapping[str, StabilityMap]) -> tuple[Tension, ...]:
    by_layer: dict[tuple[str, str, Engine], Tension] = {}
    for b in boundaries:
        if (b.below, b.above) != ("clumping", "stable"):
            continue
        low, high = _ends(b, maps)
        if not _same(low, high) or low.case.scene.pressure == high.case.scene.pressure or low.timestep != high.timestep:
            continue
        key = b.map, b.layer, b.engine
        mean = (float(np.mean(pressures(*_reference(start)))) for start in (low, high))
        tension = Tension(*key, low.case.scene.rheo.shifting is not None, *mean)
        by_layer[key] = max(tension, by_layer.get(key, tension), key=lambda t: t.low)
    return tuple(by_layer[key] for key in sorted(by_layer))


def pressures(model: Model, state: State) -> FloatArray:
    """Return the pressure over rho0 c^2 of all fluid particles, except of an ideal gas, which has no rho0."""
    rho_n = np.asarray(state.rho_n, float)
    parts = [np.zeros(0)]
    for t, law in enumerate(model.eos, 1):
        if not law.needs_energy:
            own_n = (state.type_n == t) & ~state.solid_n
            parts.append(law.pressure(rho_n[own_n]) / (law.rho0 * law.cs**2))
    return np.concatenate(parts)


def _reference(start: Start) -> tuple[Model, State]:
    scene, atoms = start.case.scene, start.atoms
    return reference_side.model(scene, atoms, ""), reference_side.state(scene, atoms)


def _same(a: Start, b: Start) -> bool:
    """Return whether two starts have the same materials, methods and particles."""
    if any(getattr(a.case.scene, name) != getattr(b.case.scene, name) for name in ("types", "rheo", "forces")):
        return False
    pairs = [(getattr(a.atoms, name), getattr(b.atoms, name)) for name in ("x_nc", "v_nc", "rho_n", "energy_n")]
    return all(u is w if u is None or w is None else np.array_equal(u, w) for u, w in pairs)


def save(limits: Limits, file: Path = FILE) -> None:
    """Write the limits."""
    _DOCUMENT.write(file, limits)


def read(file: Path = FILE) -> Limits:
    """Read limits; none where there is no file.

    Raises
    ------
    InputError
        A file of another version.
    """
    return _DOCUMENT.read(file) if file.exists() else Limits("", ())
