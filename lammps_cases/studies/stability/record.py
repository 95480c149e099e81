"""An atlas on disk: ``atlas.json``, ``cells.csv``, the particles before each failure in ``states``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lammps_cases.records.documents import SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text, read_arrays, write_arrays, write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.studies.stability.model import Agreement, Axis, Boundary, CellRun, Engine, MapCell


@dataclass(frozen=True)
class MapRecord:
    """A map as it was run: its cells with their wall time (s), boundaries, and the engines' agreement."""

    id: str
    title: str
    about: str
    x: Axis
    y: Axis
    layers: tuple[str, ...]
    lines: tuple[float, ...]
    seconds: float
    cells: tuple[CellRun, ...]
    boundaries: tuple[Boundary, ...]
    agreement: tuple[Agreement, ...]


@dataclass(frozen=True)
class Atlas(Study):
    """All measurements."""

    maps: tuple[MapRecord, ...]
    schema: str = SCHEMAS["stability"]

    @property
    def disagreements(self) -> list[Agreement]:
        """Lines on which the engines differ."""
        return [a for m in self.maps for a in m.agreement if a.verdict == "differs"]


DOCUMENT = Document("stability", Atlas)


def write(atlas: Atlas, folder: Path) -> None:
    """Write ``atlas.json`` and ``cells.csv``."""
    write_atomically(folder / "cells.csv", csv_text(_rows(atlas)))
    DOCUMENT.write(folder / "atlas.json", atlas)


def document(atlas: Atlas) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    return {
        "maps": [
            {key: of[key] for key in ("id", "cells", "boundaries")}
            | {"disagreements": [line for line in of["agreement"] if line["verdict"] == "differs"]}
            for of in DOCUMENT.plain(atlas)["maps"]
        ]
    }


def cells(folder: Path) -> Parts[CellRun]:
    """Return ``cells.jsonl``: cells as they come."""
    return Parts(folder / "cells.jsonl", CellRun)


# --- particles before a failure


def state_file(folder: Path, cell: MapCell, engine: Engine) -> Path:
    """Return the file of the particles before a failure."""
    return folder / "states" / f"{cell.anchor}--{engine}.npz"


def write_state(folder: Path, cell: MapCell, engine: Engine, before: dict[str, Any] | None) -> None:
    """Keep the particles before a failure; without one, remove an older file of the cell."""
    file = state_file(folder, cell, engine)
    if before is None:
        file.unlink(missing_ok=True)
    else:
        write_arrays(file, before)


def read_state(folder: Path, cell: MapCell, engine: Engine) -> dict[str, Any] | None:
    """Return the arrays of `Examined.before`; None for a run without failure."""
    file = state_file(folder, cell, engine)
    if not file.exists():
        return None
    return dict(read_arrays(file))


# --- tables


def _rows(atlas: Atlas) -> Iterable[Sequence[Any]]:
    yield ("map", "layer", "x", "y", "engine", "kind", "step", "atom", "value", "steps", "seconds", "message")
    for run in (run for of in atlas.maps for run in of.cells):
        cell, o = run.cell, run.outcome
        yield (
            *(cell.map, cell.layer, cell.x, cell.y, run.engine, o.kind),
            *(o.step, o.atom, o.value, o.steps, round(o.seconds, 4), o.message),  # CSV leaves None empty
        )
