"""What a report shows of the runs before its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lammps_cases.history.draw import Point
from lammps_cases.history.model import EngineName, Outcome, Result, Run, worst_of
from lammps_cases.history.order import engines
from lammps_cases.history.store import History
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.records.wording import kind

TABLE = 12  # runs in the table of a report
RUNS = 24  # runs in the marks of its cases
_OWN = -1  # id of a report's own run


@dataclass(frozen=True)
class PastRun:
    """A line of the table; ``own``: the run of the report itself."""

    run: Run
    label: str
    own: bool


@dataclass(frozen=True)
class Past:
    """The last runs, latest first, and the marks of every case by version; the report's own run is among both."""

    runs: tuple[PastRun, ...]
    marks: dict[str, tuple[Point, ...]]


def before(history: History, record: RunRecord) -> Past | None:
    """The runs up to the date of one, and that one; None if there are none. The same whenever it is asked for."""
    own = _own(record)
    earlier = [run for run in history.runs() if run.date <= own.date and not _same(run, own)][-RUNS:]
    if not earlier:
        return None
    lines = engines([*earlier, own])
    labels = {run.id: line.label for line in lines for run in line.runs}
    shown = [PastRun(run, labels[run.id], run is own) for run in [own, *reversed(earlier)][:TABLE]]
    results = history.results([run.id for run in earlier], [case.case for case in record.cases])
    outcomes = history.outcomes({result.outcome for result in results}, fields=False)
    marks = {case.case: [(own, _mark(labels[_OWN], own, _ended(case), 1, own=True))] for case in record.cases}
    for run, count, outcome in _spans(results, {run.id: run for run in earlier}):
        mark = _mark(labels[run.id], run, outcomes[outcome], count)
        marks[outcomes[outcome].case].append((run, mark))
    place = {line.key: k for k, line in enumerate(lines)}
    ordered = {
        case: tuple(
            mark for _, mark in sorted(found, key=lambda one: (place[one[0].engine.key], one[0].date, -one[0].id))
        )
        for case, found in marks.items()
    }
    return Past(tuple(shown), ordered)


def _spans(results: Sequence[Result], runs: Mapping[int, Run]) -> list[tuple[Run, int, int]]:
    """The last run of every engine in which a case ended in some way, in how many runs, and that outcome."""
    found: dict[tuple[str, int], tuple[Run, int]] = {}
    for result in results:
        run = runs[result.run]
        last, count = found.get((run.engine.key, result.outcome), (run, 0))
        found[run.engine.key, result.outcome] = max(last, run, key=lambda one: (one.date, one.id)), count + 1
    return [(run, count, outcome) for (_, outcome), (run, count) in found.items()]


def _own(record: RunRecord) -> Run:
    engine = record.engine
    name = EngineName(engine.name, engine.distribution, engine.version_string, engine.git, engine.library_sha256)
    counts = Counter(kind(case) for case in record.cases)
    told = record.command, record.strict, record.shard, record.seconds
    return Run(_OWN, "", record.date, name, "", record.reference, record.machine, *told, dict(counts))


def _same(run: Run, own: Run) -> bool:
    """Whether a kept run is the report's own; a hash of its run.json would take longer than all else here."""
    return (run.date, run.seconds, run.command, run.engine) == (own.date, own.seconds, own.command, own.engine)


def _ended(case: CaseRecord) -> Outcome:
    told = case.natoms, case.steps, case.message, tuple(case.explained_by)
    return Outcome(_OWN, case.case, case.verdict, case.as_expected, *told, *worst_of(case.fields))


def _mark(label: str, run: Run, ended: Outcome, count: int, own: bool = False) -> Point:
    runs = f", last of {count} runs" if count > 1 else ""
    field = f", worst in {ended.worst_field}" if ended.worst_field else ""
    says = f"{label}, {'this run' if own else run.date[:10]}{runs}: {ended.kind}{field}"
    return Point(label, "this run" if own else run.date[:10], ended.kind, ended.worst, says)
