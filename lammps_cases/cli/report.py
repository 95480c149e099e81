"""eos-ref report."""

from __future__ import annotations

from pathlib import Path

import click

from lammps_cases.cli import shared


@click.command("report")
@click.argument("run", type=shared.PATH)
@shared.json_option
def report_command(run: Path, as_json: bool) -> int:
    """Render report.html, summary.md and junit.xml of a finished run again, from its run.json.

    \b
    Example:  eos-ref report reports/latest
    """
    from lammps_cases import history
    from lammps_cases.records.run_record import read_run
    from lammps_cases.report import write_report

    record = read_run(run)
    write_report(record, run, history=history.past(record))
    return shared.finish(record, run, as_json)
