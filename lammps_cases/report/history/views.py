"""What a history says: what changed from run to run and from engine to engine, and how one case went."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from eos_ref.errors import InputError, nearest, unknown
from lammps_cases.records.outcome import PARTS, CaseOutcome, Part, differences
from lammps_cases.report.history.model import StoredCase, StoredRun
from lammps_cases.report.history.store import History
from lammps_cases.report.history.versions import EngineRuns, engines


@dataclass(frozen=True)
class RunDifference:
    """One run against another: how many of the cases that both have changed in what, and how many only one has."""

    label: str
    common: int
    changed: dict[Part, int]
    new: int
    gone: int
    other_judge: bool

    @property
    def sentence(self) -> str:
        """The difference in a few words."""
        parts = [f"other {kind} in {count}" for kind, count in self.changed.items() if count]
        text = ", ".join(parts) if parts else "same" if self.common else "no case in common"
        more = [f"{count} {word}" for word, count in (("new", self.new), ("not run", self.gone)) if count]
        return f"{text} ({', '.join(more)})" if more else text


@dataclass(frozen=True)
class RunLine:
    """A run, its engine's label, and what changed against the run before on it and against the engine before it."""

    run: StoredRun
    label: str
    same: RunDifference | None
    before: RunDifference | None


@dataclass(frozen=True)
class EngineChange:
    """A case, or one field of it (``field`` empty: the case), whose outcome differs from that on the engine before.

    ``first`` marks the first such change of a case; ``other_judge``: another eos-ref judged, whose scene may differ.
    """

    case: str
    field: str
    kind: Part
    engine: str
    before: str
    was: str
    now: str
    first: bool
    other_judge: bool


@dataclass(frozen=True)
class Spread:
    """Median and range of some seconds."""

    median: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, seconds: Sequence[float]) -> Spread:
        """Return median and range of at least one measurement."""
        return cls(statistics.median(seconds), min(seconds), max(seconds), len(seconds))


@dataclass(frozen=True)
class Span:
    """Runs of an engine, one after another, in which a case ended the same."""

    label: str
    since: str
    until: str
    outcome: CaseOutcome
    lammps: Spread
    reference: Spread

    @property
    def days(self) -> str:
        """First and last day, or the only one."""
        first, last = self.since[:10], self.until[:10]
        return first if first == last else f"{first} to {last}"


@dataclass(frozen=True)
class CaseView:
    """How a case went: spans by engine and date, the time per engine, and what changed."""

    case: str
    spans: tuple[Span, ...]
    times: dict[str, Spread]
    changes: tuple[EngineChange, ...]

    @property
    def latest(self) -> dict[str, CaseOutcome]:
        """The last outcome on each engine."""
        return {span.label: span.outcome for span in self.spans}


def chosen_runs(
    runs: Sequence[StoredRun], engine: str = "", since: str = "", last: int | None = None
) -> list[StoredRun]:
    """Select runs by a pattern (or part) of their engine's name, version or label, by date, and the last of them.

    Raises
    ------
    InputError
        No run has such an engine.
    """
    if engine:
        labels = {run.id: line.label for line in engines(runs) for run in line.runs}
        fitting = [run for run in runs if _fits(engine, labels[run.id], run.engine.name, run.engine.distribution)]
        if runs and not fitting:
            there = ", ".join(dict.fromkeys(labels.values()))
            raise InputError(
                "engine", f"must be one of which a run is kept ({there}), or part of it", engine, "--engine"
            )
        runs = fitting
    runs = [run for run in runs if run.date >= since]
    return runs[-last:] if last else list(runs)


def _fits(pattern: str, *names: str) -> bool:
    return any(fnmatchcase(name, pattern) or pattern in name for name in names)


def chosen_cases(stored: Sequence[str], names: Sequence[str]) -> list[str]:
    """Select cases of the history by name, part of a name before a dot, or pattern.

    Raises
    ------
    InputError
        No run has such a case; the nearest is suggested.
    """
    chosen: set[str] = set()
    for name in names:
        hits = [case for case in stored if fnmatchcase(case, name) or case.startswith(f"{name}.")]
        if not hits:
            raise unknown("case in any stored run", name, sorted({*stored, *(case.split(".")[0] for case in stored)}))
        chosen.update(hits)
    return sorted(chosen)


