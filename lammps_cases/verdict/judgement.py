"""One case judged: LAMMPS' answer against the reference, stage by stage."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref import EOSTable
from eos_ref.evaluation.array_evaluator import Plain
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.compare import Comparison, EosState, compare_field, compare_pressure
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.trajectory import Prediction, Problem
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import Finding, explain_outcome, explain_pressure, shown_by
from lammps_cases.findings.neighbour_lists import Listed
from lammps_cases.findings.variants import Snapshot, combined
from lammps_cases.records import wording
from lammps_cases.records.run_record import (
    Blame,
    CaseRecord,
    EngineRecord,
    LawRecord,
    LostAtoms,
    OtherSteps,
    Predictions,
    Seconds,
    worst,
)
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, seed
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import FIELDS, in_step_order
from lammps_cases.setup import reference_side
from lammps_cases.setup.twins import Twin
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.law_mistakes import unseen
from lammps_cases.verdict.particle_model import Reason

Arrays = dict[str, Any]
LINT_ATOMS = 2000  # a mistake that 2000 evenly spaced states do not show is taken as unseen


def blank_record(case: Case, eos: EOSTable | None, atoms: Atoms, engine: EngineRecord) -> CaseRecord:
    """What is known of a case before it ran."""
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
        _judge_failure(record, outcome, engine.distribution)
    elif eos is None:
        record.verdict, record.ended = "differs", "accepted"
        _explain_outcome(record, engine.distribution)
    elif not np.array_equal(outcome.arrays["id"], atoms.id_n):
        _judge_lost_atoms(record, atoms, outcome)
    elif case.scene.whole_model and outcome.steps != case.scene.snapshots:
        record.verdict, record.ended = "differs", "unusable"
        record.unusable = OtherSteps(counted=list(outcome.steps), asked=list(case.scene.snapshots))
    elif case.scene.whole_model:
        arrays = _judge_particles(record, case, atoms, outcome, engine.distribution, predictor)
    else:
        arrays = _judge_fields(record, case, eos, atoms, outcome, engine.distribution)
    _finish(record, outcome.seconds if isinstance(outcome, Answer) else 0.0, begin, predictor)
    return record, arrays


def _finish(record: CaseRecord, lammps: float, begin: float, predictor: Predictor) -> None:
    """Note what a case cost, and whether the reference's side of it was known; and say what happened."""
    record.message = wording.message(record)
    reference = time.perf_counter() - begin
    record.seconds = Seconds(lammps=lammps, reference=reference, total=lammps + reference)
    record.predictions = Predictions(computed=predictor.computed, stored=predictor.stored)


def _judge_failure(record: CaseRecord, failure: Failure, engine: str) -> None:
    record.verdict, record.engine_error = failure.verdict, wording.one_line(failure.message)
    record.ended = failure.verdict
    if failure.verdict == "refused" and record.expects and record.expects not in record.engine_error:
        record.verdict = "differs"
    if record.verdict != "refused" or not record.expects:
        _explain_outcome(record, engine)


def _judge_lost_atoms(record: CaseRecord, atoms: Atoms, answer: Answer) -> None:
    """Atoms that are missing, doubled or renamed make any other comparison meaningless."""
    got = answer.arrays["id"]
    wrong = np.setxor1d(got, atoms.id_n)
    first = wrong[0] if wrong.size else got[np.flatnonzero(np.diff(got) <= 0)[0]]
    record.verdict, record.ended = "differs", "unusable"
    record.unusable = LostAtoms(returned=len(got), given=len(atoms), first_id=int(first))


def _explain_outcome(record: CaseRecord, engine: str) -> None:
    entry = explain_outcome(record, engine)
    if entry is not None:
        record.verdict, record.explained_by = "explained", [entry.id]


