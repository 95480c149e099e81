"""eos-ref run, report, merge."""

from __future__ import annotations

import os
from pathlib import Path

import click

from lammps_cases.cli.shared import (
    engine_option,
    finish,
    fresh_option,
    jobs_option,
    json_option,
    out_option,
    paths_option,
    strict_option,
    tag_option,
)
from lammps_cases.records.progress import Bar
from lammps_cases.records.run_record import RunRecord


@click.command("run")
@click.argument("names", nargs=-1, metavar="[CASE]...")
@tag_option
@paths_option
@jobs_option
@engine_option
@fresh_option
@click.option("--shard", help="i/n: only every n-th case, from the i-th.")
@click.option(
    "--baseline",
    type=click.Path(path_type=Path),
    help="Folder of accepted baselines (reports/accepted), or one of them: exit 1 if the run does anything otherwise.",
)
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
    baseline: Path | None,
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
    from lammps_cases.engine import forkserver

    forkserver.context("lammps_cases.verdict.judgement", "lammps_cases.report.drawn")
    from lammps_cases.comparison import prediction_keys
    from lammps_cases.engine import installations
    from lammps_cases.regression import baseline as accepted
    from lammps_cases.run import campaign
    from lammps_cases.run.merge import part_of
    from lammps_cases.scene import casefile

    every = casefile.load(paths)
    chosen = casefile.select(every, names, tag)
    if shard:
        chosen = part_of(chosen, shard)
    if baseline is not None:
        accepted.readable(baseline)  # a typing mistake is said before the run, not after it
    with Bar(quiet=as_json, complaints=True) as bar:
        run = campaign.run_cases(
            chosen,
            installations.resolve(engine),
            jobs or os.cpu_count() or 1,
            out,
            campaign.command_line(),
            strict,
            shard or "",
            bar,
            prediction_keys.open_store(fresh),
        )
    code = finish(run, out, as_json)
    if baseline is None or code == 3:  # an engine that failed is not held against anything
        return code
    return max(code, _against(baseline, run, out, {case.name for case in every}, as_json))


def _against(baseline: Path, run: RunRecord, out: Path, cases: set[str], as_json: bool) -> int:
    """Say what a run does otherwise than accepted."""
    from lammps_cases.regression import pairs
    from lammps_cases.regression.baseline import check
    from lammps_cases.report.annotations import announce_changes

    changes = check(run, out, baseline, cases)
    for line in pairs.checked(changes, str(out)):
        click.echo(line, err=as_json)
    if not as_json:
        announce_changes([pairs.fault(change) for change in changes.faults], os.environ)
    return int(bool(changes.faults))


@click.command("report")
@click.argument("run", type=click.Path(path_type=Path))
@json_option
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
    return finish(record, run, as_json)


@click.command("merge")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@out_option
@json_option
def merge_command(runs: tuple[Path, ...], out: Path, as_json: bool) -> int:
    """Join the report folders of a run's shards into one.

    \b
    Example:  eos-ref merge reports/shard-1 reports/shard-2 --out reports/latest
    """
    from lammps_cases.run.merge import merge

    return finish(merge(runs, out), out, as_json)
