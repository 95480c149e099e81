"""A flow at several resolutions, on the reference and on LAMMPS: errors, their order, and wall times of the steps."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any, Literal

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.engine.session import EngineBroken, EngineRefused
from lammps_cases.engine.stepping import instance
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.studies.flows.flow import Flow, Options, Snapshot, Start
from lammps_cases.studies.flows.stepping import FlowRun, LammpsFlow, ReferenceFlow

Engine = Literal["reference", "lammps"]
ENGINES: tuple[Engine, ...] = ("reference", "lammps")


@dataclass(frozen=True)
class FlowResult:
    """What came of a flow: snapshots, wall time of the steps alone, particles, steps; a message where it failed."""

    snapshots: tuple[Snapshot, ...]
    seconds: float
    n: int
    steps: int
    message: str = ""


def by_reference(start: Start, evaluator: Literal["fast", "plain"] = "fast", threads: int = 1) -> FlowResult:
    """Run a flow on the reference.

    Parameters
    ----------
    evaluator : {"fast", "plain"}
        Compiled, or in plain arrays.
    threads : int
        Of the compiled evaluator.
    """
    from eos_ref.compiled.evaluator import CompiledEvaluator

    make: Callable[..., Any] = ArrayEvaluator if evaluator == "plain" else CompiledEvaluator
    if threads != 1:
        make = functools.partial(make, threads=threads)
    ReferenceFlow(start, make).advance(1)  # compiles
    return _timed(start, lambda: ReferenceFlow(start, make))


def by_lammps(start: Start, lmp: Any) -> FlowResult:
    """Run a flow on a LAMMPS instance; what LAMMPS refuses or loses becomes the message.

    Raises
    ------
    EngineBroken
        After an error of which the instance must not be used again.
    """
    return _timed(start, lambda: LammpsFlow(start, lmp))


def _timed(start: Start, begin: Callable[[], FlowRun]) -> FlowResult:
    """Snapshots at the steps of a flow, with the wall time of the steps alone."""
    snapshots, seconds, done, message = [], 0.0, 0, ""
    try:
        run = begin()
        for step in start.steps:
            before = time.perf_counter()
            if step > done:
                run.advance(step - done)
            seconds += time.perf_counter() - before
            snapshots.append(run.snapshot())
            done = step
    except EngineBroken:
        raise
    except EngineRefused as error:
        message = " ".join(str(error).split())
    return FlowResult(tuple(snapshots), seconds, len(start.atoms), done, message)


def solve(site: str | None, start: Start) -> FlowResult:
    """Task of a worker: run a flow on its LAMMPS."""
    with instance(site).use() as lmp:
        return by_lammps(start, lmp)


def in_worker(start: Start, workers: Workers, time_limit: float = 600.0) -> FlowResult:
    """Run a flow on LAMMPS in a process of its own, whose death becomes the message."""
    outcome = workers.outcome(workers.call(solve, start, time_limit=time_limit), time_limit)
    if isinstance(outcome, Failure):
        return FlowResult((), float("nan"), len(start.atoms), 0, outcome.message)
    return outcome


@dataclass(frozen=True)
class Fit:
    """Order of convergence, minus the slope of log error over log resolution by least squares; its standard error."""

    order: float
    standard_error: float


def fit(resolutions: Sequence[int], errors: Sequence[float]) -> Fit:
    """Fit the order of finite errors other than 0; NaN for fewer than two, no standard error for fewer than three."""
    x, y = np.log(np.array(resolutions, float)), np.array(errors, float)
    good = np.isfinite(y) & (y > 0)
    x, y = x[good], np.log(y[good])
    if len(x) < 2:
        return Fit(float("nan"), float("nan"))
    if len(x) == 2:
        return Fit(-float(np.diff(y)[0] / np.diff(x)[0]), float("nan"))
    # scipy's linregress takes the error from 1 - r^2, which leaves half the digits of a fit that is nearly exact.
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    return Fit(-float(slope), float(np.sqrt(covariance[0, 0])))


@dataclass(frozen=True)
class Convergence:
    """Errors of one flow on one engine, by measure and resolution (NaN where it gave no answer, with a message)."""

    flow: str
    engine: Engine
    options: Options
    resolutions: tuple[int, ...]
    errors: Mapping[str, tuple[float, ...]]
    seconds: tuple[float, ...]
    particles: tuple[int, ...]
    steps: tuple[int, ...]
    messages: Mapping[int, str]

    def fit(self, measure: str) -> Fit:
        """Return the order of a measure."""
        return fit(self.resolutions, self.errors[measure])


def converge(
    flow: Flow,
    options: Options | None = None,
    engines: Sequence[Engine] = ENGINES,
    resolutions: Sequence[int] = (),
    repeats: int = 1,
    site: str | None = None,
) -> tuple[Convergence, ...]:
    """Run a flow at several resolutions, the engines in turns.

    Parameters
    ----------
    options : Options, optional
        The flow's own by default.
    engines : sequence of {"reference", "lammps"}
    resolutions : sequence of int, optional
        The flow's own by default.
    repeats : int
        Times that every run is timed, in turns; the median counts.
    site : str, optional
        Folder of another LAMMPS, see `lammps_cases.engine.installations`.
    """
    chosen, given = tuple(resolutions) or flow.resolutions, options or flow.options
    results: dict[Engine, list[FlowResult]] = {name: [] for name in engines}
    with contextlib.ExitStack() as stack:
        run = {name: _runner(name, site, stack) for name in engines}
        for n in chosen:
            start = flow.start(n, given)
            runs: dict[Engine, list[FlowResult]] = {name: [] for name in engines}
            for _ in range(repeats):
                for name in engines:
                    runs[name].append(run[name](start))
            for name, timed in runs.items():
                results[name].append(replace(timed[0], seconds=median(result.seconds for result in timed)))
    return tuple(_judged(flow, given, name, chosen, timed) for name, timed in results.items())


def _runner(name: Engine, site: str | None, stack: contextlib.ExitStack) -> Callable[[Start], FlowResult]:
    if name == "reference":
        return by_reference
    workers = stack.enter_context(Workers(site, 1))
    return lambda start: in_worker(start, workers)


def _judged(
    flow: Flow, options: Options, name: Engine, resolutions: tuple[int, ...], results: list[FlowResult]
) -> Convergence:
    measured = [
        {} if result.message else flow.measures(n, options, result.snapshots)
        for n, result in zip(resolutions, results, strict=True)
    ]
    names = next((list(errors) for errors in measured if errors), [])
    return Convergence(
        flow.name,
        name,
        options,
        resolutions,
        {measure: tuple(errors.get(measure, float("nan")) for errors in measured) for measure in names},
        tuple(result.seconds for result in results),
        tuple(result.n for result in results),
        tuple(result.steps for result in results),
        {n: result.message for n, result in zip(resolutions, results, strict=True) if result.message},
    )
