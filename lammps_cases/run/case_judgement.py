"""One case judged: its outcomes, LAMMPS asked again for lists and for the first step outside, faults of the harness."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.comparison.store import Store
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Failure, Workers, solve
from lammps_cases.records import wording
from lammps_cases.records.files import write_arrays
from lammps_cases.records.run_record import CaseRecord, EngineRecord, HarnessError
from lammps_cases.records.stages import stage, taken
from lammps_cases.run.case_journal import CaseJournal
from lammps_cases.run.prepared_case import Outcomes, PreparedCase
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

if TYPE_CHECKING:  # judging is the workers' affair: the main process starts sooner without
    from lammps_cases.comparison.predictor import Predictor
    from lammps_cases.report.drawn import Drawn
    from lammps_cases.run.judged_before import JudgedBefore
    from lammps_cases.verdict.outcome import Arrays
    from lammps_cases.verdict.particle_model import Reason

JUDGING = 1800.0  # seconds that judging a case may take


def judge_into(
    site: str | None,
    folder: Path,
    ready: PreparedCase,
    outcomes: Outcomes,
    engine: EngineRecord,
    store: Store | None,
    judgements: Store | None = None,
) -> tuple[CaseRecord, Drawn | None]:
    """Task: judge a case, write its arrays and its entry in the journal, and take from them what the page shows.

    An answer that was judged before is not judged again; see `lammps_cases.run.judged_before`.
    """
    from lammps_cases.run.judged_before import JudgedBefore, current

    with stage("judged before"):
        looks = judgements and current(judgements)
        before = JudgedBefore.of(judgements, ready, outcomes, engine) if judgements and looks else None
        found = before.find(folder, lambda: listed(site, ready, outcomes, ready.reading_lists)) if before else None
    record, shown = found or _judged_into(site, folder, ready, outcomes, engine, store, before)
    record.seconds.stages = taken()
    CaseJournal(folder).keep(record)
    return record, shown


def _judged_into(
    site: str | None,
    folder: Path,
    ready: PreparedCase,
    outcomes: Outcomes,
    engine: EngineRecord,
    store: Store | None,
    before: JudgedBefore | None,
) -> tuple[CaseRecord, Drawn | None]:
    """Judge a case and write its arrays; what cannot be drawn of them the page tries again, and says why not."""
    from lammps_cases.report.drawn import beside_file, drawn, split

    with stage("comparison"):
        record, arrays, looked = _judgement(site, ready, outcomes, engine, store)
    beside: Arrays = {}
    shown: Drawn | None = None
    with contextlib.suppress(Exception), stage("report"):
        arrays, beside = split(arrays)
        shown = drawn(record, arrays, beside)
    if arrays:
        with stage("writing"):
            write_arrays(folder / "fields" / f"{record.case}.npz", arrays)
            if beside:
                write_arrays(beside_file(folder / "fields", record.case), beside)
        if not record.as_expected and ready.case.scene.whole_model and ready.twin is None:
            from lammps_cases.diagnosis import answers as kept

            assert isinstance(outcomes[0], Answer)
            kept.keep(folder / "fields", record.case, ready.case.scene, outcomes[0])
    with stage("writing"):
        if before and shown and record.as_expected:
            before.keep(folder, record, shown, looked)
    return record, shown


def judge(
    site: str | None, ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, store: Store | None = None
) -> tuple[CaseRecord, Arrays]:
    """Judge a case; a fault of the harness costs its case alone, as one of LAMMPS does."""
    return _judgement(site, ready, outcomes, engine, store)[:2]


def _judgement(
    site: str | None, ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, store: Store | None
) -> tuple[CaseRecord, Arrays, Outcomes]:
    """Judge a case; return what LAMMPS said with its lists, too, if that was judged."""
    from lammps_cases.comparison.prediction_keys import current
    from lammps_cases.comparison.predictor import Predictor
    from lammps_cases.verdict.exercise import exercised
    from lammps_cases.verdict.looks import pair_arrays
    from lammps_cases.verdict.outcome import blank_record, sampled

    predictor = Predictor(store if store and current(store) else None)
    exercises: dict[str, int] = {}
    looked: Outcomes = []
    try:
        with stage("exercises"):
            exercises = exercised(ready.case, ready.atoms, predictor)
        record, arrays = evaluated(ready, outcomes, engine, predictor)
    except Exception as error:
        record, arrays = blank_record(ready.case, ready.eos, ready.atoms, engine), {}
        faulty(record, HarnessError(exception=type(error).__name__, text=str(error)))
    compared = bool(arrays) and ready.case.scene.whole_model
    try:
        if compared and (looked := with_lists(site, ready, outcomes, record)):
            record, arrays = evaluated(ready, looked, engine, predictor)
    except Exception as error:  # lists may decide the verdict: without them there is none
        faulty(record, HarnessError(exception=type(error).__name__, text=f"neighbour lists: {error}"))
    with contextlib.suppress(Exception):  # the verdict stands, whatever becomes of the search for its reason
        searched = compared and record.verdict == "differs" and ready.twin is None
        if searched and (reason := first_step_outside(site, ready, engine.distribution, predictor)):
            record.blame, record.beyond = reason.first, reason.beyond
            record.message = wording.message(record)
    with contextlib.suppress(Exception), stage("pairs"):
        if compared:
            steps = ready.twin.steps if ready.twin else ready.case.scene.snapshots
            arrays |= pair_arrays(record, *ready.sides[0], ready.case.where, steps, predictor)
    record.exercises = exercises
    if record.unexercised:
        record.verdict = "error" if record.as_expected else record.verdict  # a difference comes first
        record.message = wording.message(record)
    return record, sampled(arrays), looked


def evaluated(
    ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, predictor: Predictor
) -> tuple[CaseRecord, Arrays]:
    """Judge the outcomes of a case, or of a twin and its original, without asking LAMMPS again."""
    from lammps_cases.verdict.judgement import evaluate
    from lammps_cases.verdict.twins import evaluate_twin

    if ready.twin is not None:
        return evaluate_twin(ready.case, ready.twin, outcomes, engine, predictor)
    return evaluate(ready.case, ready.eos, ready.atoms, outcomes[0], engine, predictor)


def _explained_blindly(record: CaseRecord) -> bool:
    """Return whether a finding explains a case that would predict more if LAMMPS' lists of neighbours were read."""
    from lammps_cases.findings import LEDGER

    found = set(record.findings)
    variants = (entry.model_variant for entry in LEDGER if entry.id in found)
    return any(variant is not None and variant.lists for variant in variants)


