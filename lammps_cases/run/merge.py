"""Runs joined into one: the shards of a run, or runs of other cases."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

from eos_ref import InputError
from lammps_cases.records.faults import part
from lammps_cases.records.files import write_atomically
from lammps_cases.records.headline import strictest
from lammps_cases.records.run_record import RunRecord, read_run
from lammps_cases.report.findings import compare_with_ledger
from lammps_cases.run.campaign import cases_of, triaged
from lammps_cases.run.output_folder import output_folder
from lammps_cases.run.provenance import command_line
from lammps_cases.run.report_files import write_kept_run
from lammps_cases.run.shards import check_complete


def merge(directories: Sequence[Path], directory: Path) -> RunRecord:
    """Join runs of different cases on the same engine and write one report.

    Raises
    ------
    InputError
        A folder without a run, different engines, or a case that occurs twice.
    """
    runs = [read_run(folder) for folder in directories]
    for run, folder in zip(runs, directories, strict=True):
        run.check_whole(folder)
    check_complete(runs)
    merged = runs[0]
    for run, folder in zip(runs[1:], directories[1:], strict=True):
        one, other = run.engine, merged.engine
        if (one.distribution, one.library_sha256) != (other.distribution, other.library_sha256):
            rule = f"must be {other.distribution} with the library of the first run"
            raise InputError("engine", rule, one.distribution, str(folder))
        merged.cases += run.cases
        merged.seconds += run.seconds
        merged.older |= run.older
    merged.fail_on = strictest([run.fail_on for run in runs])
    merged.allowed = {name: why for name, why in merged.allowed.items() if all(name in run.allowed for run in runs)}
    merged.shard = merged.divided = ""
    merged.faults = []
    merged.carried = part("carried findings", merged.faults, lambda: compare_with_ledger(merged), None)
    merged.cases.sort(key=lambda record: record.case)
    for case, following in itertools.pairwise(merged.cases):
        if case.case == following.case:
            raise InputError("case", "occurs in two of the runs", case.case)
    merged.command = command_line()
    with output_folder(directory) as folder:
        for source in directories:
            for file in sorted((source / "fields").glob("*.npz")):
                write_atomically(folder / "fields" / file.name, file.read_bytes())
        merged.triage = part("triage", merged.faults, lambda: triaged(merged, cases_of(merged), folder), None)
        write_kept_run(merged.counted(), folder)
    return merged
