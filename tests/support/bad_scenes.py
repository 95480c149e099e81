"""Scenes that are refused (``bad_scenes.yaml``): changes of the base scene, and parts of the line that says so."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from lammps_cases.records.yaml_files import read_yaml
from tests.conftest import BASE

Bad = tuple[dict[str, Any], tuple[str, ...]]
_ROWS: Any = read_yaml(Path(__file__).with_suffix(".yaml"), "bad scenes")
_STEPPING: dict[str, Any] = {"compare": ["f"], "evolve": {"steps": 4, "timestep": 0.004}}


def edited(base: dict[str, Any], edit: dict[str, Any]) -> dict[str, Any]:
    """Return a scene with other values of some keys, given by their place (``types.0.mass``)."""
    content = copy.deepcopy(base)
    for place, value in edit.items():
        *above, last = [int(part) if part.isdigit() else part for part in place.split(".")]
        at: Any = content
        for key in above:
            at = at[key] if isinstance(at, list) else at.setdefault(key, {})
        at[last] = value
    return content


def _bad(row: list[Any], base: dict[str, Any] = BASE) -> Bad:
    edit, *parts = row
    return edited(base, edit), tuple(parts)


BAD: dict[str, Bad] = {name: _bad(row) for name, row in _ROWS["named"].items()}
OTHERS: list[Bad] = [*map(_bad, _ROWS["others"]), *(_bad(row, BASE | _STEPPING) for row in _ROWS["stepping"])]
