"""Random scenes put to LAMMPS and judged, one after another through the workers, until time is up."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from eos_ref import InputError
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER, with_gap
from lammps_cases.fuzz.coverage import ChoiceCounts
from lammps_cases.fuzz.draw import DrawnScene, draws
from lammps_cases.fuzz.lost import loses
from lammps_cases.fuzz.record import DOCUMENT, FuzzRecord, Red
from lammps_cases.fuzz.rules import NEVER
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.records.yaml_files import yaml_text
from lammps_cases.run import case_judgement
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import Case
from lammps_cases.shrink.failure import FailureMode, failure_mode
from lammps_cases.shrink.shrink import WorkerJudge, shrink
from lammps_cases.verdict.model_cases import left_to_chance
from lammps_cases.verdict.runaway import LOST

if TYPE_CHECKING:
    from lammps_cases.verdict.outcome import Arrays

WRITTEN_EVERY = 5.0  # seconds
JUDGING = 300.0  # seconds that judging a scene may take
# How LAMMPS ends where numbers are none, or particles nowhere in the box.
SHRINKING = 60.0  # seconds for making one scene small


@dataclass
class Hunt:
    """Random scenes of a seed on an engine.

    Attributes
    ----------
    seconds : time for drawing and judging; making small what is red comes on top
    first, scenes : the first draw, and most scenes to draw (None: as many as there is time for)
    shrinks : whether what is red is made small
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
        """Draw, judge, make small, and return what was found; Ctrl-C ends it with what there is.

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
        """Yield scenes with their verdicts in the order of their draws, some of them under way at a time."""
        source = draws(self.seed, self.first)
        running: deque[tuple[DrawnScene, list[Future[Answer]]]] = deque()
        judging: deque[tuple[DrawnScene, Future[tuple[CaseRecord, Arrays]]]] = deque()
        left = self.scenes
        while True:
            while len(running) <= workers.count and left != 0 and time.monotonic() - begin < self.seconds:
                drawn = next(source).by(judge.engine.manual)
                limit = drawn.case.scene.engine.time_limit
                running.append((drawn, [workers.submit(job, limit) for job in drawn.ready.jobs]))
                left = None if left is None else left - 1
            if running and len(judging) <= workers.count:
                drawn, futures = running.popleft()
                outcomes = case_judgement.answers(workers, futures)
                task = workers.call(case_judgement.judge, drawn.ready, outcomes, judge.engine, None, time_limit=JUDGING)
                judging.append((drawn, task))
            elif judging:
                drawn, task = judging.popleft()
                outcome = workers.outcome(task)
                yield drawn, record_of(drawn, outcome, judge.engine)
            else:
                return

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
        elif _lost(drawn, verdict, record.engine.distribution):
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
        """Make the scene with fewest particles small, of all those that fail the same way."""
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
        DOCUMENT.write(self.folder / "fuzz.json", record)


def record_of(drawn: DrawnScene, outcome: tuple[CaseRecord, Arrays] | Failure, engine: EngineRecord) -> CaseRecord:
    """Return the record of a scene that was judged, or whose judging failed."""
    return case_judgement.unjudged(drawn.ready, outcome, engine) if isinstance(outcome, Failure) else outcome[0]


def _lost(drawn: DrawnScene, record: CaseRecord, engine: str) -> bool:
    """Return whether particles are lost by both sides, or by the reference alone, whose forces LAMMPS may lack."""
    if record.harness_error:
        return record.harness_error.exception == InputError.__name__ and loses(drawn.ready)
    return is_lost(record) and loses(drawn.ready, engine)


def is_lost(record: CaseRecord) -> bool:
    """Return whether LAMMPS ended as it does where particles are lost."""
    return record.verdict == "refused" and LOST.search(record.engine_error) is not None


def known_gap(record: CaseRecord, scene: Scene, engine: str) -> str:
    """Return the finding that the engine is known to have and of which no variant reproduces such a scene, or ""."""
    if not (is_lost(record) or (record.verdict == "differs" and record.ended == "answered")):
        return ""
    gaps = with_gap(scene, engine)
    if record.verdict == "differs":  # those that reach what differs
        gaps = [entry for entry in gaps if entry.id in record.limits or left_to_chance(entry)]
    return next((entry.id for entry in gaps), "")


def is_unbounded(record: CaseRecord, engine: str) -> bool:
    """Return whether findings that the engine is known to have reproduce all that has a bound, at all steps.

    What has none cannot be judged, by neither verdict.
    """
    left = record.beyond.blame if record.beyond else record.blame
    findings = record.beyond.findings if record.beyond else []
    if record.verdict != "differs" or left is None or left.bound != math.inf:
        return False
    return {entry.id for entry in LEDGER if entry.listed(engine)}.issuperset(findings)


class _UntilLate:
    """The ordinary verdict, and after some time that of a case in which nothing is wrong: shrinking then ends."""

    def __init__(self, judge: WorkerJudge, end: float) -> None:
        self._judge, self._end = judge, end

    def __call__(self, case: Case) -> CaseRecord:
        """Return the record of a case."""
        if time.monotonic() > self._end:
            return CaseRecord(case=case.name, verdict="skipped", ended="skipped")
        return self._judge(case)
