"""The maps of the atlas by name, tag and cell; expected differences of the engines, and their reasons."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eos_ref import InputError
from eos_ref.errors import unknown
from lammps_cases.findings import LEDGER
from lammps_cases.studies.stability.maps import laws, matrices, tension, timestep, walls
from lammps_cases.studies.stability.model import Agreement, MapCell, StabilityMap

MAPS: dict[str, StabilityMap] = {
    one.id: one
    for one in (
        *timestep.MAPS,
        *laws.MAPS,
        *matrices.MAPS,
        *tension.MAPS,
        *matrices.SURFACE_MAPS,
        *tension.PHASES_MAPS,
        *walls.MAPS,
        *walls.WHOLE_MAPS,
    )
}


def select(by_id: Mapping[str, StabilityMap], names: Sequence[str] = (), tag: str | None = None) -> list[StabilityMap]:
    """Return the maps by name or wild-card pattern and by tag; without either, all that are not tagged long.

    Raises
    ------
    InputError
        A name that matches no map (the nearest is suggested), or a tag that no map has.
    """
    wanted: set[str] = set()
    for name in names:
        hits = fnmatch.filter(by_id, name)
        if not hits:
            raise unknown("map", name, by_id)
        wanted.update(hits)
    chosen = [one for one in by_id.values() if not names or one.id in wanted]
    if tag is not None:
        chosen = [one for one in chosen if tag in one.tags]
        if not chosen:
            tags = sorted({t for one in by_id.values() for t in one.tags})
            raise InputError("tag", f"no map has it (tags: {', '.join(tags)})", tag)
    elif not names:
        chosen = [one for one in chosen if "long" not in one.tags]
    return chosen


def of_cell(by_id: Mapping[str, StabilityMap], cell: MapCell) -> StabilityMap:
    """Return the map of a cell.

    Raises
    ------
    InputError
        No such map, no such layer, or a place outside.
    """
    if cell.map not in by_id:
        raise unknown("map", cell.map, by_id)
    of = by_id[cell.map]
    if cell.layer not in of.layers:
        raise InputError("layer", f"must be one of {', '.join(map(repr, of.layers))}", cell.layer)
    for axis, value in ((of.x, cell.x), (of.y, cell.y)):
        if not axis.low <= value <= axis.high:
            raise InputError(axis.name, f"must lie within {axis.low:g} to {axis.high:g}", value)
    return of


# --- differences


@dataclass(frozen=True)
class ExpectedDifference:
    """The reason why the engines differ; ``finding``: id of a finding, empty if no statement is broken."""

    finding: str
    why: str


def expected_difference(line: Agreement | MapCell) -> ExpectedDifference | None:
    """Return the known reason, if any, why the engines differ on a line or in a cell."""
    for entry in LEDGER:
        for where in entry.expected_in_maps:
            if where.map == line.map and where.layer in (None, line.layer):
                return ExpectedDifference(entry.id, where.why)
    of = MAPS.get(line.map)
    return ExpectedDifference("", of.engines_differ) if of and of.engines_differ else None


def unexplained(lines: list[Agreement]) -> list[Agreement]:
    """Return the lines that differ without an expected reason."""
    return [line for line in lines if expected_difference(line) is None]
