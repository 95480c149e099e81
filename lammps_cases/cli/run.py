"""eos-ref run."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import CLUSTER, LAUNCHER, MEMORY, Json, Report
from lammps_cases.records.options import Option
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import RunOptions

if TYPE_CHECKING:
    from lammps_cases.records.run_record import RunRecord
    from lammps_cases.scene.casefile import Case

WITHOUT_PAIRS = ("eos",)  # tags of cases of which few find neighbours: known before they are read


@command(LAUNCHER, CLUSTER, MEMORY)
def run_command(
    options: RunOptions,
    shard: Annotated[
        str | None,
        Option("i/n: only every n-th case, from the i-th; with --costs the i-th of n equally long parts."),
    ] = None,
    costs: Annotated[Path | None, Option("Durations of the cases in seconds, as written by eos-ref kit.")] = None,
    baseline: Annotated[
        Path | None,
        Option("Folder of accepted baselines (reports/accepted), or one of them: exit 1 if anything differs from it."),
    ] = None,
    resume: Annotated[bool, Option("Continue an interrupted or killed run: judge the remaining cases.")] = False,
    profile: Annotated[bool, Option("Show where the processor time went, by stage.")] = False,
    out: Report = None,
    as_json: Json = False,
) -> int:
    """Run cases against LAMMPS, compare atom by atom, and write a report.

    Without names: every case that is not tagged long. A name selects a case, or all below it, or a pattern. Without
    --out a whole run is kept in reports, and reports/latest points to it; a run of some cases in reports/parts.

    \b
    Example:  eos-ref run --tag quick
              eos-ref run 'near-rho0.*.2d' --jobs 2 --out reports/near
    """
    if costs and not shard:
        from eos_ref import InputError

        raise InputError("--costs", "needs --shard, which it divides")
    if options.allow:
        from lammps_cases.findings import check_names

        check_names(options.allow)
    names, tag = options.names, options.tag
    shared.start_fork_server(pairs=options.fresh or tag not in WITHOUT_PAIRS)
    with shared.uncollected():
        from lammps_cases.comparison import prediction_keys
        from lammps_cases.engine import installations
        from lammps_cases.records import folders
        from lammps_cases.records.wording import counted
        from lammps_cases.run import campaign, provenance, shards
        from lammps_cases.scene import casefile

        every = casefile.load(options.paths, None if names or baseline else tag)
    chosen = casefile.select(every, names, tag)
    part = (shard or "", shards.divided(case.name for case in chosen) if shard else "")
    if shard:
        chosen = shards.part_of(chosen, shard, shards.DOCUMENT.read(costs) if costs else None)
    if baseline is not None:
        from lammps_cases.regression import baseline as accepted

        accepted.readable(baseline)  # a typing mistake is said before the run, not after it
    resolved = installations.resolve(options.engine)
    # No tag is that of all cases, so that a run of one is a part: the others need not be read to know.
    names_run = () if tag else [case.name for case in chosen]
    with shared.run_folder(out, names_run, options.engine, resume) as folder:
        if resume and not as_json and folders.resumable(folder) is None:
            all_of_them = f"{counted(len(chosen), 'case')} from the beginning"
            shared.show(f"note: nothing to resume; running {all_of_them}", "  ", fg="yellow")
        with Bar(quiet=as_json, complaints=True) as bar:
            store = prediction_keys.open_store(options.fresh)
            asked = campaign.Request(provenance.command_line(), options.level, part, options.allow)
            run = campaign.run_cases(chosen, resolved, options.processes, folder, asked, bar, store, resume)
        changes = () if baseline is None else _against(baseline, run, folder, {case.name for case in every}, as_json)
    if not as_json:
        _show(_notes([case for case in chosen if not case.shipped], run), shared.stages(run) if profile else ())
    return shared.finish(run, folder, as_json, changes)


def _show(notes: Iterable[str], stages: Iterable[str]) -> None:
    """Print notes in yellow, and where the processor time went."""
    for line in notes:
        shared.show(line, "  ", fg="yellow")
    for line in stages:
        click.echo(line)


def _notes(own: Sequence[Case], run: RunRecord) -> Iterator[str]:
    """Yield what the user's own cases take for granted, and which mistakes they would not show; a line for each."""
    from lammps_cases.records.wording import counted, listed

    taken = Counter(case.scene.defaults for case in own)
    unseen = Counter(tuple(record.lint) for record in run.cases if record.case in {case.name for case in own})
    for defaults, cases in taken.items():
        if defaults:
            yield f"note: defaults used in {counted(cases, 'case')}: {listed(defaults)}"
    for mistakes, cases in unseen.items():
        if mistakes:
            yield f"note: {counted(cases, 'case')} cannot tell apart: {listed(mistakes)}"


def _against(baseline: Path, run: RunRecord, out: Path, cases: set[str], as_json: bool) -> Iterable[str]:
    """Hold a run against what was accepted, unless the engine failed; return lines, and keep in the run what counts."""
    from lammps_cases.regression import pairs
    from lammps_cases.regression.baseline import check
    from lammps_cases.report.annotations import announce_changes
    from lammps_cases.run import report_files

    if run.failed:
        return ()
    changes = check(run, out, baseline, cases)
    run.changed = len(changes.faults)
    if run.changed:
        report_files.write_run(run, out, past=report_files.past_of(run))
    if not as_json:
        announce_changes([pairs.fault(change) for change in changes.faults], os.environ)
    return pairs.checked(changes, f"eos-ref accept {out}")
