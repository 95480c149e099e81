"""One cell of a map on one engine: run in stretches, looked at after each, the failing stretch again step by step."""

from __future__ import annotations

import contextlib
import os
import pickle
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.engine.stepping import instance
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.scene.atoms import IntArray
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability import kinds
from lammps_cases.studies.stability.kinds import Observation, ParticleFailure, Subject
from lammps_cases.studies.stability.model import CellOutcome, Engine, FailureCriteria, Kind, MapCell, StabilityMap
from lammps_cases.studies.stability.runs import ObservedRun, ReferenceRun, Stopped, open_run

LIMIT = 30.0  # seconds that a cell may take
Note = Callable[[Observation], None]
ARRAYS = {"x": "x_nc", "v": "v_nc", "rho": "rho_n", "pressure": "pressure_n", "id": "id_n", "type": "type_n"}
ARRAYS |= {"low": "low_c", "high": "high_c"}


@dataclass(frozen=True)
class Before:
    """Particles of a run before it failed, by id, and the ids that fail; none where no particle can be named."""

    step: int
    x_nc: FloatArray
    v_nc: FloatArray
    rho_n: FloatArray
    pressure_n: FloatArray
    id_n: IntArray
    type_n: IntArray
    low_c: FloatArray
    high_c: FloatArray
    failing: tuple[int, ...]

    def arrays(self) -> dict[str, object]:
        """Return all of it as arrays by short names: step, x, v, rho, pressure, id, type, low, high, failing."""
        arrays = {name: getattr(self, attribute) for name, attribute in ARRAYS.items()}
        return {**arrays, "step": np.array(self.step), "failing": np.array(self.failing, int)}


@dataclass(frozen=True)
class Examined:
    """What came of a cell; ``before`` is None for a stable run, and for a law alone."""

    outcome: CellOutcome
    before: Before | None = None


# --- following a run


def follow(
    run: ObservedRun, of: Subject, watch: FailureCriteria, steps: int, note: Note = lambda look: None, single: int = 0
) -> Examined:
    """Look at a run until its first failure.

    Parameters
    ----------
    run : Run
    of : Subject
    watch : Watch
    steps : int
        How many are taken at most.
    note : callable
        Told every look that is sound, before the run goes on.
    single : int
        From this step on every step is looked at.
    """
    try:
        run.begin()
        last = run.look()
    except Stopped as stop:
        return Examined(CellOutcome(stop.kind, 0, stop.atom, message=stop.message))
    energy = watch.energy
    failure = kinds.first(of, watch, last, energy)
    if failure is not None:
        return _failed(of, failure, 0, last)
    at_rest = kinds.kinetic_energy(of.mass_n, last.v_nc)
    while last.step < steps:
        note(last)
        stretch = 1 if single and last.step >= single else min(watch.every, steps - last.step)
        if single and last.step < single:
            stretch = min(stretch, single - last.step)
        look, failure, message = _advance(run, of, watch, stretch, energy)
        if failure is not None:
            if stretch == 1:
                return _failed(of, failure, last.step + 1, last, message)
            return _step_by_step(run, of, watch, stretch, energy, last, (failure, message), note)
        assert look is not None
        if energy is None:
            energy = max(at_rest, kinds.kinetic_energy(of.mass_n, look.v_nc))
        last = look
    return Examined(CellOutcome("stable"))


def _advance(
    run: ObservedRun, of: Subject, watch: FailureCriteria, steps: int, energy: float | None
) -> tuple[Observation | None, ParticleFailure | None, str]:
    """Take steps: the look after them, what is wrong with it, and what the engine said."""
    try:
        run.advance(steps)
        look = run.look()
    except Stopped as stop:
        return None, _failure_of_stopped(run, of, watch, energy) or ParticleFailure(stop.kind, stop.atom), stop.message
    return look, kinds.first(of, watch, look, energy), ""


def _failure_of_stopped(
    run: ObservedRun, of: Subject, watch: FailureCriteria, energy: float | None
) -> ParticleFailure | None:
    """Return the failure of a reference that stopped in the middle of a step: its particles can still be observed."""
    if not isinstance(run, ReferenceRun):
        return None
    failure = kinds.first(of, replace(watch, surface={}, condition=None, closest=None), run.look(), energy)
    return failure if failure is not None and failure.kind in ("non-finite", "lost particles") else None


def _step_by_step(
    run: ObservedRun,
    of: Subject,
    watch: FailureCriteria,
    stretch: int,
    energy: float | None,
    last: Observation,
    first_failure: tuple[ParticleFailure, str],
    note: Note,
) -> Examined:
    """Run the failing stretch again, one step at a time."""
    end, (first, first_message) = last.step + stretch, first_failure
    try:
        run.back()
    except Stopped as stop:
        # What nobody wrote (a finding) makes LAMMPS end otherwise the second time.
        return _failed(of, first, end, last, f"{first_message} (run again, it ended earlier: {stop.message})".strip())
    while last.step < end:
        look, failure, message = _advance(run, of, watch, 1, energy)
        if failure is not None:
            return _failed(of, failure, last.step + 1, last, message)
        assert look is not None
        last = look
        note(last)
    return _failed(of, first, end, last, f"{first_message} (not seen when every step was looked at)".strip())


