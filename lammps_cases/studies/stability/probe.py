"""One cell of a map on one engine: run in stretches, observed after each; the failing stretch is repeated by steps."""

from __future__ import annotations

import contextlib
import os
import pickle
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.engine.session import kept
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.studies.flows.flow import Snapshot, Start
from lammps_cases.studies.flows.solve import FlowRun
from lammps_cases.studies.stability import kinds
from lammps_cases.studies.stability.kinds import ParticleFailure, Subject
from lammps_cases.studies.stability.model import CellOutcome, Engine, FailureCriteria, Kind, MapCell, StabilityMap
from lammps_cases.studies.stability.runs import ReferenceRun, Stopped, open_run

LIMIT = 30.0  # seconds for a cell
Note = Callable[[Snapshot], None]


@dataclass(frozen=True)
class Examined:
    """How a cell ended, and the particles before the failure; None for a stable run and for a law alone.

    ``before`` holds arrays by id: step, x, v, rho, pressure, id, type, low, high, and the failing ids.
    """

    outcome: CellOutcome
    before: dict[str, Any] | None = None


# --- following a run


def follow(
    make: Callable[[], FlowRun],
    of: Subject,
    watch: FailureCriteria,
    steps: int,
    note: Note = lambda look: None,
    single: int = 0,
) -> Examined:
    """Observe a run until its first failure.

    Parameters
    ----------
    make : callable
        Sets up the run; called again to repeat its last stretch, with the same bits.
    of : Subject
    watch : FailureCriteria
    steps : int
        Steps taken at most.
    note : callable
        Called with every sound observation, before the run continues.
    single : int
        Step from which on every step is observed.
    """
    return _Followed(make, of, watch, note).to_failure(steps, single)


class _Followed:
    """A run that is followed to its first failure; ``last`` is the last sound observation."""

    run: FlowRun
    last: Snapshot

    def __init__(self, make: Callable[[], FlowRun], of: Subject, watch: FailureCriteria, note: Note) -> None:
        self.make, self.of, self.watch, self.note = make, of, watch, note
        self.energy, self.stretches = watch.energy, list[int]()

    def to_failure(self, steps: int, single: int) -> Examined:
        """See `follow`."""
        try:
            self.run = self.make()
            self.last = self.run.snapshot()
        except Stopped as stop:
            return Examined(CellOutcome(stop.kind, 0, stop.atom, message=stop.message))
        failure = self._failure(self.last)
        if failure is not None:
            return self._failed(failure, 0)
        at_rest = kinds.kinetic_energy(self.of.mass_n, self.last.v_nc)
        while self.last.step < steps:
            step = self.last.step
            self.note(self.last)
            stretch = min(self.watch.every, steps - step)
            if single:
                stretch = min(stretch, max(single - step, 1))
            failure, message = self._advance(stretch)
            if failure is not None:
                end = step + stretch
                return self._failed(failure, end, message) if stretch == 1 else self._located(failure, end, message)
            if self.energy is None:
                self.energy = max(at_rest, kinds.kinetic_energy(self.of.mass_n, self.last.v_nc))
        return Examined(CellOutcome("stable"))

    def _failure(self, look: Snapshot) -> ParticleFailure | None:
        return kinds.first(self.of, self.watch, look, self.energy)

    def _advance(self, steps: int) -> tuple[ParticleFailure | None, str]:
        """Take steps; return the failure after them, and the engine's message. Without a failure, observe."""
        self.stretches.append(steps)
        try:
            self.run.advance(steps)
            look = self.run.snapshot()
        except Stopped as stop:
            return self._failure_of_stopped() or ParticleFailure(stop.kind, stop.atom), stop.message
        failure = self._failure(look)
        if failure is None:
            self.last = look
        return failure, ""

    def _failure_of_stopped(self) -> ParticleFailure | None:
        """Return the failure of a reference that stopped in the middle of a step and can still be observed."""
        if not isinstance(self.run, ReferenceRun):
            return None
        watch = replace(self.watch, surface={}, condition=None, closest=None)
        failure = kinds.first(self.of, watch, self.run.snapshot(), self.energy)
        return failure if failure is not None and failure.kind in ("non-finite", "lost particles") else None

    def _located(self, first: ParticleFailure, end: int, first_message: str) -> Examined:
        """Run the failing stretch again, one step at a time."""
        try:
            self.run = self.make()
            for steps in self.stretches[:-1]:
                self.run.advance(steps)
        except Stopped as stop:
            # With uninitialised memory (a finding) LAMMPS may end differently the second time.
            return self._failed(first, end, f"{first_message} (run again, it ended earlier: {stop.message})")
        while self.last.step < end:
            step = self.last.step + 1
            failure, message = self._advance(1)
            if failure is not None:
                return self._failed(failure, step, message)
            self.note(self.last)
        return self._failed(first, end, f"{first_message} (did not recur when every step was observed)")

    def _failed(self, failure: ParticleFailure, step: int, message: str = "") -> Examined:
        outcome = CellOutcome(failure.kind, step, failure.atom, failure.value, message.strip())
        return Examined(outcome, particles(self.of, self.last, failure.atom))


