"""A flow at several resolutions, on the reference and on LAMMPS: errors, their order, and wall times of the steps."""

from __future__ import annotations

import contextlib
import functools
import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any, Literal

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import Plain
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import State
from lammps_cases.engine import session
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.flows.flow import Flow, Options, Snapshot, Start

Engine = Literal["reference", "lammps"]
ENGINES: tuple[Engine, ...] = ("reference", "lammps")


@dataclass(frozen=True)
class Result:
    """What came of a flow: snapshots, wall time of the steps alone, particles, steps; a message where it failed."""

    snapshots: tuple[Snapshot, ...]
    seconds: float
    n: int
    steps: int
    message: str = ""


def _snapshot(start: Start, step: int, fields: Mapping[str, Any]) -> Snapshot:
    """A snapshot of two-dimensional or three-dimensional arrays by LAMMPS' names."""
    d, energy_n = start.case.scene.dimension, fields.get("energy")
    heat_n = _heat_capacity(start)
    return Snapshot(
        step * start.timestep,
        np.array(fields["x"][:, :d]),
        np.array(fields["v"][:, :d]),
        np.array(fields["rho"]),
        None if energy_n is None else np.array(energy_n),
        np.array(fields["pressure"]),
        None if energy_n is None else energy_n / heat_n,
    )


def _heat_capacity(start: Start) -> FloatArray:
    """Mass times specific heat."""
    specific: FloatArray = np.array([t.specific_heat for t in start.case.scene.types])[start.atoms.type_n - 1]
    return specific * start.atoms.mass_n


def by_reference(start: Start, evaluator: Literal["fast", "plain"] = "fast", threads: int = 1) -> Result:
    """Run a flow on the reference.

    Parameters
    ----------
    evaluator : {"fast", "plain"}
        Compiled, or in plain arrays.
    threads : int
        Of the compiled evaluator.
    """
    from eos_ref.compiled.evaluator import Fast

    scene, atoms, where = start.case.scene, start.atoms, start.case.where
    model, box = reference_side.model(scene, atoms, where), reference_side.box(scene, atoms)
    state = reference_side.state(scene, atoms, where)
    make: Any = Plain if evaluator == "plain" else Fast
    if threads != 1:
        make = functools.partial(make, threads=threads)
    Simulation(model, box, state, (), make).run(1, start.timestep)  # compiles
    simulation = Simulation(model, box, state, (), make)
    simulation.run(0, start.timestep)
    snapshots, seconds, done = [], 0.0, 0
    for step in start.steps:
        begin = time.perf_counter()
        simulation.run(step - done, start.timestep)
        seconds += time.perf_counter() - begin
        snapshots.append(_snapshot(start, step, _outputs(simulation)))
        done = step
    return Result(tuple(snapshots), seconds, len(atoms), done)


def _outputs(simulation: Simulation) -> dict[str, Any]:
    state: State = simulation.state
    names = ("x", "v", "rho", "pressure", *(["energy"] if state.energy_n is not None else []))
    return {name: simulation.output(name) for name in names}


def by_lammps(start: Start, lmp: Any) -> Result:
    """Run a flow on a living LAMMPS; what LAMMPS refuses or loses becomes the message.

    Raises
    ------
    EngineBroken
        After an error of which the instance must not be used again.
    """
    scene, atoms = start.case.scene, start.atoms
    told = job(scene, atoms, plan(scene))
    snapshots, seconds, done = [], 0.0, 0
    try:
        session.run(lmp, replace(told, runs=(session.Run("run 0 post no"),)))
        for step in start.steps:
            begin = time.perf_counter()
            if step > done:
                lmp.command(f"run {step - done} pre no post no")
            seconds += time.perf_counter() - begin
            snapshots.append(_snapshot(start, step, _read(lmp, told, start)))
            done = step
    except Exception as error:
        if type(error).__name__ == "MPIAbortException":
            raise session.EngineBroken(str(error).strip()) from None
        # LAMMPS' own message has no type of its own; any other is not LAMMPS'.
        if type(error) not in (Exception, session.EngineRefused):
            raise
        return Result(tuple(snapshots), seconds, len(atoms), done, " ".join(str(error).split()))
    return Result(tuple(snapshots), seconds, len(atoms), done)


