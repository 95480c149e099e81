"""eos-ref history."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click
from annotated_types import Ge

from lammps_cases.cli import shared
from lammps_cases.cli.commands import Json, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.records.wording import brief, counted

if TYPE_CHECKING:
    from lammps_cases.report.history.views import CaseView, RunLine, Spread

SHOWN = 20  # runs listed by default
Only = Literal["verdicts", "times", "errors"]
PARTS = {"verdicts": "the verdicts", "times": "LAMMPS' seconds", "errors": "the errors"}
ONLY = [
    click.Option([f"--{name}", "only"], flag_value=name, help=f"For cases, show only {what}.")
    for name, what in PARTS.items()
]


@dataclass(frozen=True)
class ShownOptions:
    """The selected runs and errors."""

    field: Annotated[str, Option("Only errors of this field (a name or pattern).")] = ""
    engine: Annotated[str, Option("Only engines whose name or version fits this pattern, or holds it.")] = ""
    since: Annotated[str, Option("Only runs from this day on (2026-01-31).", metavar="DATE")] = ""
    last: Annotated[Annotated[int, Ge(1)] | None, Option(f"Only the last N runs (list of runs: {SHOWN}).")] = None


@command(*ONLY)
def history_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[CASE]...", complete="cases")] = (),
    *,
    shown: ShownOptions,
    add: Annotated[tuple[Path, ...], Option("Report folder to keep; repeatable.")] = (),
    only: Only | None = None,
    out: Annotated[Path, Option("Folder of the page.")] = Path("reports/history"),
    db: Annotated[Path | None, Option("Another history file instead of EOS_REF_HISTORY or the user's own.")] = None,
    forget: Annotated[str, Option("Delete the runs before this day, and do nothing else.", metavar="DATE")] = "",
    as_json: Json = False,
) -> int:
    """Show the stored runs and what changed from one to the next; with names, the results of these cases.

    Every run is kept in the user's data folder (EOS_REF_HISTORY names another file, or is off). A name selects a case,
    or all below it, or a pattern. Versions are in their natural order, your own builds by date. Writes
    history.html, or with names cases.html, into the folder of --out.

    \b
    Example:  eos-ref history
              eos-ref history near-rho0.linear.2d --field pressure
              eos-ref history 'forces.*' --times --engine 2025.7.22
              eos-ref history --add reports/latest --last 5
    """
    from lammps_cases.report.history import document, page, views
    from lammps_cases.report.history.store import History, chosen_file
    from lammps_cases.report.history.views import engines

    with Bar(quiet=as_json) as bar, History(chosen_file(db, bool(add))) as history:
        if forget:
            count = history.forget(day := _day(forget, "--forget"))
            text = f"{counted(count, 'run')} before {day} forgotten, {len(history.runs())} left"
            click.echo(json.dumps({"forgotten": count}, indent=1) if as_json else text)
            return 0
        for k, path in enumerate(add):
            bar.advance(k, len(add), str(path))
            history.add_report(path)
        bar.advance(0, None, "reading the history")
        every = history.runs()
        since, last = _day(shown.since, "--since"), shown.last or (None if names else SHOWN)
        runs = views.chosen_runs(every, shown.engine, since, last)
        lines = views.run_lines(history, runs, every)
        stored = history.cases()
        cases = views.chosen_cases(stored, names) if names else stored
        case_views = views.case_views(history, runs, cases, shown.field)
        keys = {run.engine.key for run in runs}
        labels = [line.label for line in engines(every) if line.key in keys]
        page_file = None
        if runs:
            shared.page_folder(out)
            page_file = page.write(out, lines, case_views, labels, pictured=bool(names))
    if as_json:
        content = document(history.path, lines, case_views if names else None)
        click.echo(json.dumps(content, indent=1, allow_nan=False))
        return 0
    if not every:
        click.echo(f"no run is kept yet in {history.path}; eos-ref run keeps every run, --add RUN adds earlier ones")
    elif not names:
        _show_runs(lines, len(every), "" if shown.engine or since else f" (--last {len(every)} lists all)")
    elif len(case_views) == 1:
        _show_case(case_views[0], only)
    else:
        _show_cases(case_views, labels, only)
    if page_file:
        click.echo(f"page: {page_file}")
    return 0


def _day(text: str, option: str) -> str:
    import datetime

    from eos_ref import InputError

    try:
        return datetime.date.fromisoformat(text).isoformat() if text else ""
    except ValueError:
        raise InputError("date", "must be a day such as 2026-01-31", text, option) from None


def _show_runs(lines: Sequence[RunLine], every: int, more: str) -> None:
    rows = [
        (
            line.run.date[:16].replace("T", " "),
            line.label,
            ", ".join(f"{count} {kind}" for kind, count in line.run.ordered_counts.items()),
            f"{line.run.seconds:.1f}",
            line.same.sentence if line.same else "first run",
            f"{line.before.label}: {line.before.sentence}" if line.before else "",
        )
        for line in lines
    ]
    columns = ("date", "engine", "cases", "seconds", "vs. same engine", "vs. previous version")
    if rows:
        shared.table(columns, rows, drop=columns[:2:-1], prose=(columns[2], *columns[4:]))
    if len(lines) < every:
        click.echo(f"{len(lines)} of {every} runs{more}")


def _show_case(view: CaseView, only: Only | None) -> None:
    from lammps_cases.report.history import change_lines
    from lammps_cases.report.history.views import spark

    errors = spark([span.outcome.worst for span in view.spans], logarithmic=True)
    times = spark([span.lammps.median for span in view.spans])
    click.secho(f"{view.case}   error {errors}   LAMMPS {times}", bold=True)
    columns: dict[str, list[str]] = {
        "engine": [span.label for span in view.spans],
        "date": [span.days for span in view.spans],
        "runs": [str(span.lammps.count) for span in view.spans],
    }
    if only in (None, "verdicts"):
        columns["verdict"] = [span.outcome.kind for span in view.spans]
    if only in (None, "errors"):
        columns["diff/bound"] = [brief(span.outcome.worst) for span in view.spans]
        columns["worst field"] = [span.outcome.worst_field for span in view.spans]
    if only in (None, "times"):
        columns["LAMMPS s"] = [_seconds(span.lammps) for span in view.spans]
        columns["reference s"] = [_seconds(span.reference) for span in view.spans]
    least = ("date", "runs", "reference s", "LAMMPS s", "worst field")
    shared.table(list(columns), list(zip(*columns.values(), strict=True)), drop=[c for c in least if c in columns])
    for text in change_lines(view):
        click.echo(text)


def _show_cases(case_views: Sequence[CaseView], labels: Sequence[str], only: Only | None) -> None:
    from lammps_cases.report.history.views import spark

    rows = []
    for view in case_views:
        cells = []
        for label in labels:
            ended, spread = view.latest.get(label), view.times.get(label)
            parts = [ended.kind] if ended and only in (None, "verdicts") else []
            parts += [brief(ended.worst)] if ended and only in (None, "errors") else []
            parts += [_seconds(spread)] if spread and only == "times" else []
            cells.append(" ".join(parts))
        first = next((change.engine for change in view.changes if change.first), "")
        values = [span.lammps.median if only == "times" else span.outcome.worst for span in view.spans]
        rows.append((view.case, spark(values, logarithmic=only != "times"), *cells, first))
    spark_of = "time" if only == "times" else "error"
    shared.table(("case", spark_of, *labels, "first change"), rows, drop=(spark_of, *labels[:-1], "first change"))


def _seconds(spread: Spread) -> str:
    text = f"{spread.median:.3g}"
    return f"{text} ({spread.low:.3g} to {spread.high:.3g})" if spread.count > 1 else text