def particles(of: Subject, look: Snapshot, failing: int | None) -> dict[str, Any] | None:
    """Return observed particles as the arrays of `Examined.before`; None for a law alone."""
    if not of.moves:
        return None
    return {
        "step": np.array(look.step),
        "x": kinds.wrapped(of.box, look.x_nc[:, : len(of.box.low_c)]),
        "v": look.v_nc,
        "rho": look.rho_n,
        "pressure": look.pressure_n,
        "id": of.id_n,
        "type": of.type_n,
        "low": np.array(of.box.low_c),
        "high": np.array(of.box.high_c),
        "failing": np.array([] if failing is None else [failing], int),
    }


# --- inside a worker


def run_cell(
    site: str | None, start: Start, watch: FailureCriteria, side: Engine, trace: Path, single: int = 0
) -> Examined:
    """Examine one cell, as the task of a worker.

    The last sound observation is kept in the file ``trace``, in case the worker dies.
    """
    of, begin = kinds.subject(start), time.perf_counter()

    def note(look: Snapshot) -> None:
        partly = trace.with_name(f"{trace.name}.new")
        partly.write_bytes(pickle.dumps((look, time.perf_counter() - begin)))
        partly.replace(trace)

    steps = start.steps[-1] if of.moves else 0
    examined = follow(partial(open_run, start, watch, side, kept(site)), of, watch, steps, note, single)
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


@dataclass(frozen=True)
class Examiner:
    """Workers that examine cells, within a time limit (s); ``folder`` is for traces of workers that die."""

    workers: Workers
    folder: Path
    limit: float = LIMIT

    def ask(self, of: StabilityMap, cell: MapCell, side: Engine) -> PendingCell:
        """Queue a cell."""
        start, watch = of.start(cell), of.watch(cell)
        handle, name = tempfile.mkstemp(dir=self.folder, prefix="trace-")
        os.close(handle)
        return PendingCell(start, watch, side, Path(name), self._queue(start, watch, side, Path(name)))

    def _queue(self, *arguments: Any) -> Future[Examined]:
        future: Future[Examined] = self.workers.call(run_cell, *arguments, time_limit=self.limit)
        return future

    def settle(self, pending: PendingCell) -> Examined:
        """Wait for a cell.

        The death of a worker becomes a `crash`, after the last sound observation; the last stretch is repeated step by
        step to find the step. A worker that does not end becomes a `hang`.

        Raises
        ------
        RuntimeError
            A fault of this project.
        """
        try:
            outcome = self.workers.outcome(pending.future)
            if not isinstance(outcome, Failure):
                return outcome
            message = _failure_message(pending.side, outcome)
            if outcome.verdict not in ("timeout", "crashed"):
                raise RuntimeError(f"{pending.start.case.name} on {pending.side}: {message}")
            if outcome.verdict == "timeout":
                return _died(pending, "hang", message, self.limit)
            return self._crashed(pending, message)
        finally:
            pending.trace.unlink(missing_ok=True)

    def _crashed(self, pending: PendingCell, message: str) -> Examined:
        last = _last_observation(pending.trace)
        if last is not None and pending.watch.every > 1:
            single = max(last[0].step, 1)
            future = self._queue(pending.start, pending.watch, pending.side, pending.trace, single)
            again = self.workers.outcome(future)
            if isinstance(again, Failure):
                message = _failure_message(pending.side, again)
            elif again.outcome.kind != "stable":
                return again  # a failure came before the crash
            else:
                message += " (once in two runs)"
        return _died(pending, "crash", message, 0.0)


def _failure_message(side: Engine, failure: Failure) -> str:
    """Return the message of a worker's failure, which names LAMMPS even if the worker ran the reference."""
    return failure.message if side == "lammps" else failure.message.replace("LAMMPS", "the reference")


def _died(pending: PendingCell, kind: Kind, message: str, seconds: float) -> Examined:
    steps, last = pending.start.steps[-1], _last_observation(pending.trace)
    if last is None:
        return Examined(CellOutcome(kind, 0, message=message, seconds=seconds, steps=steps))
    look, spent = last
    outcome = CellOutcome(kind, look.step + 1, message=message, seconds=seconds or spent, steps=steps)
    return Examined(outcome, particles(kinds.subject(pending.start), look, None))


def _last_observation(trace: Path) -> tuple[Snapshot, float] | None:
    """Return the last observation of a dead worker, and the seconds until then; None without one."""
    content = trace.read_bytes() if trace.exists() else b""
    return pickle.loads(content) if content else None


@contextlib.contextmanager
def examiner(workers: Workers, limit: float = LIMIT) -> Iterator[Examiner]:
    """Yield an examiner, with a folder for its traces."""
    with tempfile.TemporaryDirectory(prefix="eos-ref-stability-") as folder:
        workers.check_shared(Path(folder))
        yield Examiner(workers, Path(folder), limit)


def examine(of: StabilityMap, cell: MapCell, side: Engine, workers: Workers, limit: float = LIMIT) -> Examined:
    """Run a cell on an engine; return how it ended, and the particles before."""
    with examiner(workers, limit) as one:
        return one.settle(one.ask(of, cell, side))
