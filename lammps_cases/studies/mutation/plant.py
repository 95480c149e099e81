"""Faults planted one by one, several at a time, each until a case sees it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pebble import ProcessPool

from lammps_cases.comparison.store import Store
from lammps_cases.engine import forkserver
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run.campaign import engine_record, prepare
from lammps_cases.scene.casefile import Case
from lammps_cases.studies.mutation import attempts, control, formula, player, read, source, told
from lammps_cases.studies.mutation.control import Control
from lammps_cases.studies.mutation.fault import Fault, Seen
from lammps_cases.studies.mutation.player import Mistake, Played

LIMIT = 300.0  # seconds that some cases with one fault may take
CASE_LIMIT = 30.0  # seconds of the processor that a mistaken reference may take for a case
TOGETHER = 12  # cases given to a worker at a time
ENOUGH = 3  # answers that a mistaken reference changes, judged before it plays more
ELSE = ("long", "open", "crash")  # tags of cases that are not used
# What a fresh process needs that is not of the reference: imported once for all of them.
LIGHT = ("numpy", "scipy.special", "pydantic", "yaml", "flint", "vesin", "lammps_cases.studies.mutation.player")

Asking = Generator[Future[Any], Any, list[Seen]]


@dataclass(frozen=True)
class Planted:
    """A fault, and the cases that see it, in the order in which they were tried.

    Attributes
    ----------
    caught_by : the first case that sees it, or all of them
    """

    fault: Fault
    caught_by: tuple[Seen, ...]


@cache
def faults(engine: str = "") -> dict[str, Fault]:
    """All faults by id, family after family, but for those that an engine is known to have."""
    had = {entry.particles.stages for entry in LEDGER if entry.particles and entry.listed(engine)}
    every: dict[str, Fault] = {**told.faults(), **read.faults(), **formula.faults(), **source.faults()}
    return {name: fault for name, fault in every.items() if formula.stages(fault) not in had - {None}}


def in_order(cases: Sequence[Case]) -> list[Case]:
    """Cases that can see faults: quick ones first, small ones first, one of every file in turn."""
    turn: dict[str, int] = {}

    def place(case: Case) -> tuple[bool, bool, int, int, str]:
        group = case.name.partition(".")[0]
        turn[group] = turn.get(group, -1) + 1
        return "quick" not in case.tags, case.scene.twin is not None, turn[group], _cost(case), case.name

    usable = [case for case in cases if not set(ELSE) & set(case.tags) and case.scene.engine.ranks == 1]
    return sorted(sorted(usable, key=lambda case: (_cost(case), case.name)), key=place)


def _cost(case: Case) -> int:
    """Particles times evaluations, as far as the scene says."""
    cells = getattr(case.scene.positions, "cells", (10, 10))
    n = 1
    for count in cells:
        n *= count
    return n * (1 + (case.scene.evolve.steps if case.scene.evolve else 0)) * (10 if case.scene.whole_model else 1)


class Field:
    """Workers, and the control in a folder of its own; a context manager."""

    def __init__(self, engine: Engine, jobs: int, store: Store | None, every: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="eos-ref-power-")
        self.folder = Path(self._folder.name)
        context = forkserver.context(*LIGHT)
        self._workers = Workers(engine.site, jobs)
        self._players = ProcessPool(
            max_workers=jobs, max_tasks=1, context=context, initializer=player.prepare, initargs=(os.getpid(),)
        )
        try:
            who = self._workers.outcome(self._workers.identify())
        except BaseException as error:  # there is no LAMMPS
            self.__exit__(type(error), error, None)
            raise
        self.engine: EngineRecord = engine_record(engine, {} if isinstance(who, Failure) else who)
        self.jobs, self.store, self.every = jobs, store, every
        self.answered: list[str] = []
        self.played: list[str] = []
        self.quick: set[str] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._players.stop()
        self._players.join()
        self._workers.__exit__(kind, value, trace)
        self._folder.cleanup()

    # --- control

    def prepare(self, cases: Sequence[Case], progress: Progress) -> list[Control]:
        """Have every case answered and played without a fault; only those as expected are used for faults."""
        found: list[Control] = []
        asking: list[Generator[Future[Any], Any, Control]] = [self._control(case) for case in cases]
        for control_ in self._together(asking):
            found.append(control_)
            progress.advance(len(found), len(cases), f"without a fault: {control_.case}")
        known = {c.case: c for c in found}
        order = [known[case.name] for case in cases]
        self.answered = [c.case for c in order if c.answered]
        self.played = [c.case for c in order if c.answered and c.played]
        self.quick = {case.name for case in cases if "quick" in case.tags}
        return order

    def _control(self, case: Case) -> Generator[Future[Any], Any, Control]:
        ready = prepare(case)
        given = (self.folder, ready, self.engine, self.store)
        outcome = yield self._workers.call(control.ask, *given, time_limit=LIMIT)
        if isinstance(outcome, Failure):
            outcome = yield self._workers.call(control.ask, *given, outcome.message, time_limit=LIMIT)
        if isinstance(outcome, Failure):
            return Control(case.name, False, None, (f"{outcome.verdict}: {outcome.message}",))
        found: Control = outcome
        return found

    # --- faults

    def plant(self, chosen: Sequence[Fault], report: Callable[[Planted], None]) -> None:
        """Plant faults, and report each when it is done."""

        def planted(fault: Fault) -> Generator[Future[Any], Any, Planted]:
            seen = yield from (self._ask(fault) if fault.family in ("told", "read") else self._play(fault))
            return Planted(fault, tuple(seen))

        for done in self._together([planted(fault) for fault in chosen]):
            report(done)

    def _together(self, asking: Sequence[Generator[Future[Any], Any, Any]]) -> Generator[Any, None, None]:
        """Advance several generators, each of which waits for one future at a time; results as they come."""
        ahead = list(reversed(asking))
        waiting: dict[Future[Any], Generator[Future[Any], Any, Any]] = {}
        ready: list[tuple[Generator[Future[Any], Any, Any], Any]] = []
        while ahead or waiting or ready:
            while ahead and len(waiting) + len(ready) < 2 * self.jobs:
                ready.append((ahead.pop(), None))
            while ready:
                one, value = ready.pop()
                try:
                    waiting[one.send(value)] = one
                except StopIteration as end:
                    yield end.value
            if waiting:
                done = wait(waiting, return_when=FIRST_COMPLETED).done
                ready.extend((waiting.pop(future), self._workers.outcome(future)) for future in done)

    def _groups(self, names: Sequence[str]) -> list[list[str]]:
        """Names in groups, quick ones by themselves."""
        quick = [name for name in names if name in self.quick]
        others = [name for name in names if name not in self.quick]
        return [part[k : k + TOGETHER] for part in (quick, others) for k in range(0, len(part), TOGETHER)]

    def _ask(self, fault: Fault) -> Asking:
        """Put cases to a fault in what LAMMPS is told, or in what is read from it."""
        found: list[Seen] = []
        ahead = self._groups(self.answered)
        while ahead and (self.every or not found):
            names = ahead.pop(0)
            given = (self.folder, fault.id, names, self.engine, self.store, self.every)
            outcome = yield self._workers.call(attempts.attempt, *given, time_limit=LIMIT)
            if not isinstance(outcome, Failure):
                found += outcome
            elif len(names) > 1:
                ahead[:0] = [[name] for name in names]  # which of them took the worker with it?
            else:
                found += yield from self._ended(names[0], outcome)
        return found

    def _ended(self, name: str, failure: Failure) -> Asking:
        """Judge that LAMMPS, or what plays it, did not answer; anything else that fails is a fault of this program."""
        if failure.verdict == "error":
            raise RuntimeError(f"{name}: {failure.message}")
        given = (self.folder, name, failure, self.engine, self.store)
        outcome = yield self._workers.call(attempts.ended, *given, time_limit=LIMIT)
        return [outcome] if isinstance(outcome, Seen) else []

    def _play(self, fault: Fault) -> Asking:
        """Have the mistaken reference play, and judge what comes out otherwise."""
        mistake = _mistake(fault)
        enough = len(self.played) if self.every else ENOUGH
        found: list[Seen] = []
        quick = [name for name in self.played if name in self.quick]
        ahead = [part for part in (quick, self.played[len(quick) :]) if part]
        while ahead and (self.every or not found):
            names = ahead.pop(0)
            played = yield self._call_player(mistake, names, enough)
            if isinstance(played, Failure):
                if len(names) > 1:
                    ahead[:0] = [[name] for name in names]
                else:
                    found += yield from self._ended(names[0], played)
                continue
            for one in played:
                given = (self.folder, one, self.engine, self.store)
                outcome = yield self._workers.call(attempts.judged, *given, time_limit=LIMIT)
                found += [outcome] if isinstance(outcome, Seen) else []
                if found and not self.every:
                    break
            if len(played) >= enough:
                rest = names[names.index(played[-1].case) + 1 :]
                ahead[:0] = [rest] if rest else []
        return found

    def _call_player(self, mistake: Mistake, names: list[str], enough: int) -> Future[list[Played]]:
        limit = 60.0 + CASE_LIMIT * len(names)
        given = (mistake, self.folder, names, self.engine.distribution, enough, CASE_LIMIT)
        future: Future[list[Played]] = self._players.schedule(player.play, args=given, timeout=limit)
        return future


def _mistake(fault: Fault) -> Mistake:
    if isinstance(fault, formula.LintFault):
        return Mistake(table=fault.table, name=fault.name)
    assert isinstance(fault, source.SourceFault)
    return Mistake(fault.module, fault.text)