def run_lines(history: History, runs: Sequence[StoredRun], every: Sequence[StoredRun]) -> list[RunLine]:
    """Compare runs, by date, with what ``every`` run says of their engine at that date and of the engine before.

    A case is compared with its latest run on an engine, so that parts of a run add up. Of an engine before of which
    nothing is older, all is taken: versions need not be run in their order.
    """
    lines = engines(every)
    place = {run.id: k for k, line in enumerate(lines) for run in line.runs}
    by_run = _by_run(history.results(place), every)
    final: list[LastOutcomes] = [{} for _ in lines]
    for run in every:
        final[place[run.id]] |= by_run[run.id]
    wanted = {run.id for run in runs}
    so_far: list[LastOutcomes] = [{} for _ in lines]
    rows: list[tuple[StoredRun, LastOutcomes, LastOutcomes]] = []
    for run in every:
        k = place[run.id]
        if run.id in wanted:
            rows.append((run, dict(so_far[k]), dict(so_far[k - 1] or final[k - 1]) if k else {}))
        so_far[k] |= by_run[run.id]
    compared = [each.values() for run, same, earlier in rows for each in (by_run[run.id], same, earlier)]
    outcomes = history.outcomes({outcome for each in compared for outcome, _ in each})
    return [
        RunLine(
            run,
            lines[place[run.id]].label,
            _difference(lines[place[run.id]].label, by_run[run.id], same, outcomes),
            _difference(lines[place[run.id] - 1].label, by_run[run.id], earlier, outcomes),
        )
        for run, same, earlier in rows
    ]


# Of every case, the id of its last outcome and the eos-ref that judged it.
LastOutcomes = dict[str, tuple[int, tuple[str, str]]]


def _by_run(cases: Iterable[StoredCase], runs: Sequence[StoredRun]) -> dict[int, LastOutcomes]:
    judges = {run.id: run.made_by for run in runs}
    outcomes: dict[int, LastOutcomes] = {run.id: {} for run in runs}
    for case in cases:
        outcomes[case.run][case.case] = case.outcome, judges[case.run]
    return outcomes


def _difference(
    label: str, now: LastOutcomes, was: LastOutcomes, outcomes: Mapping[int, CaseOutcome]
) -> RunDifference | None:
    if not was:
        return None
    common = now.keys() & was.keys()
    changed = dict.fromkeys(PARTS, 0)
    for case in common:
        if now[case][0] != was[case][0]:
            for part in {part for _, part, *_ in differences(outcomes[was[case][0]], outcomes[now[case][0]])}:
                changed[part] += 1
    judge = any(now[case][1] != was[case][1] for case in common)
    return RunDifference(label, len(common), changed, len(now) - len(common), len(was) - len(common), judge)


def case_views(history: History, runs: Sequence[StoredRun], cases: Sequence[str], field: str = "") -> list[CaseView]:
    """Return how some cases went over some runs; of the fields of a pattern alone, if one is given.

    Raises
    ------
    InputError
        None of the cases has such a field.
    """
    results = history.results({run.id for run in runs}, cases)
    outcomes = history.outcomes({result.outcome for result in results})
    if field:
        had = {name for outcome in outcomes.values() for name in outcome.fields}
        outcomes = {k: outcome.restricted(field) for k, outcome in outcomes.items()}
        if outcomes and not any(outcome.fields for outcome in outcomes.values()):
            raise InputError("field", f"none of these cases has it{nearest(field, had)}", field)
    of: dict[str, dict[int, StoredCase]] = {}
    for result in results:
        of.setdefault(result.case, {})[result.run] = result
    lines = engines(runs)
    return [_case_view(case, lines, of[case], outcomes) for case in cases if case in of]


def _case_view(
    case: str, lines: Sequence[EngineRuns], results: Mapping[int, StoredCase], outcomes: Mapping[int, CaseOutcome]
) -> CaseView:
    spans: list[Span] = []
    times: dict[str, Spread] = {}
    ended: list[tuple[EngineRuns, StoredRun, CaseOutcome]] = []
    for line in lines:
        here = [(run, results[run.id]) for run in line.runs if run.id in results]
        if not here:
            continue
        times[line.label] = Spread.of([result.lammps for _, result in here])
        spans += _spans(line.label, here, outcomes)
        run, result = here[-1]
        ended.append((line, run, outcomes[result.outcome]))
    return CaseView(case, tuple(spans), times, tuple(_changes(case, ended)))


def _spans(
    label: str, here: Sequence[tuple[StoredRun, StoredCase]], outcomes: Mapping[int, CaseOutcome]
) -> Iterator[Span]:
    for outcome, group in itertools.groupby(here, key=lambda pair: pair[1].outcome):
        members = list(group)
        lammps = Spread.of([result.lammps for _, result in members])
        reference = Spread.of([result.reference for _, result in members])
        yield Span(label, members[0][0].date, members[-1][0].date, outcomes[outcome], lammps, reference)


def _changes(case: str, ended: Sequence[tuple[EngineRuns, StoredRun, CaseOutcome]]) -> Iterator[EngineChange]:
    first = ""
    for (line, run, was), (later, later_run, now) in itertools.pairwise(ended):
        for field, kind, before, after in differences(was, now):
            first = first or later.label
            judge = run.made_by != later_run.made_by
            yield EngineChange(case, field, kind, later.label, line.label, before, after, first == later.label, judge)
