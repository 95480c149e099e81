"""eos-ref report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Json, Run
from lammps_cases.records.options import Option


@command()
def report_command(
    run: Run,
    news: Annotated[bool, Option("Print what is new as Markdown, for a comment, without rendering.")] = False,
    dashboard: Annotated[Path | None, Option("Write run.json as LAMMPS' dashboard reads it; render nothing.")] = None,
    as_json: Json = False,
) -> int:
    """Render report.html, summary.md and junit.xml of a finished run again, from its run.json.

    Of a run that was interrupted, killed or broken the cases that were judged are rendered.

    \b
    Example:  eos-ref report reports/latest
              eos-ref report reports/latest --dashboard data/eos-ref/run.json
    """
    from eos_ref import InputError
    from lammps_cases.records.run_record import read_run
    from lammps_cases.run import campaign, report_files

    if news and dashboard:
        raise InputError("--dashboard", "cannot be combined with --news")
    if not (news or dashboard) and (left := campaign.left(run)):
        return shared.finish(*left, as_json)
    record = read_run(run)
    if news:
        from lammps_cases.report import markdown
        from lammps_cases.report.findings import outcome

        text = markdown.news(outcome(record))
        click.echo(json.dumps({"news": text}) + "\n" if as_json else text, nl=False)
        return 0
    if dashboard:
        from lammps_cases.records.files import write_atomically
        from lammps_cases.report.dashboard import document
        from lammps_cases.report.findings import outcome

        if _is_run(dashboard):
            raise InputError("--dashboard", "must not be the record of a run", where=str(dashboard))
        try:
            write_atomically(dashboard, document(outcome(record)))
        except OSError as error:
            raise InputError("--dashboard", f"cannot be written: {error.strerror}", where=str(dashboard)) from None
        click.echo(json.dumps({"dashboard": str(dashboard)}) if as_json else dashboard)
        return 0
    report_files.write_run(record, run, past=report_files.past_of(record))
    return shared.finish(record, run, as_json)


def _is_run(file: Path) -> bool:
    from eos_ref import InputError
    from lammps_cases.records.run_record import read_run

    try:
        read_run(file.parent)
    except InputError:
        return False
    return file.name == "run.json"
