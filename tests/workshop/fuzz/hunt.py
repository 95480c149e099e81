"""Random scenes run by LAMMPS and judged, one after another by the workers, until time is up."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice, takewhile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eos_ref import InputError
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases.bugs.shrink.candidate import FailureMode, failure_mode
from lammps_cases.bugs.shrink.shrink import WorkerJudge, shrink
from lammps_cases.comparison.trajectory import visit
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER, with_gap
from lammps_cases.findings.variants import combined
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.records.yaml_files import yaml_text
from lammps_cases.run import flow
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.cases import is_nondeterministic
from lammps_cases.verdict.problems import problem_of
from lammps_cases.verdict.runaway import LOST
from tests.workshop.fuzz import schema
from tests.workshop.fuzz.draw import DrawnScene, draws
from tests.workshop.fuzz.record import FuzzRecord, Red
from tests.workshop.fuzz.rules import NEVER
from tests.workshop.together import Asking, together

if TYPE_CHECKING:
    from lammps_cases.verdict.case_arrays import Arrays

BINS = 2**31 - 1
WRITTEN_EVERY = 5.0  # seconds
JUDGING = 300.0  # seconds that judging a scene may take
SHRINKING = 60.0  # seconds for shrinking one scene


def argued(choice: str) -> str:
    """Return why a choice is never drawn; empty if it may be."""
    place = choice.partition("=")[0]
    return next((why for part, why in NEVER.items() if part == choice or f"{place}.".startswith(f"{part}.")), "")


class ChoiceCounts:
    """How often every choice of the schema, and every pair of choices, was drawn."""

    def __init__(self) -> None:
        self.choices = [choice for choice in schema.choices() if not argued(choice)]
        self._row = {choice: k for k, choice in enumerate(self.choices)}
        self._together = np.zeros((len(self.choices), len(self.choices)), int)
        places = np.array([choice.partition("=")[0] for choice in self.choices])
        self._pairs = np.triu(places[:, None] != places[None, :], 1)

    def add(self, taken: set[str]) -> None:
        """Count a scene that takes some choices."""
        rows = sorted(self._row[choice] for choice in taken if choice in self._row)
        self._together[np.ix_(rows, rows)] += 1

    def counts(self) -> dict[str, int]:
        """Return the number of scenes with every choice."""
        return dict(zip(self.choices, np.diag(self._together).tolist(), strict=True))

    def pairs(self) -> tuple[int, int]:
        """Return how many pairs of choices of different keys were drawn, and how many there are, possible or not."""
        return int(((self._together > 0) & self._pairs).sum()), int(self._pairs.sum())


@dataclass
class Hunt:
    """Random scenes of a seed on an engine.

    Attributes
    ----------
    seconds : time for drawing and judging, without the time for shrinking
    first, scenes : the first draw, and the largest number of scenes (None: as many as there is time for)
    shrinks : whether red scenes are shrunk
    """

    engine: Engine
    seed: int
    seconds: float
    jobs: int
    folder: Path
    first: int = 0
    scenes: int | None = None
    shrinks: bool = True
    command: str = ""
    progress: Progress = SILENT
    coverage: ChoiceCounts = field(default_factory=ChoiceCounts)
    _modes: dict[int, FailureMode | None] = field(default_factory=dict)
    _cases: dict[int, Case] = field(default_factory=dict)

    def run(self) -> FuzzRecord:
        """Draw, judge, shrink, and return the results; after Ctrl-C those so far.

        Raises
        ------
        EngineMissing
        InputError
            No scene can be drawn.
        """
        begin = time.monotonic()
        with Workers(self.engine.site, self.jobs) as workers:
            judge = WorkerJudge(workers, self.engine)
            record = FuzzRecord(engine=judge.engine, command=self.command, seed=self.seed, first=self.first)
            record.never = dict(NEVER)
            try:
                self._judge_all(workers, judge, record, begin)
                if self.shrinks:
                    self._make_small(judge, record)
            except KeyboardInterrupt:
                record.interrupted = True
            record.seconds = round(time.monotonic() - begin, 1)
            self._write(record)
            if record.interrupted:
                workers.stop()
        return record

    def _judge_all(self, workers: Workers, judge: WorkerJudge, record: FuzzRecord, begin: float) -> None:
        written = begin
        for drawn, verdict in self._judged(workers, judge, begin):
            self._count(record, drawn, verdict)
            now = time.monotonic()
            record.seconds = round(now - begin, 1)
            kept = record.red and record.red[-1].draw == drawn.number
            complaint = "" if not kept else f"{verdict.verdict} draw {drawn.number}: {verdict.message}"
            label = f"{record.drawn} scenes, {len(record.red)} red"
            self.progress.advance(min(int(now - begin), int(self.seconds)), int(self.seconds), label, complaint)
            if now - written > WRITTEN_EVERY:
                self._write(record)
                written = now

    def _judged(self, workers: Workers, judge: WorkerJudge, begin: float) -> Iterator[tuple[DrawnScene, CaseRecord]]:
        """Yield scenes with their verdicts, several in progress at a time."""

        def judged(drawn: DrawnScene) -> Asking[tuple[DrawnScene, CaseRecord]]:
            drawn = drawn.by(judge.engine.manual)
            limit, outcomes = drawn.case.scene.engine.time_limit, list[Answer | Failure]()
            for job in drawn.ready.jobs:
                outcomes += [(yield workers.submit(job, limit))]
            outcome = yield workers.call(flow.judge, drawn.ready, outcomes, judge.engine, None, time_limit=JUDGING)
            return drawn, record_of(drawn, outcome, judge.engine)

        scenes = islice(draws(self.seed, self.first), self.scenes)
        scenes = takewhile(lambda _: time.monotonic() - begin < self.seconds, scenes)
        return together(workers, map(judged, scenes), 2 * workers.count)

    def _count(self, record: FuzzRecord, drawn: DrawnScene, verdict: CaseRecord) -> None:
        record.drawn += 1
        record.twins += bool(verdict.twin)
        record.verdicts = dict(Counter(record.verdicts) + Counter([verdict.verdict]))
        record.rejected = dict(Counter(record.rejected) + Counter(drawn.rejected))
        record.findings = dict(Counter(record.findings) + Counter(verdict.findings))
        self.coverage.add(drawn.choices)
        record.choices = self.coverage.counts()
        record.pairs_drawn, record.pairs = self.coverage.pairs()
        if verdict.as_expected:
            return
        if gap := known_gap(verdict, drawn.case.scene, record.engine.distribution):
            record.gaps[gap] = record.gaps.get(gap, 0) + 1
        elif is_loss(drawn.ready, verdict, record.engine.distribution):
            record.lost += 1
        elif is_unbounded(verdict, record.engine.distribution):
            record.unbounded += 1
        else:
            self._keep(record, drawn, verdict)

    def _keep(self, record: FuzzRecord, drawn: DrawnScene, verdict: CaseRecord) -> None:
        file = self.folder / "drawn" / f"{drawn.case.name}.yaml"
        data = {"name": drawn.case.name, "about": drawn.case.about, "tags": list(drawn.case.tags)}
        write_atomically(file, yaml_text(data | {"scene": drawn.content}))
        mode = failure_mode(verdict)
        self._modes[drawn.number], self._cases[drawn.number] = mode, drawn.case
        record.red.append(
            Red(
                draw=drawn.number,
                verdict=verdict.verdict,
                failure=mode.words if mode else verdict.verdict,
                message=verdict.message,
                particles=len(drawn.ready.atoms),
                file=str(file),
                reproduce=f"eos-ref run --cases {file} {drawn.case.name}",
            )
        )

    def _make_small(self, judge: WorkerJudge, record: FuzzRecord) -> None:
        """Shrink the scene with fewest particles of all those that fail the same way."""
        groups: dict[str, list[Red]] = {}
        for red in record.red:
            groups.setdefault(repr(self._modes[red.draw]), []).append(red)
        for k, group in enumerate(groups.values()):
            red = min(group, key=lambda one: one.particles)
            self.progress.advance(k, len(groups), f"making draw {red.draw} small")
            file = self.folder / "small" / f"{self._cases[red.draw].name}.yaml"
            try:
                shrunk = shrink(self._cases[red.draw], _UntilLate(judge, time.monotonic() + SHRINKING))
            except InputError as error:
                red.note = error.rule
                continue
            write_atomically(file, shrunk.text)
            red.small, red.small_particles = str(file), shrunk.after.particles
            self._write(record)

    def _write(self, record: FuzzRecord) -> None:
        write_atomically(self.folder / "fuzz.json", record.model_dump_json(indent=1) + "\n")


def record_of(drawn: DrawnScene, outcome: tuple[CaseRecord, Arrays] | Failure, engine: EngineRecord) -> CaseRecord:
    """Return the record of a scene that was judged or could not be judged."""
    return flow.faulty(drawn.ready, engine, outcome) if isinstance(outcome, Failure) else outcome[0]


def is_loss(ready: PreparedCase, record: CaseRecord, engine: str) -> bool:
    """Return whether particles are lost by both sides, or by the reference alone, whose forces LAMMPS may lack."""
    if record.harness_error:
        return record.harness_error.exception == InputError.__name__ and loses(ready)
    return is_lost(record) and loses(ready, engine)


def is_lost(record: CaseRecord) -> bool:
    """Return whether LAMMPS ended as it does if particles are lost."""
    return record.verdict == "refused" and LOST.search(record.engine_error) is not None


def known_gap(record: CaseRecord, scene: Scene, engine: str) -> str:
    """Return the known finding of the engine whose variant does not reproduce such a scene, or ""."""
    if not (is_lost(record) or (record.verdict == "differs" and record.ended == "answered")):
        return ""
    gaps = with_gap(scene, engine)
    if record.verdict == "differs":  # those that reach what differs
        gaps = [entry for entry in gaps if entry.id in record.limits or is_nondeterministic(entry)]
    return next((entry.id for entry in gaps), "")


def is_unbounded(record: CaseRecord, engine: str) -> bool:
    """Return whether known findings of the engine reproduce all values that have a bound, at all steps.

    Values without a bound cannot be judged by either verdict.
    """
    left = record.beyond.blame if record.beyond else record.blame
    findings = record.beyond.findings if record.beyond else []
    if record.verdict != "differs" or left is None or left.bound != math.inf:
        return False
    return {entry.id for entry in LEDGER if entry.listed(engine)}.issuperset(findings)


class _UntilLate:
    """The ordinary verdict, and after some time a passing one, which ends the shrinking."""

    def __init__(self, judge: WorkerJudge, end: float) -> None:
        self._judge, self._end = judge, end

    def __call__(self, case: Case) -> CaseRecord:
        """Return the record of a case."""
        if time.monotonic() > self._end:
            return CaseRecord(case=case.name, verdict="skipped", ended="skipped")
        return self._judge(case)


# --- scenes that lose their particles


def loses(ready: PreparedCase, engine: str = "") -> bool:
    """Return whether particles leave the box, or have no position.

    By the reference, with the findings of the engine, if one is named, that need none of its numbers. Particles
    leave the box through faces that are not periodic; through periodic ones where a step takes them further than to the
    next image; and with faces that follow them (shrink-wrapped) where the box has more bins than LAMMPS can count.
    """
    scene = ready.case.scene
    if scene.evolve is None:
        return False
    problem = problem_of(scene, ready.atoms, ready.case.where, tuple(range(scene.evolve.steps + 1)))
    variants = [entry.model_variant for entry in LEDGER if engine and entry.model_variant and entry.listed(engine)]
    known = [one for one in variants if not (one.fit or one.undefined) and one.applies(problem)]
    stages, stepping = combined(known, problem, {}) or (None, Simulation)
    assert stages is not None
    sim = problem.simulation(stages, stepping)
    before_nc, wrapped = sim.state.x_nc, scene.engine.boundary != "f"
    try:
        with np.errstate(all="ignore"):
            for _ in visit(sim, problem.steps, problem.timestep, problem.stops):
                if _outside(sim, before_nc, wrapped):
                    return True
                before_nc = sim.state.x_nc
    except InputError:  # positions that are not finite
        return True
    return False


def _outside(sim: Simulation, before_nc: Array, wrapped: bool) -> bool:
    x_nc, box = sim.state.x_nc, sim.box
    around_c, edge_c = np.array(box.periodic), np.array(box.edge_c)
    moved_nc = box.upright(x_nc - before_nc) if box.tilted else x_nc - before_nc
    if not np.isfinite(x_nc).all() or (np.abs(moved_nc) > edge_c)[:, around_c].any():
        return True
    if wrapped:  # bins of half a cutoff, in which neighbours are sought
        size_c = np.where(around_c, edge_c, np.ptp(x_nc, axis=0))
        return bool(np.prod(np.maximum(size_c / (sim.model.cut / 2), 1.0)) > BINS)
    return bool(((x_nc < box.low_c) | (x_nc > box.high_c))[:, ~around_c].any())