def _judge_fields(record: CaseRecord, case: Case, eos: EOSTable, atoms: Atoms, answer: Answer, engine: str) -> Arrays:
    got = answer.arrays
    comparisons = _inputs(case, atoms, got, unchanged=case.scene.evolve is None)
    state = EosState(got["id"], got["type"], got["rho"], atoms.mass_n, got.get("esph"))
    # Twice: the array that the forces read, and the output, which LAMMPS evaluates anew from the density.
    used = compare_pressure(eos, state, got["pressure"], "pressure_used", digits=False)
    pressure = compare_pressure(eos, state, got["q.pressure"])
    for comparison in (used, pressure):
        if comparison.record.verdict == "differs":
            entry = explain_pressure(case.name, engine, eos, state, comparison)
            if entry is not None:
                comparison.record.verdict, comparison.record.explained_by = "explained", [entry.id]
    comparisons += [used, pressure]
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    record.ended, record.blame = "answered", _blame(comparisons, state)
    record.lint = _lint(eos, state, pressure)
    arrays = _arrays(atoms, got, comparisons)
    if state.e_n is not None:
        arrays["e"] = state.e_n
    return arrays


def _arrays(atoms: Atoms, got: Arrays, comparisons: list[Comparison]) -> Arrays:
    arrays: Arrays = {"id": got["id"], "type": got["type"], "x": got["x"], "rho": got["rho"]}
    arrays["box"] = np.stack([atoms.low_c, atoms.high_c])
    for comparison in comparisons:
        name = comparison.record.field
        arrays[f"{name}.lammps"] = comparison.lammps_n
        arrays[f"{name}.reference"] = comparison.reference_n
        arrays[f"{name}.bound"] = comparison.bound_n
    return arrays


def _judge_particles(
    record: CaseRecord, case: Case, atoms: Atoms, answer: Answer, engine: str, predictor: Predictor
) -> Arrays:
    scene = case.scene
    first = answer.snapshots[0]
    comparisons = _inputs(
        case, atoms, first, unchanged=scene.snapshots[0] == 0 and not scene.rheo.interface_reconstruct
    )
    judged = particle_model.judge(
        particles_of(scene, atoms, case.where, scene.snapshots),
        case.name,
        atoms.id_n,
        _snapshots(scene, answer),
        engine,
        predictor,
    )
    comparisons += judged.comparisons
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    record.unseen = [entry.id for entry in judged.unseen]
    record.lint = judged.lint
    record.ended, record.blame = "answered", judged.first
    return _arrays(atoms, answer.arrays, comparisons)


def particles_of(scene: Scene, atoms: Atoms, where: str, steps: tuple[int, ...]) -> Problem:
    """The scene as the reference takes it, to be compared at some steps."""
    return Problem(
        reference_side.model(scene, atoms, where),
        reference_side.box(scene, atoms),
        reference_side.state(scene, atoms, where),
        scene.evolve.timestep if scene.evolve else 0.0,
        scene.compare,
        steps,
    )


def snapshot(scene: Scene, arrays: Arrays) -> Snapshot:
    """LAMMPS' fields of one step by the names of the scene, vectors with as many axes as dimensions."""
    return {name: FIELDS[name].of(arrays, scene.dimension) for name in scene.compare}


def _snapshots(scene: Scene, answer: Answer, steps: Sequence[int] = ()) -> list[Snapshot]:
    """LAMMPS' fields at the readings, or at some of the steps compared; with the first its lists of neighbours."""
    at = [scene.snapshots.index(step) for step in steps] or range(len(answer.snapshots))
    found = [snapshot(scene, answer.snapshots[k]) for k in at]
    if answer.lists:
        found[0]["lists"] = tuple(Listed(**arrays) for arrays in answer.lists)
    return found


def asks_for_lists(case: Case, scene: Scene, atoms: Atoms, engine: str) -> bool:
    """Whether a scene shows findings that follow LAMMPS' lists of neighbours."""
    problem = particles_of(scene, atoms, case.where, scene.snapshots)
    return shown_by(problem, engine, lists=True) != shown_by(problem, engine)


# --- LAMMPS against itself


