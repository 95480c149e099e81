"""eos-ref report."""

from __future__ import annotations

from pathlib import Path

import click

from lammps_cases.cli import shared


@click.command("report")
@click.argument("run", type=shared.PATH)
@click.option("--news", is_flag=True, help="Print what is new as Markdown, for a comment; render nothing.")
@shared.json_option
def report_command(run: Path, news: bool, as_json: bool) -> int:
    """Render report.html, summary.md and junit.xml of a finished run again, from its run.json.

    \b
    Example:  eos-ref report reports/latest
    """
    from lammps_cases import history
    from lammps_cases.records.run_record import read_run
    from lammps_cases.report import write_report

    record = read_run(run)
    if news:
        from lammps_cases.report import markdown
        from lammps_cases.report.findings import outcome

        click.echo(markdown.news(outcome(record)), nl=False)
        return 0
    write_report(record, run, history=history.past(record))
    return shared.finish(record, run, as_json)
