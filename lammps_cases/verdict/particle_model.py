"""A case of the particle model judged: LAMMPS' fields at some steps against the reference, stage by stage.

A field that leaves its bound is held against the ledger: the variants of all findings that the scene shows, together,
have to be inside their bounds on every atom, at every step, in every field.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import Comparison, compare_field, excess, worst_component
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.trajectory import Fields, Prediction, Problem
from lammps_cases.findings import Finding, shown_by
from lammps_cases.findings.variants import Snapshot, Variant, combined
from lammps_cases.records.run_record import Beyond, Blame, StepRecord, Verdict, digest, worst
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import FIELDS, in_step_order
from lammps_cases.verdict.model_mistakes import unseen_in_model


@dataclass(frozen=True)
class ModelVerdict:
    """Comparisons of a case, one per field with its worst step; what explains them; the blame."""

    comparisons: list[Comparison]
    entries: list[Finding]
    unseen: list[Finding]
    first: Blame | None
    lint: list[str]


@dataclass(frozen=True)
class Reason:
    """What leaves its bound first, and what does so beyond the findings that the scene shows."""

    first: Blame
    beyond: Beyond | None


def judge(
    problem: Problem, name: str, id_n: Any, snapshots: Sequence[Snapshot], engine: str, predictor: Predictor
) -> ModelVerdict:
    """Compare all fields at all steps, and explain what is outside by the ledger."""
    random = seed(f"{name}/moved runs")
    prediction = predictor.predict(problem, seed=random)
    table = compare_all(problem, id_n, snapshots, prediction)
    listed = shown_by(problem, engine, "lists" in snapshots[0])
    first = first_outside(problem, table, id_n)
    entries = explain(problem, snapshots, listed, prediction, random, predictor) if first else []
    for comparison in (c for comparisons in table.values() for c in comparisons):
        if entries and comparison.record.verdict == "differs":
            comparison.record.verdict = "explained"
            comparison.record.explained_by = [entry.id for entry in entries]
    others = [entry for entry in listed if entry not in entries] if entries or not first else []
    unseen = [entry for entry in others if would_show(problem, entry, snapshots, prediction, predictor)]
    comparisons = [over_steps(table[field], problem.steps) for field in in_step_order(problem.fields)]
    if problem.steps[0] == 0:
        _add_digits_lost(predictor.precise(problem), table, comparisons)
    lint = _unseen(problem, random, predictor) if problem.steps[0] == 0 else []
    return ModelVerdict(comparisons, entries, unseen, first, lint)


def _unseen(problem: Problem, random: int, predictor: Predictor) -> list[str]:
    """Name the mistakes that a scene cannot tell apart; see `lammps_cases.verdict.model_mistakes`."""
    return predictor.names(
        "unseen", problem, lambda: unseen_in_model(problem, predictor.predict(problem, seed=random)), random
    )


def _add_digits_lost(precise: Fields, table: dict[str, list[Comparison]], comparisons: Sequence[Comparison]) -> None:
    """Digits that each side loses in the first evaluation; not LAMMPS' where it evaluates another formula."""
    for comparison in comparisons:
        first = table[comparison.record.field][0]
        exact = precise[comparison.record.field]
        comparison.record.digits_lost.reference = digits(first.reference_n, exact)
        if first.record.verdict in ("exact", "pass"):
            comparison.record.digits_lost.lammps = digits(first.lammps_n, exact)


def digits(values: FloatArray, exact: Any) -> float:
    """Decimal digits lost by the worst particle: log10 of the error of its row over eps times the size of the row."""
    rows = len(values)
    error_n, size_n = (np.abs(side.reshape(rows, -1)).max(axis=1).astype(float) for side in (values - exact, exact))
    with np.errstate(all="ignore"):
        ratio_n = np.where(error_n == 0, 0.0, error_n / (EPS * size_n))
    return round(min(float(np.log10(max(ratio_n.max(initial=1.0), 1.0))), 99.0), 2)


