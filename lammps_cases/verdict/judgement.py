"""Judgement of one case: LAMMPS' answer against the reference, stage by stage."""

from __future__ import annotations

import contextlib
import time

from eos_ref import EOSTable, InputError
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.records.run_record import (
    CaseRecord,
    EngineRecord,
    OtherSteps,
)
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.laws import judge_laws
from lammps_cases.verdict.model_cases import judge_model, problem_of
from lammps_cases.verdict.outcome import (
    Arrays,
    blank_record,
    explain_ending,
    finish,
    judge_failure,
    judge_lost_atoms,
    other_atoms,
)
from lammps_cases.verdict.runaway import Attempts, diverged, left_open


def evaluate(
    case: Case,
    eos: EOSTable | None,
    atoms: Atoms,
    outcome: Answer | Failure,
    engine: EngineRecord,
    predictor: Predictor | None = None,
) -> tuple[CaseRecord, Arrays]:
    """Judge how a case ended; returns its record and the arrays of ``fields/CASE.npz`` (empty without an answer).

    Without a predictor everything is computed anew.
    """
    begin = time.perf_counter()
    predictor = predictor or Predictor()
    record = blank_record(case, eos, atoms, engine)
    arrays: Arrays = {}
    if isinstance(outcome, Failure):
        judge_failure(record, outcome, case.scene)
    elif eos is None:
        record.verdict, record.ended = "differs", "accepted"
        explain_ending(record)
    elif (ids := other_atoms(atoms, outcome)) is not None:
        judge_lost_atoms(record, atoms, ids)
    elif case.scene.whole_model and outcome.steps != case.scene.counts:
        record.verdict, record.ended = "differs", "unusable"
        record.unusable = OtherSteps(counted=list(outcome.steps), asked=list(case.scene.counts))
    elif case.scene.whole_model:
        arrays = judge_model(record, case, atoms, outcome, engine.distribution, predictor)
    else:
        arrays = judge_laws(record, case, eos, atoms, outcome)
    if case.scene.whole_model and diverged(record):
        with contextlib.suppress(InputError):  # the reference does not take the particles as they are
            start = problem_of(case.scene, atoms, case.where, (0,), predictor)
            outlook = Attempts(start, case.scene.snapshots[-1], atoms.id_n).cause(engine.distribution, 1, 0)
            if outlook.cause == "not understood" and (names := left_open(start, engine.distribution)):
                outlook = outlook.model_copy(update={"cause": "findings", "findings": names})
            record.outlook = outlook
            if outlook.findings and record.verdict == "refused":
                record.verdict, record.explained_by = "explained", outlook.findings
    finish(record, outcome.seconds if isinstance(outcome, Answer) else 0.0, begin, predictor)
    return record, arrays