def with_lists(site: str | None, ready: PreparedCase, outcomes: Outcomes, record: CaseRecord) -> Outcomes:
    """Run LAMMPS again for its neighbour lists, read at every step; nothing if they would not change the verdict."""
    from lammps_cases.verdict.model_cases import asks_for_lists

    if record.verdict != "differs" and not _explained_blindly(record):
        return []
    if not any(asks_for_lists(ready.case, scene, atoms) for scene, atoms in ready.sides):
        return []
    return listed(site, ready, outcomes, ready.reading_lists)


def listed(site: str | None, ready: PreparedCase, outcomes: Outcomes, reading: Sequence[Job]) -> Outcomes:
    """Return the outcomes of a case with the lists of the same runs, read at every step; nothing if they are others."""
    reread: Outcomes = []
    for (scene, _), outcome, every_step in zip(ready.sides, outcomes, reading, strict=True):
        if isinstance(outcome, Failure):
            return []
        again = solve(site, every_step)
        compared = zip(scene.snapshots, outcome.snapshots, strict=True)
        if not all(_same(arrays, again.snapshots[step]) for step, arrays in compared):
            return []  # another run than the one judged: its lists say nothing
        reread.append(replace(outcome, lists=again.lists))
    return reread


def _same(arrays: Arrays, others: Arrays) -> bool:
    """Return whether two runs have their particles, of which lists follow, in the same places."""
    return all(arrays[name].tobytes() == others[name].tobytes() for name in ("id", "x"))


def first_step_outside(site: str | None, ready: PreparedCase, engine: str, predictor: Predictor) -> Reason | None:
    """Run a case that differs once more and read every step, to blame the first one."""
    scene = ready.case.scene
    if scene.snapshots[-1] <= 1:
        return None
    from lammps_cases.verdict.model_cases import asks_for_lists, first_step

    lists = asks_for_lists(ready.case, scene, ready.atoms)
    every_step = job(scene, ready.atoms, plan(scene), every_step=True, lists=lists)
    return first_step(ready.case, ready.atoms, solve(site, every_step), engine, predictor)


def answers(workers: Workers, futures: Sequence[Future[Answer]]) -> Outcomes:
    """Wait for the runs of a case."""
    outcomes: Outcomes = []
    for future in futures:
        outcome = workers.outcome(future)
        outcomes.append(outcome)
    return outcomes


def unjudged(ready: PreparedCase, failure: Failure, engine: EngineRecord) -> CaseRecord:
    """Return the record of a case whose judgement failed."""
    from lammps_cases.verdict.outcome import blank_record

    return faulty(blank_record(ready.case, ready.eos, ready.atoms, engine), HarnessError(text=failure.message))


def faulty(record: CaseRecord, fault: HarnessError) -> CaseRecord:
    """Turn the record of a case into that of a fault of the harness."""
    record.verdict, record.ended, record.harness_error = "error", "error", fault
    record.message = wording.message(record)
    return record
