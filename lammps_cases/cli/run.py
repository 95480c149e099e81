"""Runs and the processing of finished runs: run, list, report, diagnose, merge."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import CLUSTER, LAUNCHER, MEMORY, Json, Report, Run, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import Files, RunOptions, Tag, paths

if TYPE_CHECKING:
    from lammps_cases.records.run_record import RunRecord
    from lammps_cases.scene.casefile import Case


WITHOUT_PAIRS = ("eos",)  # tags of cases few of which find neighbours: known before they are read


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

    Without names: every case that is not tagged long or more; those tagged more see nothing that the others do not see,
    --tag all runs both. A name selects a case, or all below it, or a pattern. Without --out a whole run is kept in
    reports, and reports/latest points to it; a run of some cases in reports/parts.

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
    with shared.uncollected():
        from lammps_cases.comparison.store import code, current, open_store

        store = open_store(options.fresh)
        for each in (store, replace(store, context=code(store.context))):
            current(each)  # hashes all sources, once for all workers, which have this process' code
        shared.start_fork_server(pairs=options.fresh or tag not in WITHOUT_PAIRS)
        from lammps_cases.engine import installations
        from lammps_cases.records import folders
        from lammps_cases.records.wording import counted
        from lammps_cases.run import campaign, provenance, report_files, shards
        from lammps_cases.scene import casefile

        every = casefile.load(options.paths, None if names or baseline else tag)
    chosen = casefile.select(every, names, tag)
    part = (shard or "", shards.divided(case.name for case in chosen) if shard else "")
    if shard:
        chosen = shards.part_of(chosen, shard, shards.DOCUMENT.read(costs) if costs else None)
    if baseline is not None:
        from lammps_cases.versions import baseline as accepted

        accepted.readable(baseline)  # report a typing mistake before the run, not after it
    resolved = installations.resolve(options.engine)
    # A run with a tag is a part, for which the other cases need not be read.
    names_run = () if tag not in (None, casefile.ALL) else [case.name for case in chosen]
    with shared.run_folder(out, names_run, options.engine, resume) as folder:
        if resume and not as_json and folders.resumable(folder) is None:
            all_of_them = f"{counted(len(chosen), 'case')} from the beginning"
            shared.show(f"note: nothing to resume; running {all_of_them}", "  ", fg="yellow")
        with Bar(quiet=as_json, complaints=True) as bar:
            asked = campaign.Request(provenance.command_line(), options.level, part, options.allow)
            run = campaign.run_cases(chosen, resolved, options.processes, folder, asked, bar, store, resume)
        changes: Iterable[str] = ()
        if baseline is not None and not run.failed:
            found = accepted.check(run, folder, baseline, {case.name for case in every})
            past = report_files.past_of(run) if found.faults else None
            changes = shared.compared(run, folder, found, as_json, f"eos-ref accept {folder}", past)
    if not as_json:
        for note in _notes([case for case in chosen if not case.shipped], run):
            shared.show(note, "  ", fg="yellow")
        for line in shared.stages(run) if profile else ():
            click.echo(line)
    return shared.finish(run, folder, as_json, changes)


def _notes(own: Sequence[Case], run: RunRecord) -> Iterator[str]:
    """Yield the assumptions of the user's own cases, and the mistakes they would not show; a line for each."""
    from lammps_cases.records.wording import counted, listed

    taken = Counter(case.scene.defaults for case in own)
    unseen = Counter(tuple(record.lint) for record in run.cases if record.case in {case.name for case in own})
    for defaults, cases in taken.items():
        if defaults:
            yield f"note: defaults used in {counted(cases, 'case')}: {listed(defaults)}"
    for mistakes, cases in unseen.items():
        if mistakes:
            yield f"note: {counted(cases, 'case')} cannot tell apart: {listed(mistakes)}"


@command()
def list_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[CASE]...", complete="cases")] = (),
    tag: Tag = None,
    files: Files = (),
    as_json: Json = False,
) -> int:
    """List the cases with their tags; --json also says what each is about, and how large it is.

    \b
    Example:  eos-ref list --tag quick
    """
    from lammps_cases.records.wording import counted
    from lammps_cases.scene import casefile

    cases = casefile.load(paths(files))
    if names or tag:
        cases = casefile.select(cases, names, tag)
    if as_json:
        shared.show_document({"cases": [_document(case) for case in cases]})
        return 0
    rows = [(c.name, ", ".join(c.tags), ", ".join(shared.laws(c)), c.scene.units) for c in cases]
    shared.table(("case", "tags", "laws", "units"), rows, counted(len(cases), "case"), drop=("units", "laws", "tags"))
    return 0


def _document(case: Case) -> dict[str, Any]:
    """Return the data by which a script chooses cases."""
    from lammps_cases.scene import atoms

    scene = case.scene
    return {
        "case": case.name,
        "about": case.about,
        "file": str(case.source),
        "tags": list(case.tags),
        "laws": shared.laws(case),
        "units": scene.units,
        "dimension": scene.dimension,
        "atoms": len(atoms.build(case, None)),
        "steps": scene.evolve.steps if scene.evolve else 0,
        "fields": [] if scene.expect else list(scene.compare),
    }


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
        from lammps_cases.report import formats
        from lammps_cases.report.findings import outcome

        if _is_run(dashboard):
            raise InputError("--dashboard", "must not be the record of a run", where=str(dashboard))
        try:
            write_atomically(dashboard, formats.dashboard(outcome(record)))
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


@command()
def diagnose_command(run: Run, cases: Files = (), as_json: Json = False) -> int:
    """Group the red cases of a finished run, say what their scenes share, and try changes of the formulas.

    Needs the cases as they were and the arrays of the report, not LAMMPS. Rewrites the report.

    \b
    Example:  eos-ref diagnose reports/latest
    """
    from lammps_cases.comparison.store import open_store
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


@command()
def merge_command(runs: Annotated[tuple[Path, ...], Positional()], out: Report = None, as_json: Json = False) -> int:
    """Join the report folders of a run's shards into one.

    \b
    Example:  eos-ref merge reports/shard-1 reports/shard-2
    """
    from eos_ref import InputError
    from lammps_cases.records.run_record import read_run
    from lammps_cases.run.shards import merge

    parts = [read_run(run) for run in runs]
    if len(parts) == 1 and not parts[0].shard:
        raise InputError("runs", "must be several, or the one shard of a run: there is nothing to join", str(runs[0]))
    with shared.run_folder(out, (case.case for part in parts for case in part.cases), parts[0].engine.name) as folder:
        merged = merge(runs, folder)
    return shared.finish(merged, folder, as_json)
