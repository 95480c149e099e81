"""What LAMMPS does with bad input, kept beside an atlas: ``inputs.json``."""

from __future__ import annotations

from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from lammps_cases.engine.workers import Workers
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.stability.inputs import InputRow, table

_ADAPTER = TypeAdapter(list[InputRow])


def inputs(folder: Path, site: str | None, jobs: int, progress: Progress = SILENT) -> list[InputRow]:
    """Put every bad input to LAMMPS, and write the table."""
    with Workers(site, jobs) as workers:
        found = table(workers, progress)
    write_atomically(folder / "inputs.json", _ADAPTER.dump_json(found, indent=1) + b"\n")
    return found


def read(folder: Path) -> list[InputRow]:
    """The table of a folder; empty where there is none."""
    try:
        return _ADAPTER.validate_json((folder / "inputs.json").read_bytes())
    except (OSError, ValidationError):
        return []
