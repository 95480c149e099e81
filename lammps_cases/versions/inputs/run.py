"""The table of bad input, measured."""

from __future__ import annotations

import time
from collections.abc import Sequence

from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.versions.inputs.record import InputTable
from lammps_cases.versions.inputs.table import BadWords, table


def measure(
    chosen: Sequence[BadWords], site: str | None, jobs: int, command: str, progress: Progress = SILENT
) -> InputTable:
    """Put inputs to a LAMMPS (folder ``site``; None: of this environment) and to the reference."""
    begin = time.perf_counter()
    with Workers(site, jobs) as workers:
        who = workers.outcome(workers.identify())
        rows = table(workers, progress, chosen)
    seconds = round(time.perf_counter() - begin, 1)
    return InputTable(command, {} if isinstance(who, Failure) else who, seconds, tuple(rows))
