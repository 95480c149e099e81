"""What a history says: what changed from run to run and from engine to engine, and how one case went."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

from eos_ref.errors import InputError, nearest
from lammps_cases.history.model import KINDS, FieldOutcome, Kind, Outcome, Result, Run
from lammps_cases.history.order import Line, engines
from lammps_cases.history.store import History
from lammps_cases.records.wording import listed, size


@dataclass(frozen=True)
class Difference:
    """One run against another: how many of the cases that both have changed in what, and how many only one has."""

    label: str
    common: int
    changed: dict[Kind, int]
    new: int
    gone: int
    other_judge: bool

    @property
    def sentence(self) -> str:
        """In a few words."""
        parts = [f"{kind} of {count}" for kind, count in self.changed.items() if count]
        told = ", ".join(parts) if parts else "same" if self.common else "no case in common"
        more = [f"{count} {word}" for word, count in (("new", self.new), ("not run", self.gone)) if count]
        return f"{told} ({', '.join(more)})" if more else told


@dataclass(frozen=True)
class RunLine:
    """A run, its engine's label, and what changed against the run before on it and against the engine before it."""

    run: Run
    label: str
    same: Difference | None
    before: Difference | None


@dataclass(frozen=True)
class Change:
    """A case, or one field of it (``field`` empty: the case), ended otherwise on an engine than on the one before.

    ``first`` marks the first such change of a case; ``other_judge``: another eos-ref judged, whose scene may differ.
    """

    case: str
    field: str
    kind: Kind
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
        """Of at least one measurement."""
        return cls(statistics.median(seconds), min(seconds), max(seconds), len(seconds))


@dataclass(frozen=True)
class Span:
    """Runs of an engine, one after another, in which a case ended the same."""

    label: str
    since: str
    until: str
    outcome: Outcome
    lammps: Spread
    reference: Spread


@dataclass(frozen=True)
class CaseView:
    """How a case went: spans by engine and date, the time per engine, and what changed."""

    case: str
    spans: tuple[Span, ...]
    times: dict[str, Spread]
    changes: tuple[Change, ...]

    @property
    def latest(self) -> dict[str, Outcome]:
        """The last outcome on each engine."""
        return {span.label: span.outcome for span in self.spans}


def chosen_runs(runs: Sequence[Run], engine: str = "", since: str = "", last: int | None = None) -> list[Run]:
    """Runs by a pattern (or part) of their engine's name, version or label, by date, and the last of them."""
    if engine:
        labels = {run.id: line.label for line in engines(runs) for run in line.runs}
        runs = [run for run in runs if _fits(engine, labels[run.id], run.engine.name, run.engine.distribution)]
    runs = [run for run in runs if run.date >= since]
    return runs[-last:] if last else list(runs)


def _fits(pattern: str, *names: str) -> bool:
    return any(fnmatchcase(name, pattern) or pattern in name for name in names)


def chosen_cases(known: Sequence[str], names: Sequence[str]) -> list[str]:
    """Cases of the history by name, part of a name before a dot, or pattern.

    Raises
    ------
    InputError
        No run has such a case; the nearest is suggested.
    """
    chosen: set[str] = set()
    for name in names:
        hits = [case for case in known if fnmatchcase(case, name) or case.startswith(f"{name}.")]
        if not hits:
            like = nearest(name, sorted({*known, *(case.split(".")[0] for case in known)}))
            raise InputError("case", f"is in no run kept{like}", name)
        chosen.update(hits)
    return sorted(chosen)


def field_only(outcome: Outcome, pattern: str) -> Outcome:
    """An outcome as seen by the fields of a pattern alone."""
    fields = tuple(field for field in outcome.fields if fnmatchcase(field.field, pattern))
    worst = max(fields, key=lambda field: size(field.max_over_bound), default=None)
    if worst is None:
        return replace(outcome, fields=(), worst=None, worst_field="")
    return replace(
        outcome,
        fields=fields,
        worst=worst.max_over_bound,
        worst_field=worst.field if worst.max_over_bound else "",
        verdict=worst.verdict,
    )


def run_lines(history: History, runs: Sequence[Run], every: Sequence[Run]) -> list[RunLine]:
    """Runs, by date, each against what ``every`` run says of its engine at that date and of the engine before.

    A case is compared with its latest run on an engine, so that parts of a run add up. Of an engine before of which
    nothing is older, all is taken: versions need not be run in their order.
    """
    lines = engines(every)
    of = {run.id: line for line in lines for run in line.runs}
    kept = _kept(history.results(of))
    final: dict[str, State] = {line.key: {} for line in lines}
    for run in every:
        final[run.engine.key] |= _state(run, kept)
    wanted = {run.id for run in runs}
    now: dict[str, State] = {line.key: {} for line in lines}
    found: list[tuple[Run, State, State, Line | None]] = []
    for run in every:
        k = lines.index(of[run.id])
        before = lines[k - 1] if k else None
        if run.id in wanted:
            earlier = (now[before.key] or final[before.key]) if before else {}
            found.append((run, dict(now[run.engine.key]), dict(earlier), before))
        now[run.engine.key] |= _state(run, kept)
    mentioned = {outcome for _, same, earlier, _ in found for outcome, _ in (*same.values(), *earlier.values())}
    outcomes = history.outcomes(mentioned | {outcome for run in runs for outcome in kept.get(run.id, {}).values()})
    return [
        RunLine(
            run,
            of[run.id].label,
            _difference(of[run.id].label, _state(run, kept), same, outcomes) if same else None,
            _difference(before.label, _state(run, kept), earlier, outcomes) if before and earlier else None,
        )
        for run, same, earlier, before in found
    ]


