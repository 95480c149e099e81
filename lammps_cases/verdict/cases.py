"""One case compared: LAMMPS' answer against the reference, with the findings that explain what differs.

A case of laws compares the pressure of LAMMPS' own density and energy; one of the whole model compares every field at
every step asked for.
"""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace

import numpy as np

from eos_ref import EOSTable, InputError
from eos_ref.model.parameters import Model
from lammps_cases.comparison.compare import Comparison, EosState, compare_pressure
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import Finding, explain_pressure, with_gap
from lammps_cases.records.case_parts import Blame, OtherSteps, worst
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.case_arrays import Arrays, field_arrays
from lammps_cases.verdict.inputs import compare_inputs, compare_model_inputs, first_input_outside, prefer_input
from lammps_cases.verdict.law_mistakes import unseen
from lammps_cases.verdict.outcome import (
    blank_record,
    explain_ending,
    finish,
    leave_unchecked,
    other_atoms,
    record_failure,
    record_lost_atoms,
)
from lammps_cases.verdict.particle_model import Reason
from lammps_cases.verdict.problems import problem_of
from lammps_cases.verdict.runaway import Attempts, diverged, left_open
from lammps_cases.verdict.snapshots import read_snapshots

LINT_ATOMS = 2000  # a mistake that 2000 evenly spaced states do not show is taken as undetected


def compare_case(
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
        record_failure(record, outcome, case.scene)
    elif eos is None:
        record.verdict, record.ended = "differs", "accepted"
        explain_ending(record)
    elif (ids := other_atoms(atoms, outcome)) is not None:
        record_lost_atoms(record, atoms, ids)
    elif case.scene.whole_model and outcome.steps != case.scene.counts:
        record.verdict, record.ended = "differs", "unusable"
        record.unusable = OtherSteps(counted=list(outcome.steps), asked=list(case.scene.counts))
    elif case.scene.whole_model:
        arrays = compare_model(record, case, atoms, outcome, engine.distribution, predictor)
    else:
        arrays = compare_laws(record, case, eos, atoms, outcome)
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


def compare_laws(record: CaseRecord, case: Case, eos: EOSTable, atoms: Atoms, answer: Answer) -> Arrays:
    """Judge the pressure of LAMMPS' own density and energy, as the forces read it and as it is output."""
    got = answer.arrays
    unchanged = case.scene.evolve is None and not case.scene.rheo.interface_reconstruct
    comparisons = compare_inputs(case, atoms, got, unchanged=unchanged)
    state = EosState(got["id"], got["type"], got["rho"], atoms.mass_n, got.get("esph"))
    # Twice: the array that the forces read, and the output, which LAMMPS evaluates anew from the density.
    used = compare_pressure(eos, state, got["pressure"], "pressure_used", digits=False)
    pressure = compare_pressure(eos, state, got["q.pressure"])
    for comparison in (used, pressure):
        if comparison.record.verdict == "differs":
            entry = explain_pressure(case.name, eos, state, comparison)
            if entry is not None:
                comparison.record.verdict, comparison.record.explained_by = "explained", [entry.id]
    comparisons += [used, pressure]
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    record.ended, record.blame = "answered", _blame(comparisons, state)
    record.lint = _lint(eos, state, pressure)
    arrays = field_arrays(atoms, got, comparisons)
    if state.e_n is not None:
        arrays["e"] = state.e_n
    return arrays


def _blame(comparisons: list[Comparison], state: EosState) -> Blame | None:
    """Return the first stage, field and atom outside the bound, with the numbers."""
    for comparison in comparisons:
        record = comparison.record
        if record.first_id is None:
            continue
        at = int(np.searchsorted(state.id_n, record.first_id))
        return Blame(
            field=record.field,
            stage=record.stage,
            atom=record.first_id,
            type=int(state.type_n[at]),
            rho=float(state.rho_n[at]),
            lammps=float(comparison.lammps_n[at]),
            reference=float(comparison.reference_n[at]),
            bound=float(comparison.bound_n[at]),
            outside=record.outside,
            of=len(state.id_n),
        )
    return None


def _lint(eos: EOSTable, state: EosState, pressure: Comparison) -> list[str]:
    every = slice(None, None, max(1, len(state.id_n) // LINT_ATOMS))
    thinned = replace(state, **{name: side_n[every] for name, side_n in vars(state).items() if side_n is not None})
    return unseen(eos, thinned, pressure.reference_n[every], pressure.bound_n[every])


def compare_model(
    record: CaseRecord, case: Case, atoms: Atoms, answer: Answer, engine: str, predictor: Predictor
) -> Arrays:
    """Judge the fields of the whole model, and the input that LAMMPS has not changed since."""
    scene = case.scene
    problem = problem_of(scene, atoms, case.where, scene.snapshots, predictor)
    inputs = compare_model_inputs(case, atoms, answer, predictor)
    judged = particle_model.compare_and_explain(
        problem,
        case.name,
        atoms.id_n,
        read_snapshots(scene, answer),
        engine,
        predictor,
    )
    comparisons = [*(comparison for _, comparison in inputs), *judged.comparisons]
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    first = judged.beyond.blame if judged.beyond else judged.first
    gaps = [entry for entry in with_gap(scene, engine) if first is None or _reaches(entry, problem.model, first)]
    known_limits = [entry.id for entry in gaps if not is_nondeterministic(entry)]
    record.unseen = [entry.id for entry in judged.unseen if entry.id not in known_limits]  # else nothing tells
    record.limits = known_limits if record.verdict == "differs" else []
    record.lint = judged.lint
    leave_unchecked(record, judged.unpredictable)
    record.ended = "answered"
    reason = Reason(judged.first, judged.beyond, judged.entries) if judged.first else None
    if reason := prefer_input(reason, first_input_outside(inputs, atoms.id_n)):
        record.blame, record.beyond = reason.first, reason.beyond
    in_box = atoms.within(problem.box_at(scene.snapshots[-1]))
    return field_arrays(in_box, answer.arrays, comparisons, judged.table)


def _reaches(entry: Finding, model: Model, first: Blame) -> bool:
    """Return whether a finding reaches what LAMMPS differs in first; after a step all depends on all."""
    return bool(first.step) or entry.model_variant is None or entry.model_variant.reaches(model, first.field)


def is_nondeterministic(entry: Finding) -> bool:
    """Return whether a variant leaves the values that it cannot tell without a bound: the others it does tell."""
    return entry.model_variant is not None and entry.model_variant.undefined


def first_step(case: Case, atoms: Atoms, answer: Answer, engine: str, predictor: Predictor) -> Reason | None:
    """Find the first difference of a case, in an answer read at every step."""
    scene = case.scene
    snapshots = read_snapshots(scene, answer)
    every = problem_of(scene, atoms, case.where, tuple(range(len(snapshots))))
    reason = particle_model.reason(every, case.name, atoms.id_n, snapshots, engine, predictor)
    return prefer_input(reason, first_input_outside(compare_model_inputs(case, atoms, answer, predictor), atoms.id_n))