def reason(
    problem: Problem, name: str, id_n: Any, snapshots: Sequence[Snapshot], engine: str, predictor: Predictor
) -> Reason | None:
    """Find the first step, stage, field and atom that leave the bound, and those that do beyond the findings known."""
    random = seed(f"{name}/moved runs")
    first = first_outside(problem, compare_all(problem, id_n, snapshots, predictor.predict(problem, seed=random)), id_n)
    return Reason(first, beyond(problem, id_n, snapshots, engine, random, predictor)) if first else None


def beyond(
    problem: Problem, id_n: Any, snapshots: Sequence[Snapshot], engine: str, random: int, predictor: Predictor
) -> Beyond | None:
    """Find what leaves the bound although every finding that the scene shows is taken over; None if none is known."""
    listed = shown_by(problem, engine, "lists" in snapshots[0])
    made = combined([entry.model_variant for entry in listed if entry.model_variant], problem, snapshots[0])
    if not listed or made is None:
        return None
    rest = first_outside(problem, compare_all(problem, id_n, snapshots, predictor.predict(problem, made, random)), id_n)
    return Beyond(findings=[entry.id for entry in listed], blame=rest) if rest else None


def compare_all(
    problem: Problem, id_n: Any, snapshots: Sequence[Snapshot], prediction: Prediction
) -> dict[str, list[Comparison]]:
    """One comparison per field and step."""
    table: dict[str, list[Comparison]] = {field: [] for field in problem.fields}
    for at, step in enumerate(problem.steps):
        for field in problem.fields:
            sides = _sides(problem, field, snapshots[at], prediction, at)
            table[field].append(compare_field(field, FIELDS[field].stage, id_n, *sides, None, derived(step)))
    return table


