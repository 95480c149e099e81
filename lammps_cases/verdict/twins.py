"""Comparison of LAMMPS with itself: two runs that must give the same fields."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.compare import Comparison
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Fields, Prediction
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import Finding
from lammps_cases.findings.variants import Snapshot, combined
from lammps_cases.records.case_parts import worst
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import in_step_order
from lammps_cases.setup.twins import Twin
from lammps_cases.verdict.case_arrays import Arrays, field_arrays, read_snapshots
from lammps_cases.verdict.model_fields import compare_all, first_outside, over_steps
from lammps_cases.verdict.outcome import (
    blank_record,
    finish,
    other_atoms,
    record_failure,
    record_lost_atoms,
)
from lammps_cases.verdict.particle_model import Trial
from lammps_cases.verdict.problems import problem_of


def compare_twin(
    case: Case,
    twin: Twin,
    outcomes: Sequence[Answer | Failure],
    engine: EngineRecord,
    predictor: Predictor | None = None,
) -> tuple[CaseRecord, Arrays]:
    """Judge two runs of LAMMPS that must give the same fields, the original and its twin.

    Return the record and the arrays, as `lammps_cases.verdict.cases.compare_case`.
    """
    begin = time.perf_counter()
    predictor = predictor or Predictor()
    record = blank_record(case, case.scene.eos(case.where), twin.atoms, engine)
    arrays: Arrays = {}
    answers = [outcome for outcome in outcomes if isinstance(outcome, Answer)]
    failures = [outcome for outcome in outcomes if isinstance(outcome, Failure)]
    lost = [ids for answer in answers if (ids := other_atoms(twin.atoms, answer)) is not None]
    if failures:
        record_failure(record, failures[0], case.scene)
        alone = not isinstance(outcomes[1], Answer) and len(failures) == 1
        record.only_twin = alone and record.verdict != "skipped"
    elif lost:
        record_lost_atoms(record, twin.atoms, lost[0])
    else:
        arrays = _compare_twin(record, case, twin, answers, engine.distribution, predictor)
    finish(record, sum(answer.seconds for answer in answers), begin, predictor)
    return record, arrays


@dataclass(frozen=True)
class _Side:
    """One of two runs: the reference's prediction, and LAMMPS' fields at the steps compared."""

    problem: Problem
    prediction: Prediction
    snapshots: list[Snapshot]
    random: int
    spread: tuple[Fields, ...] = ()  # due to rounded input, per step


def _compare_twin(
    record: CaseRecord, case: Case, twin: Twin, answers: Sequence[Answer], engine: str, predictor: Predictor
) -> Arrays:
    one, other = _sides(case, twin, answers, predictor)
    id_n, steps = twin.atoms.id_n, twin.steps
    table = _against(twin, one, other, one.snapshots, other.snapshots)
    for comparison in (c for comparisons in table.values() for c in comparisons):
        comparison.record.stage = "twin"
        own = comparison.record.derivation
        comparison.record.derivation = f"LAMMPS against itself ({twin.kind}): the bounds of both runs, added ({own})"
    first = first_outside(one.problem, table, id_n)
    record.ended, record.blame = "answered", first
    if first and first.bound != math.inf:  # else the reference leaves positions open, and cannot distinguish runs
        _explain_twin(record, twin, one, other, table, engine, predictor)
    comparisons = [over_steps(table[field], steps) for field in in_step_order(one.problem.fields)]
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    return field_arrays(twin.atoms, answers[0].arrays, comparisons, table)


def _sides(case: Case, twin: Twin, answers: Sequence[Answer], predictor: Predictor) -> tuple[_Side, _Side]:
    """Return both runs; if only settings of LAMMPS differ, they share the reference's prediction."""
    sides: list[_Side] = []
    runs = ((twin.scene, twin.atoms), (twin.other_scene, twin.other_atoms))
    for (scene, atoms), answer, name in zip(runs, answers, (case.name, f"{case.name}/twin"), strict=True):
        snapshots = read_snapshots(scene, answer, twin.steps)
        if sides and twin.same_problem:
            problem = replace(sides[0].problem, ranks=scene.engine.ranks, newton=scene.engine.newton_flags)
            sides.append(replace(sides[0], problem=problem, snapshots=snapshots))
            continue
        problem, random = problem_of(scene, atoms, case.where, twin.steps, predictor), seed(f"{name}/moved runs")
        prediction = predictor.predict(problem, seed=random)
        rounds = twin.rounds_input and not sides
        spread = predictor.input_spread(problem, prediction, random) if rounds else ()
        sides.append(_Side(problem, prediction, snapshots, random, tuple(spread)))
    return sides[0], sides[1]


def _against(
    twin: Twin, one: _Side, other: _Side, ours: Sequence[Snapshot], theirs: Sequence[Snapshot]
) -> dict[str, list[Comparison]]:
    """Compare the fields of two runs in the frame of the original.

    Either run lies within its own bound of the exact result, so they differ by no more than the sum of both and the
    effect of rounded input.
    """
    returned, bounds = [], []
    for at, step in enumerate(twin.steps):
        returned.append(twin.back({field: theirs[at][field] for field in one.problem.fields}, step))
        rounding, their_bounds = twin.rounding(returned[at], step), twin.in_place(other.prediction.bounds[at])
        our_bounds = one.prediction.bounds[at]
        spread = one.spread[at] if one.spread else {}
        bounds.append(
            {f: our_bounds[f] + their_bounds[f] + rounding.get(f, 0.0) + spread.get(f, 0.0) for f in our_bounds}
        )
    return compare_all(one.problem, twin.atoms.id_n, ours, Prediction(tuple(returned), tuple(bounds)))


def _explain_twin(
    record: CaseRecord,
    twin: Twin,
    one: _Side,
    other: _Side,
    table: dict[str, list[Comparison]],
    engine: str,
    predictor: Predictor,
) -> None:
    """Explain a difference by the findings that cause it, if findings reproduce both runs."""
    id_n = twin.atoms.id_n
    needed: list[Finding] = []

    def same(ours: Sequence[Snapshot], theirs: Sequence[Snapshot]) -> bool:
        left = first_outside(one.problem, _against(twin, one, other, ours, theirs), id_n)
        return left is None or left.bound == math.inf  # values without a bound distinguish nothing

    if not same(one.prediction.fields, other.prediction.fields):
        record.not_same_problem = True
        return
    for side in (one, other):
        own = compare_all(side.problem, id_n, side.snapshots, side.prediction)
        if outside := first_outside(side.problem, own, id_n):
            trial = Trial(side.problem, side.snapshots, id_n, side.prediction, side.random, predictor)
            found = trial.explain(engine, outside)
            if not found.entries:
                record.beyond = found.beyond
                return
            needed += [entry for entry in found.entries if entry not in needed]
    if not needed:
        return
    breaking = [e for e in needed if not same(*(_with_finding(side, e, predictor) for side in (one, other)))]
    names = [entry.id for entry in breaking or needed]
    for comparison in (c for comparisons in table.values() for c in comparisons):
        if comparison.record.verdict == "differs":
            comparison.record.verdict, comparison.record.explained_by = "explained", names


def _with_finding(side: _Side, entry: Finding, predictor: Predictor) -> list[Snapshot]:
    """Return the reference's fields of a run with only one finding."""
    assert entry.model_variant is not None
    made = combined([entry.model_variant], side.problem, side.snapshots[0])
    return predictor.values(side.problem, made or (ArrayEvaluator, Simulation))
