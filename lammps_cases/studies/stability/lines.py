"""One line of a map on one engine: which places are run, where the kind changes, and whether two engines agree."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from lammps_cases.studies.stability.model import Axis, Boundary, Engine, Kind, StabilityMap


@dataclass(frozen=True)
class MapLine:
    """A line of a map on an engine: all x at one y."""

    map: str
    layer: str
    y: float
    engine: Engine


@dataclass(frozen=True)
class Agreement:
    """Whether both engines fail alike on a line: the same kinds in the same order, within the boundaries' uncertainty.

    ``kinds`` are those of each engine along x, ``boundaries`` the changes between them, reference first.
    """

    map: str
    layer: str
    y: float
    verdict: Literal["same", "differs"]
    reference: tuple[Kind, ...]
    lammps: tuple[Kind, ...]
    boundaries: tuple[tuple[Boundary, ...], tuple[Boundary, ...]]


def coordinate(axis: Axis, x: float) -> float:
    """Return the coordinate of a value on an axis, in the units of its width."""
    return math.log10(x) if axis.log else x


def places(axis: Axis, coarse: int) -> list[float]:
    """Return the coarse places, evenly along the axis; the ends are exact."""
    if coarse < 2 or axis.low == axis.high:
        return [axis.low]
    low, high = coordinate(axis, axis.low), coordinate(axis, axis.high)
    inner = [low + (high - low) * k / (coarse - 1) for k in range(1, coarse - 1)]
    return [axis.low, *(10**u if axis.log else u for u in inner), axis.high]


def middle(axis: Axis, low: float, high: float) -> float:
    """Return the place halfway on the axis."""
    return math.sqrt(low) * math.sqrt(high) if axis.log else (low + high) / 2


def wanted(of: StabilityMap, kinds: Mapping[float, Kind]) -> list[float]:
    """Places to be run next: the coarse ones, then those halfway between neighbours of different kind; none: done."""
    missing = [x for x in places(of.x, of.coarse) if x not in kinds]
    if missing:
        return missing
    return [
        middle(of.x, a, b)
        for a, b in itertools.pairwise(sorted(kinds))
        if kinds[a] != kinds[b] and coordinate(of.x, b) - coordinate(of.x, a) > of.x.width
    ]


def boundaries(line: MapLine, kinds: Mapping[float, Kind]) -> tuple[Boundary, ...]:
    """Return every change of kind along a line, from low to high."""
    return tuple(
        Boundary(line.map, line.layer, line.y, line.engine, a, b, kinds[a], kinds[b])
        for a, b in itertools.pairwise(sorted(kinds))
        if kinds[a] != kinds[b]
    )


def sequence(kinds: Mapping[float, Kind]) -> tuple[Kind, ...]:
    """Return the kinds along a line, each stretch of one kind once."""
    return tuple(kind for kind, _ in itertools.groupby(kinds[x] for x in sorted(kinds)))


def agreement(
    of: StabilityMap, layer: str, y: float, reference: Mapping[float, Kind], lammps: Mapping[float, Kind]
) -> Agreement:
    """Return the verdict on a line that both engines have run."""
    sides: tuple[tuple[Engine, Mapping[float, Kind]], ...] = (("reference", reference), ("lammps", lammps))
    ours, theirs = (boundaries(MapLine(of.id, layer, y, engine), of_engine) for engine, of_engine in sides)
    kinds = sequence(reference), sequence(lammps)
    same = kinds[0] == kinds[1] and all(_meet(of.x, a, b) for a, b in zip(ours, theirs, strict=True))
    return Agreement(of.id, layer, y, "same" if same else "differs", *kinds, (ours, theirs))


def _meet(axis: Axis, a: Boundary, b: Boundary) -> bool:
    """Return whether two intervals overlap, or lie no further apart than the axis resolves."""
    gap = coordinate(axis, max(a.low, b.low)) - coordinate(axis, min(a.high, b.high))
    # Neighbouring intervals of bisection share an end to rounding.
    return gap <= axis.width


def lines_of(of: StabilityMap, quick: bool) -> Sequence[float]:
    """Return the values of y that are run."""
    return tuple(dict.fromkeys(of.quick_lines or (of.lines[0], of.lines[-1]))) if quick else of.lines