State = dict[str, tuple[int, tuple[str, str]]]  # case: (outcome, who judged)


def _kept(results: Iterable[Result]) -> dict[int, dict[str, int]]:
    """The outcome of every case of every run."""
    kept: dict[int, dict[str, int]] = {}
    for result in results:
        kept.setdefault(result.run, {})[result.case] = result.outcome
    return kept


def _state(run: Run, kept: Mapping[int, Mapping[str, int]]) -> State:
    return {case: (outcome, run.made_by) for case, outcome in kept.get(run.id, {}).items()}


def _difference(label: str, now: State, was: State, outcomes: Mapping[int, Outcome]) -> Difference:
    common = now.keys() & was.keys()
    changed = dict.fromkeys(KINDS, 0)
    for case in common:
        if now[case][0] != was[case][0]:
            for kind in {change[1] for change in compared(outcomes[was[case][0]], outcomes[now[case][0]])}:
                changed[kind] += 1
    judge = any(now[case][1] != was[case][1] for case in common)
    return Difference(label, len(common), changed, len(now) - len(common), len(was) - len(common), judge)


def compared(was: Outcome, now: Outcome) -> Iterator[tuple[str, Kind, str, str]]:
    """What changed from one outcome to another: field (empty: the case as a whole), kind, before, after."""
    if was.kind != now.kind:
        yield "", "verdict", was.kind, now.kind
    if was.explained_by != now.explained_by:
        yield "", "finding", listed(was.explained_by), listed(now.explained_by)
    before = {field.name: field for field in was.fields}
    for field in now.fields:
        if field.name in before:
            yield from _fields_compared(before[field.name], field)


def _fields_compared(was: FieldOutcome, now: FieldOutcome) -> Iterator[tuple[str, Kind, str, str]]:
    if was.verdict != now.verdict:
        yield now.name, "verdict", was.verdict, now.verdict
    if was.digest and now.digest and was.digest != now.digest:
        yield now.name, "bits", was.digest, now.digest
    if was.explained_by != now.explained_by:
        yield now.name, "finding", listed(was.explained_by), listed(now.explained_by)


def case_views(history: History, runs: Sequence[Run], cases: Sequence[str], field: str = "") -> list[CaseView]:
    """How some cases went over some runs; of the fields of a pattern alone, if one is given.

    Raises
    ------
    InputError
        None of the cases has such a field.
    """
    results = history.results({run.id for run in runs}, cases)
    outcomes = history.outcomes({result.outcome for result in results})
    if field:
        outcomes = {k: field_only(outcome, field) for k, outcome in outcomes.items()}
        if outcomes and not any(outcome.fields for outcome in outcomes.values()):
            raise InputError("field", "none of these cases has it", field)
    of: dict[str, dict[int, Result]] = {}
    for result in results:
        of.setdefault(result.case, {})[result.run] = result
    lines = engines(runs)
    return [_case_view(case, lines, of[case], outcomes) for case in cases if case in of]


def _case_view(
    case: str, lines: Sequence[Line], results: Mapping[int, Result], outcomes: Mapping[int, Outcome]
) -> CaseView:
    spans: list[Span] = []
    times: dict[str, Spread] = {}
    ended: list[tuple[Line, Run, Outcome]] = []
    for line in lines:
        here = [(run, results[run.id]) for run in line.runs if run.id in results]
        if not here:
            continue
        times[line.label] = Spread.of([result.lammps for _, result in here])
        spans += _spans(line.label, here, outcomes)
        run, result = here[-1]
        ended.append((line, run, outcomes[result.outcome]))
    return CaseView(case, tuple(spans), times, tuple(_changes(case, ended)))


def _spans(label: str, here: Sequence[tuple[Run, Result]], outcomes: Mapping[int, Outcome]) -> Iterator[Span]:
    for outcome, group in itertools.groupby(here, key=lambda pair: pair[1].outcome):
        members = list(group)
        lammps = Spread.of([result.lammps for _, result in members])
        reference = Spread.of([result.reference for _, result in members])
        yield Span(label, members[0][0].date, members[-1][0].date, outcomes[outcome], lammps, reference)


def _changes(case: str, ended: Sequence[tuple[Line, Run, Outcome]]) -> Iterator[Change]:
    first = ""
    for (line, run, was), (later, later_run, now) in itertools.pairwise(ended):
        for field, kind, before, after in compared(was, now):
            first = first or later.label
            judge = run.made_by != later_run.made_by
            yield Change(case, field, kind, later.label, line.label, before, after, first == later.label, judge)