def evaluate_twin(
    case: Case,
    twin: Twin,
    outcomes: Sequence[Answer | Failure],
    engine: EngineRecord,
    predictor: Predictor | None = None,
) -> tuple[CaseRecord, Arrays]:
    """Judge two runs of LAMMPS that must give the same, the original's and the twin's; see `evaluate`."""
    begin = time.perf_counter()
    predictor = predictor or Predictor()
    record = blank_record(case, case.scene.eos(case.where), twin.atoms, engine)
    arrays: Arrays = {}
    answers = [outcome for outcome in outcomes if isinstance(outcome, Answer)]
    failures = [outcome for outcome in outcomes if isinstance(outcome, Failure)]
    lost = [answer for answer in answers if not np.array_equal(answer.arrays["id"], twin.atoms.id_n)]
    if failures:
        _judge_failure(record, failures[0], engine.distribution)
        record.only_twin = not isinstance(outcomes[1], Answer) and len(failures) == 1
    elif lost:
        _judge_lost_atoms(record, twin.atoms, lost[0])
    else:
        arrays = _judge_twin(record, case, twin, answers, engine.distribution, predictor)
    _finish(record, sum(answer.seconds for answer in answers), begin, predictor)
    return record, arrays


@dataclass(frozen=True)
class _Side:
    """One of two runs: what the reference predicts, and LAMMPS' fields at the steps compared."""

    problem: Problem
    prediction: Prediction
    snapshots: list[Snapshot]
    random: int


def _judge_twin(
    record: CaseRecord, case: Case, twin: Twin, answers: Sequence[Answer], engine: str, predictor: Predictor
) -> Arrays:
    one, other = _sides(case, twin, answers, predictor)
    id_n, steps = twin.atoms.id_n, twin.steps
    table = _against(twin, one, other, one.snapshots, other.snapshots)
    for comparison in (c for comparisons in table.values() for c in comparisons):
        comparison.record.stage = "twin"
        own = comparison.record.derivation
        comparison.record.derivation = f"LAMMPS against itself ({twin.kind}): the bounds of both runs, added ({own})"
    first = particle_model.first_outside(one.problem, table, id_n)
    record.ended, record.blame = "answered", first
    if first:
        _explain_twin(record, twin, one, other, table, engine, predictor)
    comparisons = [particle_model.over_steps(table[field], steps) for field in in_step_order(one.problem.fields)]
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    return _arrays(twin.atoms, answers[0].arrays, comparisons)


def _sides(case: Case, twin: Twin, answers: Sequence[Answer], predictor: Predictor) -> tuple[_Side, _Side]:
    """Both runs; where only LAMMPS' settings differ, the reference's prediction is one and the same."""
    sides: list[_Side] = []
    told = ((twin.scene, twin.atoms), (twin.other_scene, twin.other_atoms))
    for (scene, atoms), answer, name in zip(told, answers, (case.name, f"{case.name}/twin"), strict=True):
        snapshots = _snapshots(scene, answer, twin.steps)
        if sides and twin.same_problem:
            sides.append(replace(sides[0], snapshots=snapshots))
            continue
        problem, random = particles_of(scene, atoms, case.where, twin.steps), seed(f"{name}/moved runs")
        sides.append(_Side(problem, predictor.predict(problem, seed=random), snapshots, random))
    return sides[0], sides[1]


def _against(
    twin: Twin, one: _Side, other: _Side, ours: Sequence[Snapshot], theirs: Sequence[Snapshot]
) -> dict[str, list[Comparison]]:
    """Fields of two runs compared in the frame of the original.

    Either run lies within its own bound of the exact result, so they differ by no more than the sum.
    """
    returned, bounds = [], []
    for at, step in enumerate(twin.steps):
        returned.append(twin.back({field: theirs[at][field] for field in one.problem.fields}, step))
        rounding, their_bounds = twin.rounding(returned[at], step), twin.in_place(other.prediction.bounds[at])
        our_bounds = one.prediction.bounds[at]
        bounds.append({f: our_bounds[f] + their_bounds[f] + rounding.get(f, 0.0) for f in our_bounds})
    return particle_model.compare_all(one.problem, twin.atoms.id_n, ours, Prediction(tuple(returned), tuple(bounds)))


