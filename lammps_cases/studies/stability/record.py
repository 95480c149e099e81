"""An atlas on disk: ``atlas.json``, ``cells.csv``, the particles before each failure in ``states``."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from eos_ref import InputError
from lammps_cases.records.files import write_arrays, write_atomically
from lammps_cases.studies.stability import names
from lammps_cases.studies.stability.lines import Agreement
from lammps_cases.studies.stability.model import Axis, Boundary, Cell, Engine, Ran
from lammps_cases.studies.stability.probe import Before

SCHEMA = "eos-ref/stability/1"
_INFINITE = ConfigDict(ser_json_inf_nan="strings")


@dataclass(frozen=True)
class MapRecord:
    """A map as it was run: all cells, where kinds change, where the engines agree; wall time of its cells."""

    id: str
    title: str
    about: str
    x: Axis
    y: Axis
    layers: tuple[str, ...]
    lines: tuple[float, ...]
    seconds: float
    cells: tuple[Ran, ...]
    boundaries: tuple[Boundary, ...]
    agreement: tuple[Agreement, ...]


@dataclass(frozen=True)
class Atlas:
    """Everything measured: the single source of page and tables. ``engine`` is LAMMPS' own account of itself."""

    __pydantic_config__ = _INFINITE

    command: str
    machine: dict[str, str | float | int]
    engine: dict[str, str]
    quick: bool
    seconds: float
    maps: tuple[MapRecord, ...]
    schema: str = SCHEMA

    @property
    def disagreements(self) -> list[Agreement]:
        """Lines on which the engines differ."""
        return [a for m in self.maps for a in m.agreement if a.verdict == "differs"]


@dataclass(frozen=True)
class Kept:
    """A line of ``cells.jsonl``: a cell that was run, under the key of all it depends on."""

    __pydantic_config__ = _INFINITE

    key: str
    ran: Ran


_ATLAS = TypeAdapter(Atlas)
_KEPT = TypeAdapter(Kept)


def write(atlas: Atlas, folder: Path) -> None:
    """Write ``atlas.json`` and ``cells.csv``."""
    write_atomically(folder / "cells.csv", _csv(_rows(atlas)))
    write_atomically(folder / "atlas.json", _ATLAS.dump_json(atlas, indent=1) + b"\n")


def read(folder: Path) -> Atlas:
    """The atlas of a folder.

    Raises
    ------
    InputError
        No atlas there, or one of another version.
    """
    file = folder / "atlas.json"
    try:
        atlas = _ATLAS.validate_json(file.read_bytes())
    except OSError as error:
        raise InputError("atlas", f"cannot be read: {error.strerror}", where=str(file)) from None
    except ValidationError as error:
        rule = f"is not of the schema {SCHEMA}: {error.errors()[0]['msg']}"
        raise InputError("atlas", rule, where=str(file)) from None
    if atlas.schema != SCHEMA:
        raise InputError("atlas", f"must be of the schema {SCHEMA}", atlas.schema, str(file))
    return atlas


def document(atlas: Atlas) -> dict[str, Any]:
    """What ``--json`` prints."""
    whole = json.loads(_ATLAS.dump_json(atlas))
    return {
        "maps": [
            {
                "id": m["id"],
                "cells": m["cells"],
                "boundaries": m["boundaries"],
                "disagreements": [a for a in m["agreement"] if a["verdict"] == "differs"],
            }
            for m in whole["maps"]
        ]
    }


# --- cells as they come


def keep(folder: Path, kept: Kept) -> None:
    """Append a cell to ``cells.jsonl``: a kill loses at most the line that is being written."""
    with (folder / "cells.jsonl").open("ab") as file:
        # After a kill in the middle of a line, the next one begins anew.
        file.write((b"" if _whole(folder) else b"\n") + _KEPT.dump_json(kept) + b"\n")


def _whole(folder: Path) -> bool:
    with (folder / "cells.jsonl").open("rb") as file:
        file.seek(0, io.SEEK_END)
        if file.tell() == 0:
            return True
        file.seek(-1, io.SEEK_END)
        return file.read(1) == b"\n"


def kept(folder: Path) -> dict[str, Ran]:
    """Cells by key, the last of each; lines that a kill cut short are left out."""
    file = folder / "cells.jsonl"
    found: dict[str, Ran] = {}
    for line in file.read_bytes().splitlines() if file.exists() else ():
        try:
            one = _KEPT.validate_json(line)
        except ValidationError:
            continue
        found[one.key] = one.ran
    return found


def forget(folder: Path) -> None:
    """Take away the cells that a folder keeps, so that all are run again."""
    (folder / "cells.jsonl").unlink(missing_ok=True)


# --- particles before a failure


def state_file(folder: Path, cell: Cell, engine: Engine) -> Path:
    """Where the particles before a failure are kept."""
    return folder / "states" / f"{names.anchor(cell)}--{engine}.npz"


def write_state(folder: Path, cell: Cell, engine: Engine, before: Before | None) -> None:
    """Keep the particles before a failure; without one, an older file of the cell goes."""
    file = state_file(folder, cell, engine)
    if before is None:
        file.unlink(missing_ok=True)
    else:
        write_arrays(file, before.arrays())


def read_state(folder: Path, cell: Cell, engine: Engine) -> dict[str, Any] | None:
    """Arrays step, x, v, rho, pressure, id, type, low, high, failing (ids); None for a run without failure."""
    file = state_file(folder, cell, engine)
    if not file.exists():
        return None
    with np.load(file) as arrays:
        return dict(arrays)


# --- tables


def _rows(atlas: Atlas) -> Iterable[Sequence[Any]]:
    yield ("map", "layer", "x", "y", "engine", "kind", "step", "atom", "value", "steps", "seconds", "message")
    for r in (r for m in atlas.maps for r in m.cells):
        c, o = r.cell, r.outcome
        yield (
            *(c.map, c.layer, c.x, c.y, r.engine, o.kind),
            *("" if item is None else item for item in (o.step, o.atom, o.value)),
            *(o.steps, round(o.seconds, 4), o.message),
        )


def _csv(rows: Iterable[Sequence[Any]]) -> str:
    file = io.StringIO()
    csv.writer(file, lineterminator="\n").writerows(rows)
    return file.getvalue()
