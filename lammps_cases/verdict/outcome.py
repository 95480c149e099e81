"""Records of how cases ended: without numbers, without all atoms, or with fields; the base of every judgement."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping

import numpy as np

from eos_ref import EOSTable
from eos_ref.model.parameters import IntArray
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import explain_outcome
from lammps_cases.records import case_wording, wording
from lammps_cases.records.case_parts import LawRecord, LostAtoms, Predictions, Seconds
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, seed
from lammps_cases.scene.casefile import Case

# LAMMPS' error on a style or keyword that it lacks, and that word
LACKS = re.compile(
    r"(?:Unrecognized|Unknown(?! command)|Illegal|Invalid(?= keyword))\b.*?\b(?:style|keyword|command|option[^,]*)\b"
    r"[:,]? '?(?!keyword|missing)([a-zA-Z][\w/]*)"
)


def blank_record(case: Case, eos: EOSTable | None, atoms: Atoms, engine: EngineRecord) -> CaseRecord:
    """Return the record of a case before it has run."""
    scene = case.scene
    laws = [LawRecord.of(t, law, scene.types[t - 1].mass) for t, law in enumerate(eos.laws if eos else (), 1)]
    return CaseRecord(
        case=case.name,
        tags=list(case.tags),
        about=case.about,
        verdict="skipped",
        ended="skipped",
        natoms=len(atoms),
        steps=scene.evolve.steps if scene.evolve else 0,
        dimension=scene.dimension,
        units=scene.units,
        twin=scene.twin.kind if scene.twin else "",
        expects=scene.expect.refused if scene.expect else "",
        laws=laws,
        seed=seed(case.name),
        source=case.source.name if case.shipped else str(case.source),
        reproduce=case.reproduce(engine.name),
    )


def finish(record: CaseRecord, lammps: float, begin: float, predictor: Predictor) -> None:
    """Complete a record: its message, its times, and how many predictions were computed or read."""
    record.message = case_wording.message(record)
    reference = time.perf_counter() - begin
    record.seconds = Seconds(lammps=lammps, reference=reference, total=lammps + reference)
    record.predictions = Predictions(computed=predictor.computed, stored=predictor.stored)


def record_failure(record: CaseRecord, failure: Failure, scene: Scene | None = None) -> None:
    """Judge a run that LAMMPS refused or did not finish, by what the case expects and by the findings."""
    record.verdict, record.engine_error = failure.verdict, wording.one_line(failure.message)
    record.ended, record.died = failure.verdict, failure.died
    lacks = LACKS.search(case_wording.error_text(failure.message)) if failure.verdict == "refused" else None
    if failure.verdict == "refused" and record.expects and record.expects not in record.engine_error:
        record.verdict = "differs"
    if failure.verdict != "skipped" and (record.verdict != "refused" or not record.expects):
        explain_ending(record, scene)
    if record.verdict == "refused" and not record.expects and lacks:
        record.verdict, record.ended, record.lacks = "skipped", "skipped", lacks[1]


def other_atoms(atoms: Atoms, answer: Answer) -> IntArray | None:
    """Return the ids in the first state of an answer that differ from those given, sorted; None if none does."""
    states = [
        *answer.snapshots,
        *(side for each in answer.carried for side in (each.before, each.after)),
        answer.arrays,
    ]
    ids = (state["id"] for state in states if "id" in state)
    return next((got for got in ids if not np.array_equal(got, atoms.id_n)), None)


def record_lost_atoms(record: CaseRecord, atoms: Atoms, got: IntArray) -> None:
    """Judge an answer in which atoms are missing, doubled or renamed: no other comparison is meaningful."""
    wrong = np.setxor1d(got, atoms.id_n)
    first = wrong[0] if wrong.size else got[np.flatnonzero(np.diff(got) <= 0)[0]]
    record.verdict, record.ended = "differs", "unusable"
    record.unusable = LostAtoms(returned=len(got), given=len(atoms), first_id=int(first))


def explain_ending(record: CaseRecord, scene: Scene | None = None) -> None:
    """Attribute the ending of a case to the finding that predicts it, if there is one."""
    entry = explain_outcome(record, scene)
    if entry is not None:
        record.verdict, record.explained_by = "explained", [entry.id]


def leave_unchecked(record: CaseRecord, reasons: Mapping[str, str]) -> None:
    """Note in a record which fields were not checked, and why: as data and in words."""
    record.unchecked = dict(reasons)
    record.not_checked = [f"{name}: {reason}" for name, reason in reasons.items()]