def _explain_twin(
    record: CaseRecord,
    twin: Twin,
    one: _Side,
    other: _Side,
    table: dict[str, list[Comparison]],
    engine: str,
    predictor: Predictor,
) -> None:
    """Explain a difference by the findings that make it, if findings reproduce both runs."""
    id_n = twin.atoms.id_n
    needed: list[Finding] = []

    def same(ours: Sequence[Snapshot], theirs: Sequence[Snapshot]) -> bool:
        return particle_model.first_outside(one.problem, _against(twin, one, other, ours, theirs), id_n) is None

    if not same(one.prediction.fields, other.prediction.fields):
        record.not_same_problem = True
        return
    for side in (one, other):
        own = particle_model.compare_all(side.problem, id_n, side.snapshots, side.prediction)
        if particle_model.first_outside(side.problem, own, id_n):
            listed = shown_by(side.problem, engine, "lists" in side.snapshots[0])
            given = (side.problem, side.snapshots, listed, side.prediction, side.random, predictor)
            found = particle_model.explain(*given)
            if not found:
                return
            needed += [entry for entry in found if entry not in needed]
    if not needed:
        return
    breaking = [e for e in needed if not same(*(_with_finding(side, e, predictor) for side in (one, other)))]
    names = [entry.id for entry in breaking or needed]
    for comparison in (c for comparisons in table.values() for c in comparisons):
        if comparison.record.verdict == "differs":
            comparison.record.verdict, comparison.record.explained_by = "explained", names


def _with_finding(side: _Side, entry: Finding, predictor: Predictor) -> list[Snapshot]:
    """The reference's fields of a run with one finding alone."""
    assert entry.model_variant is not None
    made = combined([entry.model_variant], side.problem, side.snapshots[0])
    return predictor.values(side.problem, made or (Plain, Simulation))


def first_step(case: Case, atoms: Atoms, answer: Answer, engine: str, predictor: Predictor) -> Reason | None:
    """Find what a case that differs does wrong first, in an answer with every single step."""
    scene = case.scene
    snapshots = _snapshots(scene, answer)
    every = particles_of(scene, atoms, case.where, tuple(range(len(snapshots))))
    return particle_model.reason(every, case.name, atoms.id_n, snapshots, engine, predictor)


def _inputs(case: Case, atoms: Atoms, got: Arrays, unchanged: bool) -> list[Comparison]:
    """Stage `input`: does LAMMPS hold the doubles it was given? (bound 0; only for what was not changed since)"""
    zero_n = np.zeros(len(atoms))
    given = {"type": atoms.type_n.astype(float)}
    if unchanged and atoms.rho_n is not None and not case.scene.rho_sum:
        given["rho"] = atoms.rho_n
    if unchanged and atoms.energy_n is not None and "esph" in got:
        given["esph"] = atoms.energy_n
    return [
        compare_field(
            f"{name} (given)" if case.scene.whole_model else name,
            "input",
            got["id"],
            got[name].astype(float),
            values_n,
            zero_n,
            derivation="the same doubles",
        )
        for name, values_n in given.items()
    ]


def _blame(comparisons: list[Comparison], state: EosState) -> Blame | None:
    """The first stage, field and atom that leave the bound, with the numbers."""
    for comparison in comparisons:
        record = comparison.record
        if record.verdict not in ("differs", "explained") or record.first_id is None:
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
    energy_n = None if state.energy_n is None else state.energy_n[every]
    thinned = EosState(state.id_n[every], state.type_n[every], state.rho_n[every], state.mass_n[every], energy_n)
    return unseen(eos, thinned, pressure.reference_n[every], pressure.bound_n[every])
