"""Maps by name, pattern and tag; the map of a cell."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence

from eos_ref import InputError
from eos_ref.errors import nearest
from lammps_cases.studies.stability.model import Cell, StabilityMap


def maps(known: Mapping[str, StabilityMap], names: Sequence[str] = (), tag: str | None = None) -> list[StabilityMap]:
    """Maps by name or wild-card pattern and by tag; without either, all that are not tagged long.

    Raises
    ------
    InputError
        A name that matches no map (the nearest is suggested), or a tag that no map has.
    """
    wanted: set[str] = set()
    for name in names:
        hits = fnmatch.filter(known, name)
        if not hits:
            raise _missing(known, name)
        wanted.update(hits)
    chosen = [one for one in known.values() if not names or one.id in wanted]
    if tag is not None:
        chosen = [one for one in chosen if tag in one.tags]
        if not chosen:
            tags = sorted({t for one in known.values() for t in one.tags})
            raise InputError("tag", f"no map has it (tags: {', '.join(tags)})", tag)
    elif not names:
        chosen = [one for one in chosen if "long" not in one.tags]
    return chosen


def of_cell(known: Mapping[str, StabilityMap], cell: Cell) -> StabilityMap:
    """The map of a cell.

    Raises
    ------
    InputError
        There is no such map, or it has no such layer, or the place lies outside.
    """
    if cell.map not in known:
        raise _missing(known, cell.map)
    of = known[cell.map]
    if cell.layer not in of.layers:
        raise InputError("layer", f"must be one of {', '.join(map(repr, of.layers))}", cell.layer)
    for axis, value in ((of.x, cell.x), (of.y, cell.y)):
        if not axis.low <= value <= axis.high:
            raise InputError(axis.name, f"must lie within {axis.low:g} to {axis.high:g}", value)
    return of


def _missing(known: Mapping[str, StabilityMap], name: str) -> InputError:
    return InputError("map", f"does not exist{nearest(name, known)}", name)
