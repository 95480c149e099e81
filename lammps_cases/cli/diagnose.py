"""eos-ref diagnose."""

from __future__ import annotations

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Json, Run
from lammps_cases.run.options import Files, paths


@command()
def diagnose_command(run: Run, cases: Files = (), as_json: Json = False) -> int:
    """Group the red cases of a finished run, say what their scenes share, and try changes of the formulas.

    Needs the cases as they were and the arrays of the report, not LAMMPS. Rewrites the report.

    \b
    Example:  eos-ref diagnose reports/latest
    """
    from lammps_cases.comparison.prediction_keys import open_store
    from lammps_cases.records.faults import part
    from lammps_cases.records.run_record import read_run
    from lammps_cases.run import campaign, report_files

    record = read_run(run)
    before = record.triage
    every = campaign.cases_of(record, paths(cases))
    record.triage = part("triage", record.faults, lambda: campaign.triaged(record, every, run, open_store()), before)
    if record.triage or before or record.faults:
        report_files.write_run(record, run, past=report_files.past_of(record))
    if record.triage is None and not record.faults and not as_json:
        click.echo("every case is as expected: nothing to group")
    return shared.finish(record, run, as_json)
