"""One case compared: LAMMPS' answer against the reference, with the findings that explain what differs.

The input comes first: the input and the state carried over at stops against what LAMMPS holds (stage `input`). Then a
case of laws compares the pressure of LAMMPS' own density and energy; one of the whole model compares every field at
every requested step.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref import EOSTable, InputError
from eos_ref.eos.bounds import EPS
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model
from lammps_cases.comparison.compare import Comparison, EosState, compare_field, compare_pressure
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import Finding, explain_pressure, with_gap
from lammps_cases.records import wording
from lammps_cases.records.case_parts import Beyond, Blame, OtherSteps, worst
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.scene.atoms import Atoms, kernel_cut
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.runs import AS_TEXT, FOR_EACH_ATOM
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.case_arrays import Arrays, field_arrays, read_snapshots
from lammps_cases.verdict.mistakes import undetected_in_laws
from lammps_cases.verdict.model_fields import blame_of
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
from lammps_cases.verdict.problems import TEXT_DIGITS, problem_of, stops_of
from lammps_cases.verdict.runaway import Attempts, diverged, left_open

BY_IMAGES = "; two roundings of place and edge of a particle outside the box; fractions of tilted edges"
LINT_ATOMS = 2000  # a mistake not visible in 2000 evenly spaced states counts as undetected


def compare_model_inputs(
    case: Case, atoms: Atoms, answer: Answer, predictor: Predictor
) -> list[tuple[int, Comparison]]:
    """Compare LAMMPS' state at the beginning and what it carries over at stops, each with its step."""
    scene = case.scene
    through_text = any(stop.step == 0 and stop.digits for stop in stops_of(scene, atoms))
    unchanged = scene.snapshots[0] == 0 and not scene.rheo.interface_reconstruct and not through_text
    held = compare_inputs(case, atoms, answer.snapshots[0], unchanged)
    problem = problem_of(scene, atoms, case.where, scene.snapshots, predictor)
    return [*((0, comparison) for comparison in held), *compare_carried(case, atoms, answer, TEXT_DIGITS, problem)]


def compare_inputs(case: Case, atoms: Atoms, got: Arrays, unchanged: bool) -> list[Comparison]:
    """Compare the input with LAMMPS' state (stage `input`, bound 0), for arrays that have not changed since."""
    zero_n = np.zeros(len(atoms))
    given: Arrays = {"type": atoms.type_n}
    if unchanged and atoms.rho_n is not None and not case.scene.rho_sum:
        given["rho"] = atoms.rho_n
    if unchanged and atoms.energy_n is not None and "esph" in got:
        given["esph"] = atoms.energy_n
    return [
        compare_field(
            wording.given(name) if case.scene.whole_model else name,
            "input",
            got["id"],
            got[name],
            values_n,
            zero_n,
            derivation="the same doubles",
        )
        for name, values_n in given.items()
    ]


def compare_carried(
    case: Case, atoms: Atoms, answer: Answer, digits: int, problem: Problem
) -> list[tuple[int, Comparison]]:
    """Compare the state after every stop with that before it (stage `input`): bit for bit, or to the digits of a text.

    Positions may be those of any image: LAMMPS may move a particle into the box at a stop. Returned with the steps.
    """
    comparisons = []
    scene = case.scene
    stops = scene.evolve.stops if scene.evolve else ()
    for stop, carried in zip(stops, answer.carried, strict=True):
        text = stop.by in AS_TEXT
        half = 0.5 * 10.0 ** (1 - digits) + EPS / 2 if text else 0.0  # and the rounding of reading the text
        derivation = f"half a unit of the {digits}th digit of the text" if text else "the same doubles"
        for name, before_n in carried.before.items():
            if name == "id" or (name == "x" and (stop.displace or stop.stretch)):
                continue
            after_n, why = carried.after[name], derivation
            bound_n = half * np.abs(before_n)
            if name == "rheo_status" and stop.by in FOR_EACH_ATOM:  # set gives only the phase
                before_n, after_n = before_n & 1, after_n & 1
            if name == "x":
                around = problem.box_before(stop.at)
                box = atoms.within(around).box()
                box = replace(box, tilt=box.tilt or (0.0,) * 3) if around.tilt else box
                places = box, before_n, after_n, half, kernel_cut(scene, atoms.spacing)
                after_n, bound_n = _images(*places)
                if scene.dimension == 2:  # a file has 0 where a stretched box has rounded it
                    before_n, after_n, bound_n = before_n[:, :2], after_n[:, :2], bound_n[:, :2]
                why += BY_IMAGES if bound_n.any() and not text else ""
            comparisons.append(
                (
                    stop.at,
                    compare_field(
                        wording.after_stop(name, stop.by, stop.at),
                        "input",
                        atoms.id_n,
                        after_n,
                        before_n,
                        bound_n,
                        derivation=why,
                    ),
                )
            )
    return comparisons


