"""The development of runs and cases over engines: engines by version, differences, spans, marks and bars."""

from __future__ import annotations

import itertools
import math
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from packaging.version import InvalidVersion, Version

from eos_ref.errors import InputError, nearest, unknown
from lammps_cases.records.outcome import PARTS, CaseOutcome, Part, differences
from lammps_cases.records.run_record import HASH
from lammps_cases.records.wording import counted
from lammps_cases.report.history.store import History, StoredCase, StoredRun

_BARS = "▁▂▃▄▅▆▇█"
FLOOR = -4  # decade below which errors are not distinguished


@dataclass(frozen=True)
class EngineRuns:
    """An engine and its runs, by date; ``label`` distinguishes it from all others."""

    key: str
    label: str
    runs: tuple[StoredRun, ...]


def natural(version: str) -> tuple[bool, Version | list[tuple[int, str]]]:
    """Return the sort key of versions: 1.2 < 1.10rc1 < 1.10 < 1.10.post1; labels that are not versions come first.

    Numbers within such labels sort by value, between words in alphabetical order.
    """
    try:
        return True, Version(version)
    except InvalidVersion:
        parts = re.findall(r"\d+|[a-z]+", version.lower())
        return False, [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def engines(runs: Sequence[StoredRun]) -> list[EngineRuns]:
    """Sort runs by engine: releases by version, then local builds by the date of their first run."""
    of: dict[str, list[StoredRun]] = {}
    for run in sorted(runs, key=lambda run: (run.date, run.id)):
        of.setdefault(run.engine.key, []).append(run)
    groups = sorted(of.values(), key=_version_place)
    labels = [_release(group) or group[-1].engine.label for group in groups]
    lines = []
    for label, group in zip(labels, groups, strict=True):
        engine = group[0].engine
        hash_digits = f" {engine.library_sha256[:HASH]}"
        unique = labels.count(label) == 1 or label.endswith(hash_digits)
        lines.append(EngineRuns(engine.key, label if unique else label + hash_digits, tuple(group)))
    return lines


def _release(group: Sequence[StoredRun]) -> str:
    """Return the release of a library, whatever its name in the run; empty for the user's own build."""
    return next((run.engine.release for run in group if run.engine.release), "")


def _version_place(group: Sequence[StoredRun]) -> tuple[object, ...]:
    release = _release(group)
    return (0, natural(release), group[0].date) if release else (1, group[0].date, group[0].engine.key)


@dataclass(frozen=True)
class RunDifference:
    """One run against another: the numbers of changed cases among those in both, by kind, and of cases in only one."""

    label: str
    common: int
    changed: dict[Part, int]
    new: int
    gone: int
    other_judge: bool

    @property
    def sentence(self) -> str:
        """Return the difference in a few words."""
        parts = [f"other {kind} in {count}" for kind, count in self.changed.items() if count]
        text = ", ".join(parts) if parts else "same" if self.common else "no case in common"
        more = [f"{count} {word}" for word, count in (("new", self.new), ("not run", self.gone)) if count]
        return f"{text} ({', '.join(more)})" if more else text


@dataclass(frozen=True)
class RunLine:
    """A run, its engine's label, and its changes against the previous run on it and against the previous engine."""

    run: StoredRun
    label: str
    same: RunDifference | None
    before: RunDifference | None


@dataclass(frozen=True)
class EngineChange:
    """A case, or one field of it (``field`` empty: the case), whose outcome differs from that on the previous engine.

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
    """Consecutive runs of an engine with the same outcome of a case."""

    label: str
    since: str
    until: str
    outcome: CaseOutcome
    lammps: Spread
    reference: Spread

    @property
    def days(self) -> str:
        """Return the first and last day, or the only one."""
        first, last = self.since[:10], self.until[:10]
        return first if first == last else f"{first} to {last}"


@dataclass(frozen=True)
class CaseView:
    """The results of a case: spans by engine and date, the time per engine, and the changes."""

    case: str
    spans: tuple[Span, ...]
    times: dict[str, Spread]
    changes: tuple[EngineChange, ...]

    @property
    def latest(self) -> dict[str, CaseOutcome]:
        """Return the last outcome on each engine."""
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
    """Compare runs, by date, with what ``every`` run shows of their engine until then, and of the engine before.

    A case is compared with its latest run on an engine, so that parts of a run add up. If nothing on the previous
    engine is older, all its runs are used: versions need not be run in their order.
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


# For every case, the id of its last outcome and the eos-ref that judged it.
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
    """Return the results of some cases over some runs; only of the fields of a pattern, if one is given.

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
    return CaseView(case, tuple(spans), times, tuple(_case_changes(case, ended)))


def _spans(
    label: str, here: Sequence[tuple[StoredRun, StoredCase]], outcomes: Mapping[int, CaseOutcome]
) -> Iterator[Span]:
    for outcome, group in itertools.groupby(here, key=lambda pair: pair[1].outcome):
        members = list(group)
        lammps = Spread.of([result.lammps for _, result in members])
        reference = Spread.of([result.reference for _, result in members])
        yield Span(label, members[0][0].date, members[-1][0].date, outcomes[outcome], lammps, reference)


def _case_changes(case: str, ended: Sequence[tuple[EngineRuns, StoredRun, CaseOutcome]]) -> Iterator[EngineChange]:
    first = ""
    for (line, run, was), (later, later_run, now) in itertools.pairwise(ended):
        for field, kind, before, after in differences(was, now):
            first = first or later.label
            judge = run.made_by != later_run.made_by
            yield EngineChange(case, field, kind, later.label, line.label, before, after, first == later.label, judge)


@dataclass(frozen=True)
class RunMark:
    """A mark: its column's label and secondary label, kind of verdict, difference/bound, its tooltip."""

    label: str
    under: str
    kind: str
    ratio: float | None
    says: str


@dataclass(frozen=True)
class Step:
    """The changes from one engine to the next: the cases of every kind of change, and all changes of every case."""

    engine: str
    before: str
    counts: dict[Part, int]
    cases: dict[str, list[EngineChange]]

    @property
    def ordered_counts(self) -> dict[Part, int]:
        """Return the counts, verdicts first."""
        return {kind: self.counts[kind] for kind in PARTS if kind in self.counts}


def steps(views: Sequence[CaseView]) -> list[Step]:
    """Collect the changes of some cases by the pair of engines."""
    by_engines: dict[tuple[str, str], Step] = {}
    for view in views:
        for change in view.changes:
            step = by_engines.setdefault((change.engine, change.before), Step(change.engine, change.before, {}, {}))
            of_case = step.cases.setdefault(change.case, [])
            if all(change.kind != other.kind for other in of_case):
                step.counts[change.kind] = step.counts.get(change.kind, 0) + 1
            of_case.append(change)
    return list(by_engines.values())


def changed_findings(changes: Sequence[EngineChange]) -> list[tuple[str, str]]:
    """List every pair of findings before and after, once."""
    return list(dict.fromkeys((change.was, change.now) for change in changes if change.kind == "finding"))


def spark(values: Sequence[float | None], logarithmic: bool = False) -> str:
    """Draw a line of bars, lowest to highest; ``·`` for a missing value, ``×`` for infinity and NaN."""
    scaled = [_scaled(value, logarithmic) for value in values]
    finite = [value for value in scaled if value is not None and math.isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=0.0)

    def bar(value: float | None) -> str:
        if value is None:
            return "·"
        if not math.isfinite(value):
            return "×"
        return _BARS[round((len(_BARS) - 1) * (value - low) / (high - low))] if high > low else _BARS[0]

    return "".join(map(bar, scaled))


def _scaled(value: float | None, logarithmic: bool) -> float | None:
    if value is None or not logarithmic or not math.isfinite(value):
        return value
    return max(FLOOR, math.log10(value)) if value > 0 else float(FLOOR)


def mark(label: str, day: str, when: str, outcome: CaseOutcome) -> RunMark:
    """Return the mark of an outcome on an engine; ``when`` is the full text about its runs."""
    field = f", worst in {outcome.worst_field}" if outcome.worst_field else ""
    return RunMark(label, day, outcome.kind, outcome.worst, f"{label}, {when}: {outcome.kind}{field}")


def points(view: CaseView) -> list[RunMark]:
    """Return a mark for every span of a case."""
    return [
        mark(span.label, span.since[:10], f"{span.days}, {counted(span.lammps.count, 'run')}", span.outcome)
        for span in view.spans
    ]
