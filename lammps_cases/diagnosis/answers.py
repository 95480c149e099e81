"""LAMMPS' fields of red cases at all steps compared, beside the arrays of the report, which hold the worst step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lammps_cases.engine.session import Answer
from lammps_cases.findings.variants import Snapshot
from lammps_cases.records.files import read_arrays, write_arrays
from lammps_cases.scene import Scene
from lammps_cases.verdict.model_cases import read_snapshots


def file_of(fields: Path, case: str) -> Path:
    """Return the file of a case, of a name that no case has."""
    return fields / f"{case}@steps.npz"


def keep(fields: Path, case: str, scene: Scene, answer: Answer) -> None:
    """Write LAMMPS' fields at the steps compared."""
    arrays: dict[str, Any] = {}
    for step, snapshot in zip(scene.snapshots, read_snapshots(scene, answer), strict=True):
        arrays |= {f"{step} {name}": values for name, values in snapshot.items() if name != "lists"}
    write_arrays(file_of(fields, case), arrays)


def kept(fields: Path, case: str, scene: Scene) -> list[Snapshot] | None:
    """Return LAMMPS' fields at the steps compared; None if they were not kept."""
    path = file_of(fields, case)
    if not path.is_file():
        return None
    arrays = read_arrays(path)
    if {f"{step} {name}" for step in scene.snapshots for name in scene.compare} != set(arrays):
        return None
    return [{name: arrays[f"{step} {name}"] for name in scene.compare} for step in scene.snapshots]
