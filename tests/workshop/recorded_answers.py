"""LAMMPS' answers to cases that show its findings, against which `make judge` tries mutants that its tests leave alive.

The tests of a mutant run without LAMMPS, where variants of the reference have nothing to reproduce. ``python -m
tests.workshop.recorded_answers ENGINE...`` runs cases in LAMMPS, keeps its answers and the judgements, and lets
mutants judge the same answers. One that gives any other judgement is killed.
"""

from __future__ import annotations

import collections
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

from lammps_cases.comparison.predictor import Made, Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Fields, Prediction
from lammps_cases.engine import installations
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER, accepted_cases
from lammps_cases.records.case_parts import Blame
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.campaign import following
from lammps_cases.run.flow import JUDGING, compared, lists_decide, outcomes_of
from lammps_cases.run.prepared_case import Answers, Outcomes, PreparedCase, prepare
from lammps_cases.run.provenance import engine_record
from lammps_cases.scene import casefile
from tests.workshop import judge

FOLDER, ALIVE, TRY = "answers", "alive.json", "--try"  # in mutmut's copy of the project
ACTIVE = "MUTANT_UNDER_TEST"  # the mutant that mutmut's copy has switched on
MOST = 24  # answers that a mutant judges: those with a finding of its module first, then the quickest
EACH = 8  # answers that show a finding, of an engine
TRIED = 20  # cases that may show it, of many files first

T = TypeVar("T")
Recorded = tuple[PreparedCase, Outcomes, EngineRecord, dict[str, Any]]


def told(record: CaseRecord) -> dict[str, Any]:
    """What a baseline fixes of a run: the verdict, its reasons, and the place of the first difference."""

    def place(blame: Blame | None) -> tuple[Any, ...]:
        return (blame.step, blame.stage, blame.field, blame.worst_id) if blame else ()

    beyond = (record.beyond.findings, place(record.beyond.blame)) if record.beyond else ()
    return {
        "verdict": (record.verdict, record.ended, record.findings, record.unseen),
        "fields": [
            (field.field, field.verdict, field.explained_by, field.outside, field.digest) for field in record.fields
        ],
        "blame": (place(record.blame), beyond),
    }


def judged(ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, predictor: Predictor) -> CaseRecord:
    """A case judged."""
    return compared(ready, outcomes, engine, predictor)[0]


# --- record


def with_its_lists(site: str | None, ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord) -> Outcomes:
    """Task: the answers, with the lists of neighbours if the judge needs them."""
    record, arrays = compared(ready, outcomes, engine, Predictor())
    asked = bool(arrays) and ready.case.scene.whole_model
    return (asked and (lists_decide(ready, record) and Answers(site, ready, outcomes).with_lists())) or outcomes


def candidates(version: str) -> list[str]:
    """Cases that showed a known finding of this version: one of each group, then other ones."""
    names = dict[str, None]()
    for entry in LEDGER:
        if entry.listed(version):
            groups: collections.Counter[str] = collections.Counter()
            order: dict[str, int] = {}
            for name in accepted_cases().get(entry.id, []):
                order[name] = groups[group := name.partition(".")[0]]
                groups[group] += 1
            names |= dict.fromkeys(sorted(order, key=order.__getitem__)[:TRIED])
    return list(names)


def record(name: str, folder: Path) -> None:
    """Run cases on an engine; keep the answers that add to the evidence of its findings."""
    engine = installations.resolve(name)
    shown: collections.Counter[str] = collections.Counter()
    with Workers(engine.site, 1) as workers:
        who = engine_record(engine, workers.outcome(workers.identify()))
        for case in casefile.select(casefile.load(), candidates(who.distribution)):
            ready = following(prepare(case), who.manual)
            assert isinstance(ready, PreparedCase)
            limit = case.scene.engine.time_limit
            outcomes = outcomes_of(workers, [workers.submit(job, limit) for job in ready.jobs])
            outcomes = workers.outcome(workers.call(with_its_lists, ready, outcomes, who, time_limit=JUDGING))
            found = judged(ready, outcomes, who, Predictor())
            if any(shown[finding] < EACH for finding in found.findings):
                shown.update(found.findings)
                (folder / f"{who.distribution} {case.name}").write_bytes(
                    pickle.dumps((ready, outcomes, who, told(found)))
                )
    print(f"{who.distribution}: {len(shown)} findings in {len(list(folder.glob(f'{who.distribution} *')))} answers")


# --- try