def _read(lmp: Any, told: session.Job, start: Start) -> dict[str, Any]:
    """Arrays of LAMMPS by the names of the reference.

    Raises
    ------
    EngineRefused
        Atoms were lost, or a position or velocity is no number.
    """
    arrays = session.read(lmp, told.outputs, told.atom_arrays)
    wrong = np.setxor1d(arrays["id"], start.atoms.id_n)
    if wrong.size:
        raise session.EngineRefused(f"LAMMPS lost {wrong.size} of {len(start.atoms)} atoms, first id {wrong[0]}")
    if not (np.isfinite(arrays["x"]).all() and np.isfinite(arrays["v"]).all()):
        raise session.EngineRefused("a position or velocity of LAMMPS is no finite number")
    return arrays | {"pressure": arrays["q.pressure"]} | ({"energy": arrays["esph"]} if "esph" in arrays else {})


@functools.cache
def _living(site: str | None) -> Any:
    return session.open_lammps(site)


def solve(site: str | None, start: Start) -> Result:
    """Task of a worker: run a flow on its LAMMPS."""
    try:
        return by_lammps(start, _living(site))
    except session.EngineBroken:
        _living.cache_clear()
        raise


def in_worker(start: Start, workers: Workers, time_limit: float = 600.0) -> Result:
    """Run a flow on LAMMPS in a process of its own, whose death becomes the message."""
    outcome = workers.outcome(workers.call(solve, start, time_limit=time_limit), time_limit)
    if isinstance(outcome, Failure):
        return Result((), float("nan"), len(start.atoms), 0, outcome.message)
    return outcome


@dataclass(frozen=True)
class Fit:
    """Order of convergence, minus the slope of log error over log resolution by least squares; its standard error."""

    order: float
    standard_error: float


def fit(resolutions: Sequence[int], errors: Sequence[float]) -> Fit:
    """Order of the errors that are finite and not 0; NaN for fewer than two, no standard error for fewer than three."""
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
        """Order of a measure."""
        return fit(self.resolutions, self.errors[measure])

    def local(self, measure: str) -> tuple[float, ...]:
        """Order between each resolution and the next."""
        points = zip(self.resolutions, self.errors[measure], strict=True)
        return tuple(fit((n, m), (a, b)).order for (n, a), (m, b) in itertools.pairwise(points))


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
    results: dict[Engine, list[Result]] = {name: [] for name in engines}
    with contextlib.ExitStack() as stack:
        run = {name: _runner(name, site, stack) for name in engines}
        for n in chosen:
            start = flow.start(n, given)
            runs: dict[Engine, list[Result]] = {name: [] for name in engines}
            for _ in range(repeats):
                for name in engines:
                    runs[name].append(run[name](start))
            for name, found in runs.items():
                results[name].append(replace(found[0], seconds=median(result.seconds for result in found)))
    return tuple(_judged(flow, given, name, chosen, found) for name, found in results.items())


def _runner(name: Engine, site: str | None, stack: contextlib.ExitStack) -> Callable[[Start], Result]:
    if name == "reference":
        return by_reference
    workers = stack.enter_context(Workers(site, 1))
    return lambda start: in_worker(start, workers)


def _judged(
    flow: Flow, options: Options, name: Engine, resolutions: tuple[int, ...], found: list[Result]
) -> Convergence:
    measured = [
        {} if result.message else flow.measures(n, options, result.snapshots)
        for n, result in zip(resolutions, found, strict=True)
    ]
    names = next((list(errors) for errors in measured if errors), [])
    return Convergence(
        flow.name,
        name,
        options,
        resolutions,
        {measure: tuple(errors.get(measure, float("nan")) for errors in measured) for measure in names},
        tuple(result.seconds for result in found),
        tuple(result.n for result in found),
        tuple(result.steps for result in found),
        {n: result.message for n, result in zip(resolutions, found, strict=True) if result.message},
    )