def _sides(
    problem: Problem, field: str, snapshot: Snapshot, prediction: Prediction, at: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A field of LAMMPS, of the reference, and its bound, at one of the steps."""
    lammps_n = np.asarray(snapshot[field], float)
    reference_n = np.asarray(prediction.fields[at][field], float)
    if field == "x":
        lammps_n = nearest_image(problem, lammps_n, reference_n)
    return lammps_n, reference_n, np.broadcast_to(prediction.bounds[at][field], reference_n.shape)


def derived(step: int) -> str:
    """In words, how a bound comes about."""
    one = "4 x 2^-53 per operation, carried through the formulas; a sum by its absolute terms"
    return one if step == 0 else f"{one}; plus the spread of runs moved by that in every one of {step} steps"


def nearest_image(problem: Problem, x_nc: FloatArray, reference_nc: FloatArray) -> FloatArray:
    """Positions moved by whole periods to where the reference, which does not wrap, has them."""
    edge_c = np.array(problem.box.edge_c)
    turns_nc = np.where(problem.box.periodic, np.round((reference_nc - x_nc) / edge_c), 0.0)
    return np.asarray(x_nc + turns_nc * edge_c)


def over_steps(comparisons: Sequence[Comparison], steps: Sequence[int]) -> Comparison:
    """The comparison of the worst step, with the verdicts of all."""
    records = [comparison.record for comparison in comparisons]
    ratios = [-1.0 if r.max_over_bound is None else r.max_over_bound for r in records]
    at = int(np.argmax(ratios))
    rows = [
        StepRecord(
            step=step,
            verdict=r.verdict,
            max_abs=r.max_abs or 0.0,
            max_over_bound=r.max_over_bound or 0.0,
            worst_id=r.worst_id,
            digest=r.digest,
        )
        for step, r in zip(steps, records, strict=True)
    ]
    verdict: Verdict = worst([r.verdict for r in records])
    update = {"steps": rows, "worst_step": steps[at], "verdict": verdict}
    update["digest"] = digest(*(r.digest for r in records))
    picked = comparisons[at]
    if verdict == "explained":
        update["explained_by"] = next(r.explained_by for r in records if r.explained_by)
    record = picked.record.model_copy(update=update)
    return Comparison(record, picked.lammps_n, picked.reference_n, picked.bound_n)


def first_outside(problem: Problem, table: dict[str, list[Comparison]], id_n: Any) -> Blame | None:
    """The first step, then the first field in the order of a step, then the first atom outside the bound."""
    for at, step in enumerate(problem.steps):
        for field in in_step_order(problem.fields):
            comparison = table[field][at]
            record = comparison.record
            if record.verdict != "differs" or record.first_id is None:
                continue
            atom = int(np.searchsorted(id_n, record.first_id))
            one, other, bound = _values(comparison, atom)
            return Blame(
                field=field,
                stage=record.stage,
                step=step,
                atom=record.first_id,
                lammps=one,
                reference=other,
                bound=bound,
                outside=record.outside,
                of=len(id_n),
            )
    return None


def _values(comparison: Comparison, atom: int) -> tuple[float, float, float]:
    """Both sides and the bound of the worst component of an atom."""
    arrays = (comparison.lammps_n, comparison.reference_n, comparison.bound_n)
    ratio_n = excess(*arrays)[1]
    one, other, bound = (float(worst_component(array_n, ratio_n)[atom]) for array_n in arrays)
    return one, other, bound


# --- the ledger


def would_show(
    problem: Problem, entry: Finding, snapshots: Sequence[Snapshot], prediction: Prediction, predictor: Predictor
) -> bool:
    """Whether a finding takes some field of a scene out of the reference's bound."""
    made = combined([entry.model_variant] if entry.model_variant else [], problem, snapshots[0])
    if made is None:
        return False
    shown = predictor.values(problem, made)
    for fields, reference, bounds in zip(shown, prediction.fields, prediction.bounds, strict=True):
        for field in problem.fields:
            shown_n, own_n = np.asarray(fields[field], float), np.asarray(reference[field], float)
            if np.any(excess(shown_n, own_n, np.broadcast_to(bounds[field], own_n.shape))[1] > 1):
                return True
    return False


def explain(
    problem: Problem,
    snapshots: Sequence[Snapshot],
    listed: Sequence[Finding],
    reference: Prediction,
    random: int,
    predictor: Predictor,
) -> list[Finding]:
    """The findings whose variants together are inside the bounds everywhere, without any that is not needed."""

    def inside(entries: Sequence[Finding], of: Problem = problem) -> bool:
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        return bool(variants) and reproduced(of, snapshots, variants, reference, random, predictor)

    needed = list(listed)
    if not inside(needed):
        return []
    first = replace(problem, steps=problem.steps[:1])  # most findings show in the first evaluation, without moved runs
    for entry in listed:
        fewer = [other for other in needed if other is not entry]
        if (problem.steps[0] or inside(fewer, first)) and inside(fewer):
            needed = fewer
    return needed


def reproduced(
    problem: Problem,
    snapshots: Sequence[Snapshot],
    variants: Sequence[Variant],
    reference: Prediction,
    random: int,
    predictor: Predictor,
) -> bool:
    """Whether some variants together reproduce LAMMPS on every atom whose value they define."""
    made = combined(variants, problem, snapshots[0])
    if made is None:
        return False
    try:
        prediction = predictor.predict(problem, made, random)
    except InputError:  # fitted to wrong numbers it runs away, and reproduces nothing
        return False
    undefined = any(variant.undefined for variant in variants)
    for at, field in itertools.product(range(len(problem.steps)), problem.fields):
        sides = _sides(problem, field, snapshots[at], prediction, at)
        if not np.all(excess(*sides)[1] <= 1):
            own_n = np.broadcast_to(reference.bounds[at][field], sides[2].shape)
            if not (undefined and _defined_part_inside(*sides, own_n)):
                return False
    return True


def _defined_part_inside(lammps_n: FloatArray, reference_n: FloatArray, bound_n: FloatArray, own_n: FloatArray) -> bool:
    """Whether all values that have a bound are inside it.

    Only the variant may leave a value without one, not the reference with its bound ``own_n``; and not all of a field.
    """
    defined = np.isfinite(bound_n) | ~np.isfinite(own_n)
    ratio = excess(lammps_n[defined], reference_n[defined], bound_n[defined])[1]
    return bool(defined.any()) and bool(np.all(ratio <= 1))
