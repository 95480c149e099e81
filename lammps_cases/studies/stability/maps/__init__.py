"""The maps of the atlas, each made by a module of its own when it is first asked for."""

from __future__ import annotations

import importlib
from functools import cache

from lammps_cases.studies.stability.model import StabilityMap

MODULES = ("timestep", "laws", "matrices", "precision", "tension", "surfaces", "phases", "walls", "whole")


@cache
def maps() -> dict[str, StabilityMap]:
    """Return all maps by id, in the order of their modules."""
    by_id: dict[str, StabilityMap] = {}
    for name in MODULES:
        for one in importlib.import_module(f"{__name__}.{name}").MAPS:
            if one.id in by_id:
                raise ValueError(f"two maps are called {one.id}")
            by_id[one.id] = one
    return by_id