class OfReference(Predictor):
    """Predictions of the reference without findings, computed once: no mutant of a finding changes them."""

    def __init__(self) -> None:
        super().__init__()
        self.once: dict[tuple[object, ...], Any] = {}

    def predict(self, problem: Problem, made: Made | None = None, seed: int = 0) -> Prediction:
        """Return fields and bounds."""
        if made is not None:
            return super().predict(problem, made, seed)
        return self._of("prediction", problem, seed, lambda: Predictor.predict(self, problem, seed=seed))

    def precise(self, problem: Problem) -> Fields:
        """Return the fields of the first evaluation in extended precision."""
        return self._of("precise", problem, 0, lambda: Predictor.precise(self, problem))

    def names(self, what: str, problem: Problem, compute: Callable[[], list[str]], seed: int) -> list[str]:
        """Return names that follow from a scene."""
        return self._of(what, problem, seed, compute)

    def _of(self, what: str, problem: Problem, seed: int, compute: Callable[[], T]) -> T:
        key = what, problem.steps, seed  # the problems of a case differ in these
        if key not in self.once:
            self.once[key] = compute()
        made: T = self.once[key]
        return made

    def again(self) -> OfReference:
        """Return a predictor with the same predictions of the reference, and none of findings."""
        other = OfReference()
        other.once = self.once
        return other


@dataclass(frozen=True)
class Test:
    """An answer, the functions that judging it calls by mutmut's names, its findings' modules, and its seconds."""

    recorded: Recorded
    functions: frozenset[str]
    modules: frozenset[str]
    seconds: float
    predictor: OfReference

    @classmethod
    def of(cls, recorded: Recorded) -> Self:
        """Judge an answer as it was judged."""
        from mutmut.mutation import trampoline

        names: set[str] = set()
        vars(trampoline)["record_trampoline_hit"] = lambda name, caller=None: names.add(name)
        os.environ[ACTIVE] = "stats"
        begin, predictor = time.perf_counter(), OfReference()
        record = judged(*recorded[:3], predictor)
        os.environ[ACTIVE] = ""
        assert told(record) == recorded[3]
        parts = [
            part
            for entry in LEDGER
            if entry.id in record.findings
            for part in vars(entry.model_variant or entry).values()
        ]
        modules = frozenset(getattr(part, "__module__", "") for part in parts)
        return cls(recorded, frozenset(names), modules, time.perf_counter() - begin, predictor)

    def same(self, of_finding: bool) -> bool:
        """Return whether the judgement is still the same."""
        predictor = self.predictor.again() if of_finding else Predictor()
        return told(judged(*self.recorded[:3], predictor)) == self.recorded[3]


def tried(mutant: str, tests: Sequence[Test]) -> str:
    """The fate of a mutant, in a separate process."""
    child = os.fork()
    if not child:
        os.environ[ACTIVE] = mutant
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        for test in tests:
            signal.alarm(30 + int(10 * test.seconds))
            try:
                same = test.same(".findings." in mutant)
            except BaseException:
                same = False
            if not same:
                os._exit(1)
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return {0: "survived", -signal.SIGALRM: "timeout"}.get(code, "killed")


def alive() -> None:
    """Try the mutants that are alive, in mutmut's copy; write their fates."""
    answered = [pickle.loads(file.read_bytes()) for file in sorted(Path(FOLDER).iterdir())]
    tests = [Test.of(recorded) for recorded in answered]
    found: dict[str, str] = {}
    for mutant in json.loads(Path(ALIVE).read_text()):
        function = mutant.rpartition("__mutmut_")[0]
        module = function.rpartition(".")[0]
        reach = [test for test in tests if function in test.functions]
        reach.sort(key=lambda test: (module not in test.modules, test.seconds))
        found[mutant] = tried(mutant, reach[:MOST]) if reach else "no tests"
        Path(judge.ANSWERED.name).write_text(json.dumps(found))  # also if it is terminated before
    print(f"{len(found)} mutants alive on {len(tests)} answers: {dict(collections.Counter(found.values()))}")


def main(engines: Sequence[str]) -> int:
    """Record answers of engines, and try the mutants that survived mutmut on them."""
    folder = judge.MUTANTS / FOLDER
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for engine in engines:
        record(engine, folder)
    statuses = judge.statuses(judge.mutmut("results", "--all", "true"))
    left = [mutant for mutant, status in statuses.items() if status not in judge.KILLED]
    (judge.MUTANTS / ALIVE).write_text(json.dumps(left))
    command = [sys.executable, "-m", __spec__.name, TRY]
    there = {**os.environ, "PYTHONPATH": str(judge.MUTANTS.absolute())}
    return subprocess.run(command, cwd=judge.MUTANTS, env=there, check=False).returncode


if __name__ == "__main__":
    from tests.workshop import recorded_answers  # by the name that workers know it by

    if sys.argv[1:] == [TRY]:
        recorded_answers.alive()
    else:
        sys.exit(recorded_answers.main(sys.argv[1:]))
