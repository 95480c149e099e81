"""What a report shows of the runs before its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lammps_cases.records.outcome import CaseOutcome
from lammps_cases.records.run_record import RunRecord
from lammps_cases.report.history.draw import RunMark, mark
from lammps_cases.report.history.model import StoredCase, StoredRun
from lammps_cases.report.history.store import History
from lammps_cases.report.history.versions import engines

TABLE = 12  # runs in the table of a report
RUNS = 24  # runs in the marks of its cases


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
    """The last runs, latest first, and the marks of every case by version; the report's own run is among both."""

    runs: tuple[PastRun, ...]
    marks: dict[str, tuple[RunMark, ...]]


def before(history: History, record: RunRecord) -> Past | None:
    """Return the runs up to the date of one, and that one; None without earlier runs."""
    own = StoredRun.of(record)
    earlier = [run for run in history.runs() if run.date <= own.date and not _same(run, own)][-RUNS:]
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
    for run, count, outcome in _spans(results, {run.id: run for run in earlier}):
        when = run.date[:10] + (f", last of {count} runs" if count > 1 else "")
        rows[outcomes[outcome].case].append((run, mark(labels[run.id], run.date[:10], when, outcomes[outcome])))
    place = {line.key: k for k, line in enumerate(lines)}

    def order(row: tuple[StoredRun, RunMark]) -> tuple[int, str, int]:
        return place[row[0].engine.key], row[0].date, -row[0].id

    marks = {case: tuple(point for _, point in sorted(of_case, key=order)) for case, of_case in rows.items()}
    return Past(tuple(shown), marks)


def _spans(results: Sequence[StoredCase], runs: Mapping[int, StoredRun]) -> list[tuple[StoredRun, int, int]]:
    """Find the last run of every engine with each outcome of a case, the number of such runs, and the outcome."""
    spans: dict[tuple[str, int], tuple[StoredRun, int]] = {}
    for result in results:
        run = runs[result.run]
        last, count = spans.get((run.engine.key, result.outcome), (run, 0))
        spans[run.engine.key, result.outcome] = max(last, run, key=lambda one: (one.date, one.id)), count + 1
    return [(run, count, outcome) for (_, outcome), (run, count) in spans.items()]


def _same(run: StoredRun, own: StoredRun) -> bool:
    """Return whether a stored run is the report's own; hashing its run.json would take longer than all else here."""
    one, other = ((each.date, each.seconds, each.command, each.engine.key) for each in (run, own))
    return one == other
