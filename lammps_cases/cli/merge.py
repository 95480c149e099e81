"""eos-ref merge."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Json, Report
from lammps_cases.records.options import Argument


@command()
def merge_command(runs: Annotated[tuple[Path, ...], Argument()], out: Report = None, as_json: Json = False) -> int:
    """Join the report folders of a run's shards into one.

    \b
    Example:  eos-ref merge reports/shard-1 reports/shard-2
    """
    from eos_ref import InputError
    from lammps_cases.records.run_record import read_run
    from lammps_cases.run.merge import merge

    parts = [read_run(run) for run in runs]
    if len(parts) == 1 and not parts[0].shard:
        raise InputError("runs", "must be several, or the one shard of a run: there is nothing to join", str(runs[0]))
    with shared.run_folder(out, (case.case for part in parts for case in part.cases), parts[0].engine.name) as folder:
        merged = merge(runs, folder)
    return shared.finish(merged, folder, as_json)
