"""eos-ref run, report, merge."""

from __future__ import annotations

import os
from pathlib import Path

import click

from lammps_cases.cli_shared import Bar, engine_option, finish, json_option, out_option, paths_option, strict_option
from lammps_cases.records import CaseRecord


@click.command("run", short_help="Run cases against LAMMPS.")
@click.argument("names", nargs=-1, metavar="[CASE]...")
@click.option("--tag", help="Only cases with this tag (quick, eos, refusal, ...).")
@paths_option
@click.option("--jobs", type=click.IntRange(1), help="LAMMPS processes at a time (default: one per core).")
@engine_option
@click.option("--fresh", is_flag=True, help="Compute every prediction of the reference anew, and store it again.")
@click.option("--shard", help="i/n: only every n-th case, from the i-th.")
@out_option
@strict_option
@json_option
def run_command(
    names: tuple[str, ...],
    tag: str | None,
    paths: tuple[Path, ...],
    jobs: int | None,
    engine: str,
    fresh: bool,
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
    from lammps_cases import prefork

    prefork.context("lammps_cases.evaluate", "lammps_cases.report.drawn")
    from lammps_cases import campaign, casefile, engines, keys

    chosen = casefile.select(casefile.load(paths), names, tag)
    if shard:
        chosen = campaign.shard(chosen, shard)
    with Bar(quiet=as_json) as bar:

        def progress(record: CaseRecord, done: int, total: int) -> None:
            bar.show(done, total, record.case, "" if record.as_expected else f"{record.verdict} {record.case}")

        run = campaign.run_cases(
            chosen,
            engines.resolve(engine),
            jobs or os.cpu_count() or 1,
            out,
            campaign.command_line(),
            strict,
            shard or "",
            progress,
            keys.open_store(fresh),
        )
    return finish(run, out, as_json)


@click.command("report", short_help="Render a report again.")
@click.argument("run", type=click.Path(path_type=Path))
@json_option
def report_command(run: Path, as_json: bool) -> int:
    """Render report.html, summary.md and junit.xml of a finished run again, from its run.json.

    \b
    Example:  eos-ref report reports/latest
    """
    from lammps_cases.records import read_run
    from lammps_cases.report import write_report

    record = read_run(run)
    write_report(record, run)
    return finish(record, run, as_json)


@click.command("merge", short_help="Join shards.")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@out_option
@json_option
def merge_command(runs: tuple[Path, ...], out: Path, as_json: bool) -> int:
    """Join the report folders of a run's shards into one.

    \b
    Example:  eos-ref merge reports/shard-1 reports/shard-2 --out reports/latest
    """
    from lammps_cases.campaign import merge

    return finish(merge(runs, out), out, as_json)
