"""Common functions of the commands: tables, and the end of a command that writes a report."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import shutil
import sys
import tempfile
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from lammps_cases.records.headline import Headline
    from lammps_cases.records.run_record import RunRecord
    from lammps_cases.report.findings import Outcome
    from lammps_cases.report.history import Past
    from lammps_cases.scene.casefile import Case
    from lammps_cases.versions.changes import Changes

REPORTS = Path("reports")
UNBROKEN = 10_000  # columns of a line in a file or a pipe
PROSE = 22  # minimum width of a column of sentences
LEAST = 20  # columns of a terminal below which it wraps lines itself


@contextmanager
def run_folder(out: Path | None, cases: Iterable[str], engine: str, resume: bool = False) -> Iterator[Path]:
    """Yield the folder of a run of some cases: the given one, or a new one among the whole runs or the parts.

    With ``resume`` it is the folder of the last interrupted run.
    """
    if out is not None:
        yield out
        return
    from lammps_cases.records import folders
    from lammps_cases.scene import casefile

    run = set(cases)
    whole = bool(run) and run.issuperset(case.name for case in casefile.select(casefile.load()))
    shelf = (folders.whole_runs if whole else folders.parts_of_runs)(REPORTS)
    with shelf.place(engine, resume=resume) as folder:
        yield folder


def start_fork_server(pairs: bool = True) -> None:
    """Import what workers need, and start the process that they are forked from, which has the same.

    Without ``pairs`` a worker imports the neighbour search itself, when a case needs it.
    """
    from lammps_cases.engine import forkserver

    with uncollected():
        forkserver.fork_for_judging(pairs)


@contextmanager
def uncollected() -> Iterator[None]:
    """Create permanent objects, such as modules and cases, without garbage collection, a sixth of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:  # not within another such block
            gc.enable()


def page_folder(out: Path) -> None:
    """Create the folder of a command that writes a page, before any long work.

    If it is still empty when the command ends, interrupted, it is removed.

    Raises
    ------
    InputError
        It cannot be written, or holds the report of a run, which would be damaged.
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
    with contextlib.suppress(OSError):  # from the first non-empty one on
        for path in made:
            path.rmdir()


def finish(run: RunRecord, directory: Path, as_json: bool, changes: Iterable[str] = ()) -> int:
    """Print the verdict of a run, the changes against a baseline, and the place of the report; return the exit code."""
    from lammps_cases.records.faults import part
    from lammps_cases.records.folders import is_part
    from lammps_cases.records.wording import lacks
    from lammps_cases.report import formats
    from lammps_cases.report.findings import outcome

    def judged() -> Outcome:
        of_run = outcome(run)
        assert of_run.headline and of_run.rejected is not None  # both are set here
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
        part(
            "output", run.faults, lambda: _close(of_run, directory) if of_run else say(formats.bare_headline(run)), None
        )
        for line in lacks(run.faults):
            show(f"  {line}", "    ", fg="red")
    return run.exit_code(of_run.rejected if of_run else ())


def compared(
    run: RunRecord, folder: Path, changes: Changes, as_json: bool, accept: str, past: Past | None = None
) -> Iterable[str]:
    """Store in a run the number of relevant changes against a baseline, and inform the CI service; return lines.

    ``accept`` is the command that accepts them, ``past`` the earlier runs shown in the report.
    """
    from lammps_cases.report.annotations import announce_changes
    from lammps_cases.run import report_files
    from lammps_cases.versions import pairs

    run.changed = len(changes.faults)
    if run.changed:
        report_files.write_run(run, folder, past=past)
    if not as_json:
        announce_changes([pairs.fault(change) for change in changes.faults], os.environ)
    return pairs.checked(changes, accept)


def _close(of_run: Outcome, directory: Path) -> None:
    from lammps_cases.report.annotations import announce

    announce(of_run, directory, os.environ)
    say(of_run.headline)
    for line in of_run.closing():
        show(line, "        ")


def _answer(of_run: Outcome) -> dict[str, Any]:
    """Return the part of --json before a run's run.json: the answer."""
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


def show_document(content: object) -> None:
    """Print the single document of --json."""
    click.echo(json.dumps(content, indent=1))


def laws(case: Case) -> list[str]:
    """Return the laws of a case, each once."""
    return list(dict.fromkeys(law.style for law in case.scene.pressure))


def say(headline: Headline) -> None:
    """Print a headline in its colour."""
    show(str(headline), "  ", fg=headline.look.terminal, bold=True)


def _details(run: RunRecord) -> None:
    """Print the counts of the cases of a run, those not as expected, and everything else about the run as a whole."""
    from lammps_cases.records.wording import carried, carried_rows, counted, notes, predictions, tally, triage_lines

    click.echo(f"{tally(run)} ({run.seconds:.1f} s)")
    for case in run.cases:
        if not case.as_expected or case.outlook:
            color = "yellow" if case.as_expected else "red"
            show(f"  {case.verdict:9s} {case.case}: {case.message}", 12 * " ", fg=color)
    skipped = Counter(case.message for case in run.cases if case.verdict == "skipped")
    for reason, cases in skipped.items():
        show(f"  {counted(cases, 'case')} skipped: {reason}", "    ")
    for line in triage_lines(run):
        show(f"  {line}", "      ")
    if run.predictions.stored:
        click.echo(f"  {predictions(run.predictions)} (--fresh recomputes them)")
    if run.carried:
        show(f"  {carried(run.carried)}", "    ", fg="yellow")
        for finding, what, cases in carried_rows(run.carried):
            show(f"    {finding:28s} {what}: {counted(cases, 'case')}", "      ")
    for note in notes(run):
        show(f"  {note}", "    ", fg="yellow")


def width() -> int | None:
    """Return the number of columns available for text: those of the terminal, or of COLUMNS; None in a file or pipe."""
    if os.environ.get("COLUMNS", "").isdigit() or sys.stdout.isatty():
        return shutil.get_terminal_size().columns
    return None


def show(text: str, indent: str = "", **style: Any) -> None:
    """Print a paragraph, its further lines indented, broken between words where it does not fit the terminal.

    Control characters, which a deck may contain, have no effect on the terminal.
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
    """Print a table; in a file or pipe as wide as its lines, on a terminal narrow enough that none is broken.

    Parameters
    ----------
    drop : columns that are left out, in this order, until the others fit
    prose : columns of sentences, broken between words; if the table is still too wide, the others are shortened
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
        """Return the table of the selected columns; those of sentences as narrow as possible, or as wide as fits."""
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
    """Yield the processor time of a run: a table of stages, the longest first."""
    from lammps_cases.records.progress import REST, taken

    spent: dict[str, float] = taken()
    for name, seconds in (each for case in run.cases for each in case.seconds.stages.items()):
        spent[name] = spent.get(name, 0.0) + seconds
    lammps = sum(case.seconds.lammps for case in run.cases)
    rest = spent.pop(REST, 0.0)
    spent["LAMMPS"], spent["starting, passing arrays"] = lammps, max(rest - lammps, 0.0)
    total = sum(spent.values())
    for name, seconds in sorted(spent.items(), key=lambda each: -each[1]):
        yield f"  {name:26s} {seconds:8.2f} s {seconds / total:6.1%} {seconds / lammps if lammps else 0:8.2f} x LAMMPS"
