"""The path of a case, from its file to its record.

1. `lammps_cases.scene.casefile.load`: case files to cases.
2. `lammps_cases.run.prepared_case.prepare`: the input of both sides, particles, laws, and the jobs for LAMMPS.
3. `lammps_cases.run.prepared_case.Answers`: LAMMPS' answers to the jobs, and further ones from running it again.
4. `lammps_cases.comparison.predictor.Predictor`: the reference's fields with their bounds, computed or stored.
5. `lammps_cases.verdict.cases.compare_case`: each field of the answer against the prediction.
6. `lammps_cases.verdict.particle_model.Trial.explain`: the findings that reproduce differences, and the remainder.
7. `record_case`: arrays and record into the folder of the run. All else (pictures, triage, reports) reads these.

A campaign (`lammps_cases.run.campaign`) passes the cases through these steps in its workers.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.store import Store, current
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER
from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import HarnessError
from lammps_cases.records.progress import stage, taken
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.judged import CaseJournal, JudgedBefore
from lammps_cases.run.prepared_case import Answers, Kept, Outcomes, PreparedCase
from lammps_cases.verdict import case_arrays
from lammps_cases.verdict.case_arrays import Arrays, asks_for_lists, pair_arrays, sampled
from lammps_cases.verdict.cases import compare_case, first_step
from lammps_cases.verdict.exercise import exercised
from lammps_cases.verdict.outcome import blank_record
from lammps_cases.verdict.particle_model import Reason
from lammps_cases.verdict.twins import compare_twin

JUDGING = 1800.0  # seconds that judging a case may take


def record_case(
    site: str | None,
    folder: Path,
    ready: PreparedCase,
    kept: Kept,
    engine: EngineRecord,
    store: Store | None = None,
    judgements: Store | None = None,
) -> CaseRecord:
    """Task: judge the answers to a case; write its arrays, then its record into the journal.

    An answer that was judged before is not judged again; see `lammps_cases.run.judged`.
    """
    answers = Answers.read(site, ready, kept)
    with stage("judged before"):
        known = JudgedBefore.of(judgements, answers, engine) if judgements and current(judgements) else None
        record = known.find(folder, answers) if known else None
    if record is None:
        with stage("comparison"):
            record, arrays, listed = _judged(answers, engine, store)
        with stage("writing"):
            if arrays:
                case_arrays.write(folder / "fields", record.case, arrays)
            if arrays and not record.as_expected and ready.case.scene.whole_model and ready.twin is None:
                assert isinstance(answers.outcomes[0], Answer)
                case_arrays.write_steps(folder / "fields", record.case, ready.case.scene, answers.outcomes[0])
            if known and record.as_expected:
                known.keep(folder, record, listed)
    record.seconds.stages = taken()
    CaseJournal(folder).keep(record)
    return record


def judge(
    site: str | None, ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, store: Store | None = None
) -> tuple[CaseRecord, Arrays]:
    """Compare the answers to a case and explain what differs; return its record and arrays, see `case_arrays`.

    A fault of the harness costs only its case, as one of LAMMPS does.
    """
    return _judged(Answers(site, ready, outcomes), engine, store)[:2]


def _judged(answers: Answers, engine: EngineRecord, store: Store | None) -> tuple[CaseRecord, Arrays, Outcomes]:
    """Return the record and arrays of a case, and its outcomes with neighbour lists if these were judged."""
    ready, predictor = answers.ready, Predictor(store if store and current(store) else None)
    exercises: dict[str, int] = {}
    listed: Outcomes = []
    try:
        with stage("exercises"):
            exercises = exercised(ready.case, ready.eos, ready.atoms, predictor)
        record, arrays = compared(ready, answers.outcomes, engine, predictor)
    except Exception as error:
        record, arrays = faulty(ready, engine, error), {}
    if arrays and ready.case.scene.whole_model:
        try:
            if lists_decide(ready, record) and (listed := answers.with_lists()):
                record, arrays = compared(ready, listed, engine, predictor)
        except Exception as error:  # no verdict without the lists
            set_fault(record, error, "neighbour lists: ")
        with contextlib.suppress(Exception):  # the verdict is valid without its first step
            if reason := first_step_outside(answers, record, engine.distribution, predictor):
                record.blame, record.beyond = reason.first, reason.beyond
                record.message = case_wording.message(record)
        with contextlib.suppress(Exception), stage("pairs"):
            steps = ready.twin.steps if ready.twin else ready.case.scene.snapshots
            arrays |= pair_arrays(record, *ready.sides[0], ready.case.where, steps, predictor)
    record.exercises = exercises
    if record.unexercised:
        record.verdict = "error" if record.as_expected else record.verdict  # a difference takes precedence
        record.message = case_wording.message(record)
    return record, sampled(arrays), listed


def compared(
    ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, predictor: Predictor
) -> tuple[CaseRecord, Arrays]:
    """Compare the outcomes of a case, or of a twin and its original, without running LAMMPS again."""
    if ready.twin is not None:
        return compare_twin(ready.case, ready.twin, outcomes, engine, predictor)
    return compare_case(ready.case, ready.eos, ready.atoms, outcomes[0], engine, predictor)


def lists_decide(ready: PreparedCase, record: CaseRecord) -> bool:
    """Return whether LAMMPS' neighbour lists may change the verdict of a case, or predict more of its fields."""
    found = [entry.model_variant for entry in LEDGER if entry.id in record.findings]
    if record.verdict != "differs" and not any(variant is not None and variant.lists for variant in found):
        return False
    return any(asks_for_lists(ready.case, scene, atoms) for scene, atoms in ready.sides)


def first_step_outside(answers: Answers, record: CaseRecord, engine: str, predictor: Predictor) -> Reason | None:
    """Return the first step and field outside the bound of a case that differs; LAMMPS is read at every step."""
    ready, scene = answers.ready, answers.ready.case.scene
    if record.verdict != "differs" or ready.twin is not None or scene.snapshots[-1] <= 1:
        return None
    every_step = answers.at_every_step(asks_for_lists(ready.case, scene, ready.atoms))
    return first_step(ready.case, ready.atoms, every_step, engine, predictor)


def outcomes_of(workers: Workers, futures: Sequence[Future[Any]]) -> Outcomes:
    """Wait for LAMMPS' runs of a case."""
    return [workers.outcome(future) for future in futures]


def faulty(ready: PreparedCase, engine: EngineRecord, fault: Failure | Exception) -> CaseRecord:
    """Return the record of a case whose judgement failed."""
    return set_fault(blank_record(ready.case, ready.eos, ready.atoms, engine), fault)


def set_fault(record: CaseRecord, fault: Failure | Exception, where: str = "") -> CaseRecord:
    """Turn the record of a case into that of a fault of the harness."""
    if isinstance(fault, Failure):
        record.harness_error = HarnessError(text=fault.message)
    else:
        record.harness_error = HarnessError(exception=type(fault).__name__, text=f"{where}{fault}")
    record.verdict = record.ended = "error"
    record.message = case_wording.message(record)
    return record
