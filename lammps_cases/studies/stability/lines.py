"""One line of a map on one engine: which places are run, where the kind changes, and whether two engines agree."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from lammps_cases.studies.stability.model import Axis, Boundary, Kind, MapLine, StabilityMap

Ends = Mapping[float, Kind]  # of the cells of a line, by x


@dataclass(frozen=True)
class Agreement:
    """Verdict on a line that both engines ran: ``same`` kinds in the same order, within the boundaries' uncertainty.

    ``reference`` and ``lammps`` are the kinds along x, ``boundaries`` the changes between them, reference first.
    """

    map: str
    layer: str
    y: float
    verdict: Literal["same", "differs"]
    reference: tuple[Kind, ...]
    lammps: tuple[Kind, ...]
    boundaries: tuple[tuple[Boundary, ...], tuple[Boundary, ...]]


def places(axis: Axis, coarse: int) -> list[float]:
    """Return the coarse places, evenly along the axis; the ends are exact."""
    if coarse < 2 or axis.low == axis.high:
        return [axis.low]
    low, high = axis.coordinate(axis.low), axis.coordinate(axis.high)
    inner = [low + (high - low) * k / (coarse - 1) for k in range(1, coarse - 1)]
    return [axis.low, *(10**u if axis.log else u for u in inner), axis.high]


def wanted(of: StabilityMap, ends: Ends) -> list[float]:
    """Return the places to be run next: the coarse ones, then those between neighbours of different kind; then none."""
    missing = [x for x in places(of.x, of.coarse) if x not in ends]
    if missing:
        return missing
    return [
        of.x.middle(a, b)
        for a, b in itertools.pairwise(sorted(ends))
        if ends[a] != ends[b] and of.x.coordinate(b) - of.x.coordinate(a) > of.x.width
    ]


def boundaries(line: MapLine, ends: Ends) -> tuple[Boundary, ...]:
    """Return every change of kind along a line, from low to high."""
    return tuple(
        Boundary(line.map, line.layer, line.y, line.engine, a, b, ends[a], ends[b])
        for a, b in itertools.pairwise(sorted(ends))
        if ends[a] != ends[b]
    )


def sequence(ends: Ends) -> tuple[Kind, ...]:
    """Return the kinds along a line, each stretch of one kind once."""
    return tuple(kind for kind, _ in itertools.groupby(ends[x] for x in sorted(ends)))


def agreement(of: StabilityMap, layer: str, y: float, reference: Ends, lammps: Ends) -> Agreement:
    """Return the verdict on a line that both engines have run."""
    ours = boundaries(MapLine(of.id, layer, y, "reference"), reference)
    theirs = boundaries(MapLine(of.id, layer, y, "lammps"), lammps)
    kinds = sequence(reference), sequence(lammps)
    same = kinds[0] == kinds[1] and all(_meet(of.x, a, b) for a, b in zip(ours, theirs, strict=True))
    return Agreement(of.id, layer, y, "same" if same else "differs", *kinds, (ours, theirs))


def _meet(axis: Axis, a: Boundary, b: Boundary) -> bool:
    """Return whether two intervals overlap, or lie no further apart than the axis resolves."""
    # Neighbouring intervals of bisection share an end to rounding.
    return axis.coordinate(max(a.low, b.low)) - axis.coordinate(min(a.high, b.high)) <= axis.width
