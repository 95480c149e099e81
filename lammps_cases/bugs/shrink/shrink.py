"""``eos-ref shrink``: remove parts of a red case as long as it fails in the same way."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from eos_ref import InputError
from lammps_cases.bugs.shrink.candidate import (
    Content,
    FailureMode,
    Size,
    apart_from_particles,
    as_case,
    document,
    failure_mode,
    rule_broken,
    size,
    written_out,
)
from lammps_cases.bugs.shrink.reductions import REDUCTIONS
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import EngineMissing, Job
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.flow import JUDGING, faulty, judge, outcomes_of
from lammps_cases.run.prepared_case import Outcomes, PreparedCase, prepare
from lammps_cases.run.provenance import engine_record
from lammps_cases.scene.casefile import Case

Judge = Callable[[Case], CaseRecord]  # the ordinary verdict; raises InputError if it is not a scene
CANDIDATES = 3000  # largest number judged


@dataclass(frozen=True)
class Shrunk:
    """A shrunk case: how it fails, its content and sizes, and how many candidates were judged."""

    case: Case
    failure: FailureMode
    content: Content
    before: Size
    after: Size
    candidates: int
    complete: bool
    seconds: float

    @property
    def about(self) -> str:
        """Return the purpose of the small case."""
        return f"Shrunk from {self.case.name} ({self.case.source.name}): {self.failure.words}."

    @property
    def text(self) -> str:
        """Return the case file."""
        return document(self.content, self.case.name, self.about)

    def report(self, file: Path, reproduce: str) -> dict[str, Any]:
        """Return the document that --json prints."""
        return {
            "case": self.case.name,
            "failure": self.failure.document(),
            "before": asdict(self.before),
            "after": asdict(self.after),
            "candidates": self.candidates,
            "complete": self.complete,
            "seconds": round(self.seconds, 1),
            "file": str(file),
            "reproduce": reproduce,
        }


@dataclass
class Trials:
    """Judged candidates, and which fail like ``wanted``; each is judged once, and `CANDIDATES` at most."""

    judge: Judge
    case: Case
    finding: str
    wanted: FailureMode
    whole: Content
    progress: Progress = SILENT
    count: int = 0
    complete: bool = True
    _known: dict[bytes, FailureMode | None] = field(default_factory=dict, repr=False)

    def fails(self, content: Content) -> FailureMode | None:
        """Return how a content fails, if in the same way as the case; None otherwise, or if it is not a scene."""
        key = hashlib.sha256(json.dumps(content).encode()).digest()
        if key not in self._known:
            self._known[key] = self._judged(content)
        return self._known[key]

    def _judged(self, content: Content) -> FailureMode | None:
        candidate = as_case(content, self.case)
        if candidate is None or not self._refused_as_before(content, candidate):
            return None
        if self.count >= CANDIDATES:
            self.complete = False
            return None
        try:
            record = self.judge(candidate)
        except (ValueError, ArithmeticError):  # not a scene: an InputError, or numbers out of all proportion
            return None
        self.count += 1
        self.progress.advance(self.count, CANDIDATES, f"{len(content['positions']['x'])} particles")
        failure = failure_mode(record, self.finding)
        return failure if failure == self.wanted else None

    def _refused_as_before(self, content: Content, candidate: Case) -> bool:
        """Return whether a scene that LAMMPS should refuse should still be refused for the same reason."""
        if self.case.scene.expect is None:
            return True
        if rule := rule_broken(self.case.scene):
            return candidate.scene.expect == self.case.scene.expect and rule_broken(candidate.scene) == rule
        return apart_from_particles(content) == apart_from_particles(self.whole)  # any key may be the reason


def shrink(case: Case, judge: Judge, finding: str = "", progress: Progress = SILENT) -> Shrunk:
    """Return the smallest scene found that fails as a case does, or that shows a finding.

    Raises
    ------
    InputError
        The case is as expected, does not show the finding, or no longer fails with its particles written out.
    """
    begin = time.perf_counter()
    record = judge(case)
    finding = finding or _only_finding(record)
    wanted = failure_mode(record, finding)
    if wanted is None:
        raise InputError("case", _why_not(record, finding), where=case.where)
    content = whole = written_out(case)
    trials = Trials(judge, case, finding, wanted, whole, progress)
    if not trials.fails(content):
        rule = f"no longer fails that way ({wanted.words}) with its particles written out one by one"
        raise InputError("case", rule, where=case.where)
    while True:
        before = content
        for reduction in REDUCTIONS:
            content = reduction(content, trials.fails)
        if content == before:
            break
    seconds = time.perf_counter() - begin
    return Shrunk(case, wanted, content, size(whole), size(content), trials.count, trials.complete, seconds)


def _only_finding(record: CaseRecord) -> str:
    """Return the finding that explains a case, to be preserved if none is named.

    Raises
    ------
    InputError
        Several findings explain it.
    """
    named = record.findings if record.verdict == "explained" else []
    if len(named) > 1:
        raise InputError("case", f"shows several findings: choose one by --finding ({', '.join(named)})", record.case)
    return named[0] if named else ""


def _why_not(record: CaseRecord, finding: str) -> str:
    if finding:
        named = record.findings
        return f"must show {finding} to be shrunk; it is {record.verdict}" + f" by {', '.join(named)}" * bool(named)
    return f"must be red to be shrunk; it is as expected ({record.verdict})"


class WorkerJudge:
    """The ordinary verdict on one case after another; LAMMPS and the judgement share one worker process.

    Raises
    ------
    EngineMissing
    """

    def __init__(self, workers: Workers, engine: Engine) -> None:
        self.workers = workers
        who = workers.outcome(workers.identify())
        if isinstance(who, Failure):
            raise EngineMissing(who.message)
        self.engine: EngineRecord = engine_record(engine, who)

    def __call__(self, case: Case) -> CaseRecord:
        """Return the record of a case; see `lammps_cases.run.flow.judge`."""
        ready = prepare(case)
        return self.judged(ready, self.answers(ready, ready.jobs))

    def answers(self, ready: PreparedCase, jobs: Sequence[Job]) -> Outcomes:
        """Return LAMMPS' answers to the jobs of a case, or how it fails."""
        futures = [self.workers.submit(job, ready.case.scene.engine.time_limit) for job in jobs]
        return outcomes_of(self.workers, futures)

    def judged(self, ready: PreparedCase, outcomes: Outcomes) -> CaseRecord:
        """Return the verdict on the answers."""
        task = self.workers.call(judge, ready, outcomes, self.engine, None, time_limit=JUDGING)
        judged = self.workers.outcome(task)
        return faulty(ready, self.engine, judged) if isinstance(judged, Failure) else judged[0]


def shrink_on(case: Case, engine: Engine, finding: str = "", progress: Progress = SILENT) -> Shrunk:
    """Shrink a case on an engine, in a separate worker; see `shrink`.

    Raises
    ------
    InputError
    EngineMissing
    """
    with Workers(engine.site, 1) as workers:
        return shrink(case, WorkerJudge(workers, engine), finding, progress)


def reproduced_by(shrunk: Shrunk, file: Path, engine: str) -> str:
    """Return the command that runs the small case."""
    return replace(shrunk.case, source=file, shipped=False).reproduce(engine)
