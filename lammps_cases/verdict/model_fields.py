"""All fields of the particle model at all steps: LAMMPS against a prediction, and the first one outside its bound."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.model.box import Box
from lammps_cases.comparison.compare import Comparison, compare_field, excess, worst_component
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.findings.variants import Snapshot
from lammps_cases.records.case_parts import Blame, StepRecord, Verdict, digest, worst
from lammps_cases.scene.fields import FIELDS, in_step_order


def compare_all(
    problem: Problem, id_n: Any, snapshots: Sequence[Snapshot], prediction: Prediction
) -> dict[str, list[Comparison]]:
    """Return one comparison per field and step."""
    table: dict[str, list[Comparison]] = {field: [] for field in problem.fields}
    for at, step in enumerate(problem.steps):
        for field in problem.fields:
            both = sides(problem, field, snapshots[at], prediction, at)
            table[field].append(compare_field(field, FIELDS[field].stage, id_n, *both, None, derived(step)))
    return table


def sides(
    problem: Problem, field: str, snapshot: Snapshot, prediction: Prediction, at: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return LAMMPS' field, the reference's field and its bound, at one of the steps."""
    lammps_n, reference_n = snapshot[field], prediction.fields[at][field]
    step = problem.steps[at]
    if field == "x":
        lammps_n = nearest_image(problem.box_of_images(step), lammps_n, reference_n)
    moving_cc = problem.image_velocity(step) if field == "v" else None
    if moving_cc is not None:  # for a particle that has left through a boundary LAMMPS has the image's
        image_nc = problem.box_of_images(step).periods(prediction.fields[at]["x"] - snapshot["x"])
        lammps_n = lammps_n + image_nc @ moving_cc
    return lammps_n, reference_n, np.broadcast_to(prediction.bounds[at][field], reference_n.shape)


def derived(step: int) -> str:
    """Return the derivation of a bound, in words."""
    one = "4 x 2^-53 per operation, carried through the formulas; a sum by its absolute terms"
    return one if step == 0 else f"{one}; plus the spread of runs moved by that in every one of {step} steps"


def nearest_image(box: Box, x_nc: FloatArray, reference_nc: FloatArray) -> FloatArray:
    """Return positions moved by whole periods to where the reference, which does not wrap, has them."""
    return np.asarray(x_nc + box.shift(box.periods(reference_nc - x_nc)))


def over_steps(comparisons: Sequence[Comparison], steps: Sequence[int]) -> Comparison:
    """Return the comparison of the worst step, with the verdicts of all."""
    records = [comparison.record for comparison in comparisons]
    at = int(np.argmax([r.max_over_bound or 0.0 for r in records]))
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
    update = {"steps": rows, "worst_step": steps[at], "digest": digest(*(r.digest for r in records))}
    picked = comparisons[at]
    update["verdict"] = verdict
    if verdict == "explained":
        update["explained_by"] = next(r.explained_by for r in records if r.explained_by)
    record = picked.record.model_copy(update=update)
    return Comparison(record, picked.lammps_n, picked.reference_n, picked.bound_n)


def first_outside(problem: Problem, table: dict[str, list[Comparison]], id_n: Any) -> Blame | None:
    """Return the first step, then the first field in the order of a step, then the first atom outside the bound."""

    def outside(field: str, at: int) -> Blame | None:
        comparison = table[field][at]
        return None if comparison.record.first_id is None else blame_of(comparison, id_n, problem.steps[at])

    return first_left(problem, outside)


def first_left(problem: Problem, outside: Callable[[str, int], Blame | None]) -> Blame | None:
    """Return the first field and step outside its bound, or None; ``outside`` is a function of both.

    Values without a bound are blamed only if all values with one are inside, at all steps.
    """
    without_bound = None
    for at, field in itertools.product(range(len(problem.steps)), in_step_order(problem.fields)):
        left = outside(field, at)
        if left is not None and left.bound != math.inf:
            return left
        without_bound = without_bound or left
    return without_bound


def blame_of(comparison: Comparison, id_n: Any, step: int) -> Blame:
    """Return the first atom of a comparison outside, and both sides and the bound of its worst component.

    Only values with a bound count, if any of them is outside.
    """
    lammps_n, reference_n, bound_n = comparison.lammps_n, comparison.reference_n, comparison.bound_n
    ratio_n = excess(lammps_n, reference_n, bound_n)[1]
    bounded_n = np.isfinite(bound_n)
    if np.any(ratio_n[bounded_n] > 1):
        ratio_n = np.where(bounded_n, ratio_n, 0.0)
    outside = np.flatnonzero((ratio_n.reshape(len(id_n), -1) > 1).any(axis=1))
    atom = outside[np.argmin(id_n[outside])]
    lammps, reference, bound = (
        float(worst_component(side_n, ratio_n)[atom]) for side_n in (lammps_n, reference_n, bound_n)
    )
    return Blame(
        field=comparison.record.field,
        stage=comparison.record.stage,
        step=step,
        atom=int(id_n[atom]),
        lammps=lammps,
        reference=reference,
        bound=bound,
        outside=len(outside),
        of=len(id_n),
    )
