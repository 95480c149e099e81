"""The maps of the atlas, each made by a module of its own when it is first asked for; maps by name, tag and cell."""

from __future__ import annotations

import fnmatch
import importlib
from collections.abc import Mapping, Sequence
from functools import cache

from eos_ref import InputError
from eos_ref.errors import unknown
from lammps_cases.studies.stability.model import MapCell, StabilityMap

MODULES = ("timestep", "laws", "matrices", "precision", "tension", "surfaces", "phases", "walls", "whole")


@cache
def maps() -> dict[str, StabilityMap]:
    """Return all maps by id, in the order of their modules."""
    modules = [importlib.import_module(f"{__name__}.{name}") for name in MODULES]
    return {one.id: one for module in modules for one in module.MAPS}


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
            raise _missing(by_id, name)
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
        There is no such map, or it has no such layer, or the place lies outside.
    """
    if cell.map not in by_id:
        raise _missing(by_id, cell.map)
    of = by_id[cell.map]
    if cell.layer not in of.layers:
        raise InputError("layer", f"must be one of {', '.join(map(repr, of.layers))}", cell.layer)
    for axis, value in ((of.x, cell.x), (of.y, cell.y)):
        if not axis.low <= value <= axis.high:
            raise InputError(axis.name, f"must lie within {axis.low:g} to {axis.high:g}", value)
    return of


def _missing(by_id: Mapping[str, StabilityMap], name: str) -> InputError:
    return unknown("map", name, by_id)
