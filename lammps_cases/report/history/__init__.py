"""Runs kept over time: the changes of verdicts, errors and times from one engine, and one day, to the next.

`collect` keeps a run, `past` returns the earlier runs that a report shows, `document` and `change_lines` the output of
the command; an unusable history never fails a run.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from eos_ref.errors import InputError
from lammps_cases.records.documents import SCHEMAS
from lammps_cases.records.outcome import CaseOutcome
from lammps_cases.records.run_record import RunRecord
from lammps_cases.records.wording import plain
from lammps_cases.report.history.store import History, StoredCase, StoredRun, history_file
from lammps_cases.report.history.views import CaseView, RunLine, RunMark, changed_findings, engines, mark, steps

TABLE = 12  # runs in the table of a report
RUNS = 24  # runs in the marks of its cases
# The JSON document's keys of an engine, of an outcome, and of each of its fields.
ENGINE = ("name", "distribution", "version_string", "git", "library_sha256")
OUTCOME = ("id", "case", "verdict", "expected", "natoms", "steps", "message", "explained_by", "worst", "worst_field")
FIELD = ("field", "atom_type", "verdict", "max_over_bound", "max_abs", "digest", "explained_by")


@dataclass(frozen=True)
class PastRun:
    """A line of the table; ``own``: the run of the report itself."""

    run: StoredRun
    label: str
    own: bool
    cases: int
    counts: dict[str, int]


@dataclass(frozen=True)
class Past:
    """The last runs, latest first, and the marks of every case by version; both include the report's own run."""

    runs: tuple[PastRun, ...]
    marks: dict[str, tuple[RunMark, ...]]


def runs_before(history: History, record: RunRecord) -> Past | None:
    """Return the runs up to the date of one, including it; None without earlier runs."""
    own = StoredRun.of(record)
    earlier = [run for run in history.runs() if run.date <= own.date and not _is_own(run, own)][-RUNS:]
    if not earlier:
        return None
    lines = engines([*earlier, own])
    labels = {run.id: line.label for line in lines for run in line.runs}
    latest = [own, *reversed(earlier)][:TABLE]
    shown = [PastRun(run, labels[run.id], run is own, run.cases, run.ordered_counts) for run in latest]
    results = history.results([run.id for run in earlier], [case.case for case in record.cases])
    outcomes = history.outcomes({result.outcome for result in results}, fields=False)
    rows = {
        case.case: [(own, mark(labels[own.id], "this run", "this run", CaseOutcome.of(case)))] for case in record.cases
    }
    for run, count, outcome in _last_runs(results, {run.id: run for run in earlier}):
        when = run.date[:10] + (f", last of {count} runs" if count > 1 else "")
        rows[outcomes[outcome].case].append((run, mark(labels[run.id], run.date[:10], when, outcomes[outcome])))
    place = {line.key: k for k, line in enumerate(lines)}

    def order(row: tuple[StoredRun, RunMark]) -> tuple[int, str, int]:
        return place[row[0].engine.key], row[0].date, -row[0].id

    marks = {case: tuple(point for _, point in sorted(of_case, key=order)) for case, of_case in rows.items()}
    return Past(tuple(shown), marks)


def _last_runs(results: Sequence[StoredCase], runs: Mapping[int, StoredRun]) -> list[tuple[StoredRun, int, int]]:
    """Find the last run of every engine with each outcome of a case, the number of such runs, and the outcome."""
    spans: dict[tuple[str, int], tuple[StoredRun, int]] = {}
    for result in results:
        run = runs[result.run]
        last, count = spans.get((run.engine.key, result.outcome), (run, 0))
        spans[run.engine.key, result.outcome] = max(last, run, key=lambda one: (one.date, one.id)), count + 1
    return [(run, count, outcome) for (_, outcome), (run, count) in spans.items()]


def _is_own(run: StoredRun, own: StoredRun) -> bool:
    """Return whether a stored run is the report's own; hashing its run.json would take longer than all the rest."""
    one, other = ((each.date, each.seconds, each.command, each.engine.key) for each in (run, own))
    return one == other


def change_lines(view: CaseView) -> list[str]:
    """Return a line for every engine that changed a case."""
    lines: list[str] = []
    for step in steps([view]):
        changes = step.cases[view.case]
        parts = [f"{c.was} to {c.now}" for c in changes if c.kind == "verdict" and not c.field]
        parts += [f"finding {was or 'none'} to {now or 'none'}" for was, now in changed_findings(changes)]
        bits = [c.field for c in changes if c.kind == "bits"]
        parts += [f"different bits of {', '.join(bits)}"] if bits else []
        fields = [c.field for c in changes if c.kind == "verdict" and c.field]
        parts += [f"verdict of {', '.join(fields)}"] if fields else []
        judge = " (judged by another eos-ref)" if changes[0].other_judge else ""
        when = "then" if lines else "first"
        lines.append(f"{when} changed in {step.engine}, from {step.before}: {'; '.join(parts)}{judge}")
    return lines or ["the same on every engine" if len(view.times) > 1 else "run on one engine"]


def document(path: Path, lines: Sequence[RunLine], case_views: Sequence[CaseView] | None) -> dict[str, Any]:
    """Return everything as one document; numbers that JSON lacks are text, as in run.json."""

    def run(of: StoredRun) -> dict[str, Any]:
        return vars(of) | {"engine": {name: getattr(of.engine, name) for name in ENGINE}}

    def outcome(of: CaseOutcome) -> dict[str, Any]:
        fields = [{name: getattr(field, name) for name in FIELD} for field in of.fields.values()]
        return {name: getattr(of, name) for name in OUTCOME} | {"fields": fields}

    content: dict[str, Any] = {"schema": SCHEMAS["history"], "file": str(path)}
    content["runs"] = [plain(asdict(line) | {"run": run(line.run)}) for line in lines]
    if case_views is not None:
        content["cases"] = [
            plain(asdict(view) | {"spans": [asdict(span) | {"outcome": outcome(span.outcome)} for span in view.spans]})
            for view in case_views
        ]
    return content


def collect(run: RunRecord, directory: Path | None = None) -> None:
    """Keep a run in the user's history; a failure is only reported in one line on standard error.

    ``directory`` is its report folder, if it has one: making its run.json again takes half of the time.
    """
    with _forgiven("this run is not in the history"):
        if place := history_file():
            content = (directory / "run.json").read_bytes() if directory else None
            with History(place) as history:
                history.add(run, content, _revision())


def past(run: RunRecord) -> Past | None:
    """Return the earlier runs that a report shows; None without a readable history."""
    with _forgiven("the report shows no history"):
        if place := history_file():
            with History(place) as history:
                return runs_before(history, run)
    return None


@contextmanager
def _forgiven(complaint: str) -> Iterator[None]:
    """Report an unusable history in one line on standard error, and continue."""
    try:
        yield
    except (InputError, OSError) as error:
        print(f"eos-ref: {complaint}: {' '.join(str(error).split())}", file=sys.stderr)


def _revision() -> str:
    """Return the git revision of the sources, with ``-dirty`` if files were changed; empty for an installed package."""
    root = Path(__file__).parents[3]
    if not (root / ".git").exists():
        return ""
    try:
        described = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12"],
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return described.stdout.strip() if described.returncode == 0 else ""
