"""Faults planted one by one, several in parallel, each until cases of two files detect it."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from lammps_cases.comparison.store import Store
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene.casefile import Case
from tests.workshop.faults import substitute, tasks
from tests.workshop.faults.fault import Detection, Fault, files
from tests.workshop.faults.perturbed import JudgingWorkers
from tests.workshop.faults.substitute import Substitution
from tests.workshop.faults.tasks import Control
from tests.workshop.together import Asking, together

WITNESSES = 2  # case files that detect a fault before the rest is skipped, unless all cases are run
LIMIT = 300.0  # seconds that some cases with one fault may take
CASE_LIMIT = 30.0  # seconds of the processor that a mistaken reference may take for a case
TOGETHER = 12  # cases given to a worker at a time
ENOUGH = 3  # answers that a mistaken reference changes, judged before it continues
EXCLUDED_TAGS = {"long", "open", "crash"}  # of cases that are not used

T = TypeVar("T")
Detecting = Asking[list[Detection]]


def in_order(cases: Sequence[Case]) -> list[Case]:
    """Return the cases that can detect faults: quick ones first, small ones first, one of every file in turn."""
    turn: dict[str, int] = {}

    def place(case: Case) -> tuple[bool, bool, int, int, str]:
        group = case.name.partition(".")[0]
        turn[group] = turn.get(group, -1) + 1
        return "quick" not in case.tags, case.scene.twin is not None, turn[group], cost(case), case.name

    usable = [case for case in cases if not EXCLUDED_TAGS & set(case.tags) and case.scene.engine.ranks == 1]
    return sorted(sorted(usable, key=lambda case: (cost(case), case.name)), key=place)


def cost(case: Case) -> int:
    """Return the particles times evaluations, as far as the scene specifies them."""
    n = math.prod(getattr(case.scene.positions, "cells", (10, 10)))
    return n * (1 + (case.scene.evolve.steps if case.scene.evolve else 0)) * (10 if case.scene.whole_model else 1)


class MutationPool:
    """Workers, and a folder with the answers without a fault; a context manager."""

    def __init__(self, engine: Engine, jobs: int, store: Store | None, every: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="eos-ref-power-")
        self.folder = Path(self._folder.name)
        self._substitutes = Workers(None, jobs)
        self._workers = JudgingWorkers(engine, jobs, store, LIMIT)
        self._workers.check_shared(self.folder)
        self.jobs, self.every = self._workers.count, every
        self.answered: list[str] = []
        self.played: list[str] = []
        self.manual: list[str] = []
        self.quick: set[str] = set()

    @property
    def engine(self) -> EngineRecord:
        """Return the LAMMPS of the workers.

        Raises
        ------
        EngineMissing
        """
        return self._workers.judge.engine

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._substitutes.__exit__(kind, value, trace)
        self._workers.__exit__(kind, value, trace)
        self._folder.cleanup()

    # --- without a fault

    def prepare(self, cases: Sequence[Case], progress: Progress) -> list[Control]:
        """Run every case on both sides without a fault; only those as expected are used for faults."""
        controls: list[Control] = []
        for control in together(self._workers, map(self._control, cases), 2 * self.jobs):
            controls.append(control)
            progress.advance(len(controls), len(cases), f"without a fault: {control.case}")
        by_case = {c.case: c for c in controls}
        order = [by_case[case.name] for case in cases]
        self.answered = [c.case for c in order if c.answered]
        self.played = [c.case for c in order if c.answered and c.played]
        self.manual = [c.case for c in order if c.answered and c.manual]
        self.quick = {case.name for case in cases if "quick" in case.tags}
        return order

    def _control(self, case: Case) -> Asking[Control]:
        ready = prepare(case.by(self.engine.manual))
        outcome: Control | Failure = yield self._judging(tasks.answer_case, ready)
        if isinstance(outcome, Failure):
            outcome = yield self._judging(tasks.answer_case, ready, outcome.message)
        if isinstance(outcome, Failure):
            return Control(case.name, False, None, (f"{outcome.verdict}: {outcome.message}",))
        return outcome

    def _judging(self, task: Callable[..., T], *arguments: Any) -> Future[T]:
        return self._workers.judging(task, self.folder, *arguments)

    # --- faults

    def plant(self, faults: Sequence[Fault]) -> Iterator[tuple[Fault, tuple[Detection, ...]]]:
        """Plant faults; yield each, as it is done, with its detections: until there are enough of them, or all."""

        def planted(fault: Fault) -> Asking[tuple[Fault, tuple[Detection, ...]]]:
            by_lammps = fault.family in ("told", "read")
            detections = yield from (self._ask_lammps(fault) if by_lammps else self._ask_substitute(fault))
            return fault, tuple(detections)

        return together(self._workers, map(planted, faults), 2 * self.jobs)

    def _groups(self, names: Sequence[str]) -> list[list[str]]:
        """Return the names in groups, quick ones by themselves."""
        quick = [name for name in names if name in self.quick]
        others = [name for name in names if name not in self.quick]
        return [part[k : k + TOGETHER] for part in (quick, others) for k in range(0, len(part), TOGETHER)]

    def _ask_lammps(self, fault: Fault) -> Detecting:
        """Run cases with a fault in LAMMPS' input or output."""
        detections: list[Detection] = []
        ahead = self._groups(self.answered)
        while ahead and not self._enough(detections):
            names = ahead.pop(0)
            left = None if self.every else WITNESSES - len(files(detections))
            outcome = yield self._judging(tasks.detect, fault.id, names, left)
            if not isinstance(outcome, Failure):
                detections += outcome
            elif len(names) > 1:
                ahead[:0] = [[name] for name in names]  # which of them terminated the worker?
            else:
                detections += yield from self._ended(names[0], outcome)
        return detections

    def _enough(self, detections: Sequence[Detection]) -> bool:
        """Return whether no further case needs to be run with a fault."""
        return not self.every and len(files(detections)) >= WITNESSES

    def _ended(self, name: str, failure: Failure) -> Detecting:
        """Judge that LAMMPS, or its substitute, did not answer; any other failure is a fault of this program."""
        if failure.verdict == "error":
            raise RuntimeError(f"{name}: {failure.message}")
        outcome = yield self._judging(tasks.judge_failure, name, failure)
        return [outcome] if isinstance(outcome, Detection) else []

    def _ask_substitute(self, fault: Fault) -> Detecting:
        """Let the mistaken reference answer for LAMMPS, then for a LAMMPS without findings, which hide mistakes."""
        detections = yield from self._ask_in_place(fault, self.played, self.engine.distribution, [])
        if not self._enough(detections):
            detecting = {one.case for one in detections}
            others = [name for name in self.manual if name not in detecting]
            detections = yield from self._ask_in_place(fault, others, None, detections)
        return detections

    def _ask_in_place(self, fault: Fault, cases: list[str], engine: str | None, before: list[Detection]) -> Detecting:
        """Let the mistaken reference answer cases, judge the answers that differ; return the detections so far."""
        enough = len(cases) if self.every else ENOUGH
        detections = list(before)
        quick = [name for name in cases if name in self.quick]
        ahead = [part for part in (quick, cases[len(quick) :]) if part]
        while ahead and not self._enough(detections):
            names = ahead.pop(0)
            played = yield self._call_substitute(fault, names, engine, enough)
            if isinstance(played, Failure):
                if len(names) > 1:
                    ahead[:0] = [[name] for name in names]
                else:
                    detections += yield from self._ended(names[0], played)
                continue
            for one in played:
                outcome = yield self._judging(tasks.judge_substitution, one)
                detections += [outcome] if isinstance(outcome, Detection) else []
                if self._enough(detections):
                    break
            if len(played) >= enough:
                rest = names[names.index(played[-1].case) + 1 :]
                ahead[:0] = [rest] if rest else []
        return detections

    def _call_substitute(
        self, fault: Fault, names: list[str], engine: str | None, enough: int
    ) -> Future[list[Substitution]]:
        assert isinstance(fault, substitute.FormulaFault)
        given = fault.change, self.folder, names, engine, enough, CASE_LIMIT
        limit = 60.0 + CASE_LIMIT * len(names)
        return self._substitutes.call(substitute.answer_apart, limit, *given, time_limit=2 * limit)