def _failed(of: Subject, failure: ParticleFailure, step: int, before: Observation, message: str = "") -> Examined:
    outcome = CellOutcome(failure.kind, step, failure.atom, failure.value, message)
    return Examined(outcome, _before(of, before, failure.atom) if of.moves else None)


def _before(of: Subject, look: Observation, atom: int | None) -> Before:
    x_nc = kinds.wrapped(of.box, look.x_nc[:, : len(of.box.low_c)])
    ends = np.array(of.box.low_c), np.array(of.box.high_c)
    failing = () if atom is None else (atom,)
    return Before(look.step, x_nc, look.v_nc, look.rho_n, look.pressure_n, of.id_n, of.type_n, *ends, failing)


# --- inside a worker


def run_cell(
    site: str | None, start: Start, watch: FailureCriteria, side: Engine, trace: str, single: int = 0
) -> Examined:
    """Task of a worker: examine one cell; the last sound look is kept in the file ``trace``, should the worker die."""
    of, begin = kinds.subject(start), time.perf_counter()

    def note(look: Observation) -> None:
        partly = Path(f"{trace}.new")
        partly.write_bytes(pickle.dumps((look, time.perf_counter() - begin)))
        partly.replace(trace)

    steps = start.steps[-1] if of.moves else 0
    examined = follow(open_run(start, watch, side, instance(site)), of, watch, steps, note, single)
    seconds = time.perf_counter() - begin
    return replace(examined, outcome=replace(examined.outcome, seconds=seconds, steps=start.steps[-1]))


# --- in the parent


@dataclass(frozen=True)
class PendingCell:
    """A cell that a worker examines."""

    start: Start
    watch: FailureCriteria
    side: Engine
    trace: Path
    future: Future[Examined]


def ask(
    of: StabilityMap, cell: MapCell, side: Engine, workers: Workers, folder: Path, limit: float = LIMIT
) -> PendingCell:
    """Queue a cell; ``folder`` is for traces of workers that die."""
    start, watch = of.start(cell), of.watch(cell)
    handle, name = tempfile.mkstemp(dir=folder, prefix="trace-")
    os.close(handle)
    future = workers.call(run_cell, start, watch, side, name, time_limit=limit)
    return PendingCell(start, watch, side, Path(name), future)


def settle(pending: PendingCell, workers: Workers, limit: float = LIMIT) -> Examined:
    """Wait for a cell.

    A worker that dies becomes a `crash`, after the last sound look; it is sent through the last stretch again, step by
    step, to find the step. One that does not end becomes a `hang`.

    Raises
    ------
    RuntimeError
        A mistake of this project's own.
    """
    try:
        outcome = workers.outcome(pending.future, limit)
        if not isinstance(outcome, Failure):
            return outcome
        message = _failure_message(pending.side, outcome)
        if outcome.verdict not in ("timeout", "crashed"):
            raise RuntimeError(f"{pending.start.case.name} on {pending.side}: {message}")
        if outcome.verdict == "timeout":
            return _died(pending, "hang", message, limit)
        return _crashed(pending, message, workers, limit)
    finally:
        pending.trace.unlink(missing_ok=True)


def _failure_message(side: Engine, failure: Failure) -> str:
    """Return the message of a worker's failure, which speaks of LAMMPS whatever the worker ran."""
    return failure.message if side == "lammps" else failure.message.replace("LAMMPS", "the reference")


def _crashed(pending: PendingCell, message: str, workers: Workers, limit: float) -> Examined:
    last = _last_observation(pending.trace)
    if last is not None and pending.watch.every > 1:
        arguments = pending.start, pending.watch, pending.side, str(pending.trace), max(last[0].step, 1)
        again = workers.outcome(workers.call(run_cell, *arguments, time_limit=limit), limit)
        if not isinstance(again, Failure) and again.outcome.kind != "stable":
            return again  # a failure came before the crash
        message = (
            _failure_message(pending.side, again) if isinstance(again, Failure) else f"{message} (once in two runs)"
        )
    return _died(pending, "crash", message, 0.0)


def _died(pending: PendingCell, kind: Kind, message: str, seconds: float) -> Examined:
    steps, last, of = pending.start.steps[-1], _last_observation(pending.trace), kinds.subject(pending.start)
    if last is None:
        return Examined(CellOutcome(kind, 0, message=message, seconds=seconds, steps=steps))
    look, spent = last
    outcome = CellOutcome(kind, look.step + 1, message=message, seconds=seconds or spent, steps=steps)
    return Examined(outcome, _before(of, look, None) if of.moves else None)


def _last_observation(trace: Path) -> tuple[Observation, float] | None:
    """Return the last observation of a worker that died: a file that this process made."""
    content = trace.read_bytes() if trace.exists() else b""
    return pickle.loads(content) if content else None


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """Make a folder for traces, and remove it."""
    with tempfile.TemporaryDirectory(prefix="eos-ref-stability-") as folder:
        yield Path(folder)


def examine(of: StabilityMap, cell: MapCell, side: Engine, workers: Workers, limit: float = LIMIT) -> Examined:
    """Run a cell on an engine: how it ended, and the particles before."""
    with scratch() as folder:
        return settle(ask(of, cell, side, workers, folder, limit), workers, limit)
