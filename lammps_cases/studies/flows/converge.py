"""A flow at several resolutions, on the reference and on LAMMPS: errors, their order, and wall times of the steps."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from lammps_cases.engine.session import EngineBroken, EngineRefused, Session, kept
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.studies.flows.flow import Flow, Options, Snapshot, Start
from lammps_cases.studies.flows.stepping import FlowRun, LammpsFlow, ReferenceFlow

Engine = Literal["reference", "lammps"]
ENGINES: tuple[Engine, ...] = ("reference", "lammps")


@dataclass(frozen=True)
class FlowResult:
    """Outcome of a flow: snapshots, processor time of its steps, particles, steps taken.

    Of one that failed also the error, and whether particles were lost.
    """

    snapshots: tuple[Snapshot, ...]
    seconds: float
    n: int
    steps: int
    message: str = ""
    lost: bool = False


def by_reference(start: Start, evaluator: Callable[..., Any] | None = None) -> FlowResult:
    """Run a flow on the reference, by default on its compiled evaluator."""
    ReferenceFlow(start, evaluator).advance(1)  # compiles
    return _timed(start, lambda: ReferenceFlow(start, evaluator))


def by_lammps(start: Start, session: Session) -> FlowResult:
    """Run a flow on LAMMPS; an error of LAMMPS, or lost atoms, become the message.

    Raises
    ------
    EngineBroken
    """
    return _timed(start, lambda: LammpsFlow(start, session))


def _timed(start: Start, begin: Callable[[], FlowRun]) -> FlowResult:
    """Return the snapshots at the steps of a flow, with the processor time of the steps alone: of one core."""
    snapshots, seconds, done, message, lost = [], 0.0, 0, "", False
    run = None
    try:
        run = begin()
        for step in start.steps:
            before = time.process_time()
            if step > done:
                run.advance(step - done)
            seconds += time.process_time() - before
            snapshots.append(run.snapshot())
            done = step
    except EngineBroken:
        raise
    except EngineRefused as error:
        message, lost = " ".join(str(error).split()), isinstance(run, LammpsFlow) and bool(run.lost().size)
    return FlowResult(tuple(snapshots), seconds, len(start.atoms), done, message, lost)


def solve(site: str | None, start: Start) -> FlowResult:
    """Run a flow on the LAMMPS of a worker process."""
    return by_lammps(start, kept(site))


def in_worker(start: Start, workers: Workers, time_limit: float = 600.0) -> FlowResult:
    """Run a flow on LAMMPS in a process of its own, whose death becomes the message."""
    outcome = workers.outcome(workers.call(solve, start, time_limit=time_limit))
    return FlowResult((), np.nan, len(start.atoms), 0, outcome.message) if isinstance(outcome, Failure) else outcome


@dataclass(frozen=True)
class Fit:
    """Order of convergence, minus the slope of log error over log resolution by least squares; its standard error."""

    order: float
    standard_error: float


def fit(resolutions: Sequence[int], errors: Sequence[float]) -> Fit:
    """Fit the order of finite errors other than 0; NaN for fewer than two, no standard error for fewer than three."""
    x, y = np.log(np.array(resolutions, float)), np.array(errors, float)
    usable = np.isfinite(y) & (y > 0)
    x, y = x[usable], np.log(y[usable])
    if len(x) < 3:
        return Fit(-float(np.diff(y)[0] / np.diff(x)[0]) if len(x) == 2 else np.nan, np.nan)
    # scipy's linregress takes the error from 1 - r^2, which leaves half the digits of a fit that is nearly exact.
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    return Fit(-float(slope), float(np.sqrt(covariance[0, 0])))


@dataclass(frozen=True)
class Convergence:
    """Errors of one flow on one engine, by measure and resolution; NaN, with a message, where the engine failed."""

    flow: str
    engine: str
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
    others: Mapping[str, Callable[[int, Start], FlowResult]] = MappingProxyType({}),
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
    others : mapping, optional
        Further codes by name: what solves a flow at a resolution.
    """
    chosen, options = tuple(resolutions) or flow.resolutions, options or flow.options
    results: dict[str, list[FlowResult]] = {name: [] for name in (*engines, *others)}
    with Workers(site, 1) if "lammps" in engines else contextlib.nullcontext() as workers:
        for n in chosen:
            start = flow.start(n, options)
            rounds = [
                [
                    *(
                        in_worker(start, workers) if workers and name == "lammps" else by_reference(start)
                        for name in engines
                    ),
                    *(by_other(n, start) for by_other in others.values()),
                ]
                for _ in range(repeats)
            ]
            for name, runs in zip(results, zip(*rounds, strict=True), strict=True):
                results[name].append(replace(runs[0], seconds=median(run.seconds for run in runs)))
    return tuple(_convergence(flow, options, name, chosen, runs) for name, runs in results.items())


def _convergence(
    flow: Flow, options: Options, name: str, resolutions: tuple[int, ...], runs: Sequence[FlowResult]
) -> Convergence:
    errors_by_n = [
        {} if run.message else flow.measures(n, options, run.snapshots)
        for n, run in zip(resolutions, runs, strict=True)
    ]
    measures = next((list(errors) for errors in errors_by_n if errors), [])
    return Convergence(
        flow.name,
        name,
        options,
        resolutions,
        {measure: tuple(errors.get(measure, np.nan) for errors in errors_by_n) for measure in measures},
        tuple(run.seconds for run in runs),
        tuple(run.n for run in runs),
        tuple(run.steps for run in runs),
        {n: run.message for n, run in zip(resolutions, runs, strict=True) if run.message},
    )