def _images(box: Box, before_nc: Any, after_nc: Any, half: float, reach: float) -> tuple[Any, Any]:
    """Return positions moved to the images that existed before, and the bound of each, both (n, 3).

    A period that is added and subtracted again rounds twice; for tilted edges see `Box.rounding`.
    """
    turned_nc = box.shift(box.periods(before_nc - after_nc))
    left_nc = box.images(before_nc) != 0
    size_nc = np.abs(before_nc) + np.where(left_nc, np.abs(box.cell_cc).sum(axis=0), 0.0)
    bound_nc = (half + EPS * left_nc) * size_nc + box.rounding(reach)
    return np.where(turned_nc != 0, after_nc + turned_nc, after_nc), bound_nc


def first_input_outside(comparisons: Sequence[tuple[int, Comparison]], id_n: Any) -> Blame | None:
    """Return the first of some comparisons, each with its step, that exceeds its bound."""
    outside = (blame_of(comparison, id_n, step) for step, comparison in comparisons if comparison.record.outside)
    return next(outside, None)


def prefer_input(reason: Reason | None, news: Blame | None) -> Reason | None:
    """Return why a case differs, replaced by the first input outside its bound, which no finding explains."""
    if reason is None or news is None:
        return reason if news is None else Reason(news)
    step, left = news.step or 0, reason.beyond
    if step <= (reason.first.step or 0):  # the input comes before the fields computed from it
        return Reason(news)
    if (left is None and not reason.explained) or (left and step > (left.blame.step or 0)):
        return reason
    others = left.findings if left else [entry.id for entry in reason.explained]
    return Reason(reason.first, Beyond(findings=others, blame=news))


def compare_case(
    case: Case,
    eos: EOSTable | None,
    atoms: Atoms,
    outcome: Answer | Failure,
    engine: EngineRecord,
    predictor: Predictor | None = None,
) -> tuple[CaseRecord, Arrays]:
    """Judge how a case ended; return its record and the arrays of ``fields/CASE.npz`` (empty without an answer).

    Without a predictor everything is computed again.
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
        with contextlib.suppress(InputError):  # the reference rejects the particles as they are
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
    """Judge the pressure of LAMMPS' own density and energy, as read by the forces and as output."""
    got = answer.arrays
    unchanged = case.scene.evolve is None and not case.scene.rheo.interface_reconstruct
    comparisons = compare_inputs(case, atoms, got, unchanged=unchanged)
    state = EosState(got["id"], got["type"], got["rho"], atoms.mass_n, got.get("esph"))
    # Twice: the array read by the forces, and the output, which LAMMPS evaluates again from the density.
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
    return undetected_in_laws(eos, thinned, pressure.reference_n[every], pressure.bound_n[every])


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
    record.unseen = [entry.id for entry in judged.unseen if entry.id not in known_limits]  # undecided for known limits
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
    """Return whether a finding reaches the first difference; after a step everything depends on everything."""
    return bool(first.step) or entry.model_variant is None or entry.model_variant.reaches(model, first.field)


def is_nondeterministic(entry: Finding) -> bool:
    """Return whether a variant leaves the values that it cannot predict without a bound, and predicts the others."""
    return entry.model_variant is not None and entry.model_variant.undefined


def first_step(case: Case, atoms: Atoms, answer: Answer, engine: str, predictor: Predictor) -> Reason | None:
    """Find the first difference of a case, in an answer read at every step."""
    scene = case.scene
    snapshots = read_snapshots(scene, answer)
    every = problem_of(scene, atoms, case.where, tuple(range(len(snapshots))))
    reason = particle_model.reason(every, case.name, atoms.id_n, snapshots, engine, predictor)
    return prefer_input(reason, first_input_outside(compare_model_inputs(case, atoms, answer, predictor), atoms.id_n))
