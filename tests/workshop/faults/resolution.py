"""Resolution: the smallest change of every parameter that turns a case red.

Real LAMMPS is given another value; its answer is judged, as always, against the unchanged scene. Every number of every
case is tried once; the change of LAMMPS' fields, in units of their bounds, predicts where the cases turn red.
The best few are then bisected by the ordinary verdict. Twins are left out: both of their runs get the same input.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from lammps_cases.comparison.store import Store
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.workers import Failure
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene.casefile import Case
from tests.workshop.faults.perturbed import JudgingWorkers, PerturbedJudge, RepeatedCase
from tests.workshop.faults.scene_numbers import SceneNumber, numbers

PROBES = (1e-6, 1e-3, 0.1)  # relative changes tried, until one is detected
WHOLE = (1, 2, 3, 4, 6, 8, 12, 16)  # changes of a count
FLOOR = 2.0**-53  # a smaller relative change is no change
LARGEST = 1.0  # largest relative change tried
CLOSE = 1.1  # factor between detected and undetected changes at which a bisection ends
BEST = 3  # cases bisected per parameter, of all and of the quick ones

R = TypeVar("R")


@dataclass(frozen=True)
class VisibleChange:
    """The smallest change of a number that a case detects.

    Attributes
    ----------
    value : the number as the scene has it
    change : added to it
    relative_change : size of the change over that of the number
    unseen : largest relative change below it that was tried and not detected; 0: one unit of the last place is detected
    field : the field that leaves its bound by most
    """

    case: str
    place: str
    value: float
    change: float
    relative_change: float
    unseen: float
    field: str


@dataclass(frozen=True)
class Resolution:
    """How finely changes of a parameter are detected.

    Attributes
    ----------
    case, relative_change : of the best; empty and None if no case detects it
    candidates : cases that have the parameter
    sensitive : of these, how many detect a change by a tenth or less
    best, quick : of all cases, of the quick ones; None: undetected
    note : what kind of change it is
    """

    parameter: str
    case: str
    relative_change: float | None
    candidates: int
    sensitive: int
    best: VisibleChange | None
    quick: VisibleChange | None
    note: str = ""


@dataclass(frozen=True)
class Sensitivity:
    """Estimate of the relative change of a number that a case detects; infinite: none."""

    parameter: str
    place: str
    estimate: float
    whole: bool
    decides: bool


# --- in a worker


def probes(
    site: str | None, judge: PerturbedJudge, ready: PreparedCase, parameters: Sequence[str]
) -> list[Sensitivity]:
    """Task: try every number of a case once, of some parameters or of all."""
    wanted = [n for n in numbers(ready) if not parameters or n.parameter in parameters]
    case = RepeatedCase(site, judge, ready) if wanted else None
    return [Sensitivity(n.parameter, n.place, _estimate(case, n), n.whole, n.decides) for n in wanted if case]


def _estimate(case: RepeatedCase, number: SceneNumber) -> float:
    """Estimate where a case turns red; a field without rounding leaves its bound of 0 at once or not (one ulp)."""

    def largest(change: float, but: float = math.nan) -> float:
        ratios = case.moved(number.job_with(number.value + change))
        return max((ratio for ratio in ratios.values() if ratio != but), default=0.0)

    if number.whole:
        steps = [sign * k for k in WHOLE for sign in (1, -1) if number.value + sign * k >= 0]
        return abs(next((k for k in steps if largest(k) > 1), math.inf)) / abs(number.value)
    for size, sign in itertools.product(PROBES, (1, -1) if number.decides else (1,)):
        ratio = largest(sign * size * number.value)
        if ratio == math.inf and not number.decides:
            if largest(math.ulp(number.value)) > 1:
                return FLOOR
            ratio = max(largest(size * number.value, but=math.inf), 1.0)
        if ratio > 1:
            return size if number.decides else max(size / ratio, FLOOR)
    return math.inf


def smallest(
    site: str | None, judge: PerturbedJudge, ready: PreparedCase, places: Sequence[Sensitivity]
) -> list[tuple[str, VisibleChange]]:
    """Task: return the smallest detected changes of some numbers of a case, up or down."""
    case, by_place = RepeatedCase(site, judge, ready), {(n.parameter, n.place): n for n in numbers(ready)}
    pairs = []
    for probe in places:
        number = by_place[probe.parameter, probe.place]
        both = [smallest_change(case, number, sign, probe.estimate) for sign in (1, -1)]
        if changes := [change for change in both if change]:
            pairs.append((probe.parameter, min(changes, key=lambda change: change.relative_change)))
    return pairs


def smallest_change(case: RepeatedCase, number: SceneNumber, sign: int, estimate: float) -> VisibleChange | None:
    """Return the smallest detected change of a number, up or down; None: no change is detected."""

    def altered(size: float) -> float:
        return number.value + sign * size if number.whole else number.value * (1 + sign * size)

    def sees(size: float) -> bool:
        return altered(size) != number.value and case.detects(number.job_with(altered(size)))

    if number.whole:
        steps = [k for k in WHOLE if altered(k) >= 0]
        seen = next((k for k in steps if sees(k)), None)
        found = None if seen is None else (float(seen), float(max((k for k in steps if k < seen), default=0)))
    else:
        found = _bracket(sees, min(max(1.5 * estimate, 2 * FLOOR), LARGEST))
    if found is None:
        return None
    visible, invisible = found
    while visible > CLOSE * invisible and not number.whole:
        middle = math.sqrt(visible * max(invisible, FLOOR))
        if altered(middle) in (altered(visible), altered(invisible)):
            break
        visible, invisible = (middle, invisible) if sees(middle) else (visible, middle)
    change, value = altered(visible) - number.value, abs(number.value)
    ratios = case.moved(number.job_with(number.value + change))
    leaving = max(ratios, key=lambda name: ratios[name], default="no numbers")
    below = abs(altered(invisible) - number.value) / value
    return VisibleChange(case.ready.case.name, number.place, number.value, change, abs(change) / value, below, leaving)


def _bracket(sees: Callable[[float], bool], start: float) -> tuple[float, float] | None:
    """Return a detected change and a smaller undetected one, from a first guess; None: no change is detected."""
    visible, invisible = start, 0.0
    while not sees(visible):
        if visible >= LARGEST:
            return None
        visible, invisible = min(4 * visible, LARGEST), visible
    while not invisible and visible > FLOOR:
        size = max(visible / 4, FLOOR)
        if not sees(size):
            return visible, size if size > FLOOR else 0.0
        visible = size
    return visible, invisible


# --- in the parent


def measure(
    cases: Sequence[Case],
    engine: Engine,
    parameters: Sequence[str] = (),
    jobs: int = 2,
    store: Store | None = None,
    progress: Progress = SILENT,
) -> list[Resolution]:
    """Return the resolution of all parameters that some cases have, or of those named, sorted by name.

    Raises
    ------
    EngineMissing
    """
    quick = {case.name for case in cases if "quick" in case.tags}
    with JudgingWorkers(engine, jobs, store) as workers:
        usable = [case.by(workers.judge.engine.manual) for case in cases if not (case.scene.expect or case.scene.twin)]
        ready = {case.name: prepare(case) for case in usable}

        def results(task: Callable[..., list[R]], given: Mapping[str, Sequence[Any]]) -> dict[str, list[R]]:
            lists: dict[str, list[R]] = {}
            futures = {name: workers.judging(task, ready[name], of) for name, of in given.items()}
            for name, future in futures.items():
                outcome = workers.outcome(future)
                lists[name] = [] if isinstance(outcome, Failure) else outcome
                progress.advance(len(lists), len(futures), f"resolution, {task.__name__}: {name}")
            return lists

        tried = results(probes, dict.fromkeys(ready, tuple(parameters)))
        pairs = [pair for of in results(smallest, _chosen(tried, quick, ready)).values() for pair in of]
    return [resolution_of(parameter, tried, pairs, quick) for parameter in _parameters(tried)]


def _parameters(tried: dict[str, list[Sensitivity]]) -> list[str]:
    return sorted({probe.parameter for places in tried.values() for probe in places})


def _of(parameter: str, tried: dict[str, list[Sensitivity]]) -> dict[str, Sensitivity]:
    """Return the most promising number of a parameter in every case that has it."""
    best = {}
    for name, places in tried.items():
        of = [probe for probe in places if probe.parameter == parameter]
        if of:
            best[name] = min(of, key=lambda probe: probe.estimate)
    return best


def _chosen(
    tried: dict[str, list[Sensitivity]], quick: set[str], ready: dict[str, PreparedCase]
) -> dict[str, list[Sensitivity]]:
    """Return the most promising cases of every parameter, smaller ones first among equals."""
    chosen: dict[str, list[Sensitivity]] = {}
    for parameter in _parameters(tried):
        of = {name: probe for name, probe in _of(parameter, tried).items() if math.isfinite(probe.estimate)}
        names = sorted(of, key=lambda name: (of[name].estimate, len(ready[name].atoms), name))
        for name in dict.fromkeys((*names[:BEST], *[n for n in names if n in quick][:BEST])):
            chosen.setdefault(name, []).append(of[name])
    return chosen


def resolution_of(
    parameter: str, tried: dict[str, list[Sensitivity]], pairs: Sequence[tuple[str, VisibleChange]], quick: set[str]
) -> Resolution:
    """Return the resolution of a parameter, from the probes and the smallest changes of all cases."""
    of = _of(parameter, tried)
    changes = sorted((c for p, c in pairs if p == parameter), key=lambda c: (c.relative_change, c.case))
    best = changes[0] if changes else None
    return Resolution(
        parameter,
        best.case if best else "",
        best.relative_change if best else None,
        candidates=len(of),
        sensitive=sum(math.isfinite(probe.estimate) for probe in of.values()),
        best=best,
        quick=next((c for c in changes if c.case in quick), None),
        note=_note(best, next(iter(of.values()))),
    )


def _note(best: VisibleChange | None, probe: Sensitivity) -> str:
    if best is None:
        return "no case sees it"
    if probe.whole:
        return f"a whole number, seen at {best.change:+.0f}"
    if best.unseen == 0:
        return "one unit of the last place"
    return "decides classes: larger changes may go unseen until one changes" if probe.decides else ""
