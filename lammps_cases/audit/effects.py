"""What the findings of an engine do to a deck: the fields of one sample with and without each of them.

They are computed from the model of the deck alone, also where LAMMPS' own field cannot be compared because other styles
add to it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.quantities import needed_to_step
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.lints import FEW, MOST
from lammps_cases.findings import Finding, applicable
from lammps_cases.records.case_parts import EffectRecord
from lammps_cases.verdict import runaway

NOTHING: Mapping[str, SampleEvaluation] = {}
MULTIPLE = 0.01  # part of the largest value by which a field may differ from a multiple of the right one


def touching(sample: ParticleSample, engine: str) -> list[Finding]:
    """Return the findings of an engine that can make a difference to a sample, by one evaluation of it."""
    return runaway.touching(sample.problem(needed_to_step(sample.model)), engine)


def of_pressure(sample: ParticleSample, engine: str) -> list[str]:
    """Return the findings of an engine that can change what LAMMPS prints as the pressure of the system."""
    return [entry.id for entry in applicable(sample.problem(("press",)), lists=True) if entry.listed(engine)]


def effects(
    sample: ParticleSample,
    engine: str,
    run: int,
    step: int,
    evaluated: Mapping[str, SampleEvaluation] = NOTHING,
    seen: Collection[str] = (),
) -> list[EffectRecord]:
    """Return what each finding of an engine changes in the fields that a step of the sample's model needs.

    Gravity, which would hide changes of pair forces, is left out. Of many particles those around the likeliest to run
    away are looked at. Changes inside the bounds are left out but for findings that were ``seen`` to explain LAMMPS'
    fields.

    Parameters
    ----------
    evaluated : what the sample was evaluated by already: findings by id, the reference by no name
    """
    variants = [(entry.id, v) for entry in touching(sample, engine) if (v := entry.model_variant) and v.stages]
    reached = {name: [f for f in needed_to_step(sample.model) if v.reaches(sample.model, f)] for name, v in variants}
    fields = list(dict.fromkeys(field for of in reached.values() for field in of))
    if not fields:
        return []
    judged_n = np.ones(len(sample.mass_n), bool)
    if len(judged_n) > MOST:
        force_nc = value(evaluated[""].of_pairs) if "" in evaluated else None
        problem = sample.problem(tuple(fields))
        part = runaway.cut_out(problem, runaway.likeliest(problem, force_nc), FEW)
        sample, judged_n, evaluated = sample.of(part.rows_k), ~part.held_k, {}

    def evaluation(name: str, wanted: Sequence[str], stages: type[ArrayEvaluator]) -> SampleEvaluation:
        made = evaluated.get(name)
        return made if made and {*wanted} <= {*made.simulation.plan} else SampleEvaluation(sample, wanted, stages)

    right, records = evaluation("", fields, ArrayEvaluator), []
    for finding, variant in variants:
        wrong = evaluation(finding, reached[finding], variant.stages or ArrayEvaluator)
        for field in reached[finding]:
            sides = [by.own(field) for by in (right, wrong)]
            a, b = (np.asarray(value(side), float)[judged_n] for side in sides)
            bound = (np.asarray(error(sides[0]), float) + np.asarray(error(sides[1]), float))[judged_n]
            if effect := compare(a, b, bound) or (compare(a, b, 0 * bound) if finding in seen else None):
                particles, relative, factor = effect
                records.append(
                    EffectRecord(
                        finding=finding, field=field, run=run, step=step,
                        particles=particles, of=len(a), relative=relative, factor=factor,
                    )
                )  # fmt: skip
    return records


def compare(right: FloatArray, wrong: FloatArray, bound: FloatArray) -> tuple[int, float | None, float | None] | None:
    """Compare a field, (n, ...), with what a finding makes of it.

    Returns
    -------
    The number of particles outside the bound; the largest difference over the largest right value, None if the right
    values are 0; the factor, if the wrong field is a multiple of the right one. None if nothing is outside.
    """
    difference = np.abs(wrong - right)
    outside_n = (difference > bound).reshape(len(right), -1).any(axis=1)
    if not outside_n.any():
        return None
    size, finite = float(np.abs(right).max()), bool(np.isfinite(wrong).all() and np.isfinite(right).all())
    if not size or not finite:
        return int(outside_n.sum()), None, None
    factor = float((right * wrong).sum() / (right * right).sum())
    is_multiple = np.abs(wrong - factor * right).max() <= MULTIPLE * np.abs(wrong).max()
    return int(outside_n.sum()), float(difference.max()) / size, factor if is_multiple else None


def worst(known: Sequence[EffectRecord], more: Sequence[EffectRecord]) -> list[EffectRecord]:
    """Return, of every finding and field, the effect that is largest."""

    def size(effect: EffectRecord) -> float:
        return effect.relative or 0.0

    kept: dict[tuple[str, str], EffectRecord] = {}
    for effect in (*known, *more):
        key = (effect.finding, effect.field)
        if key not in kept or size(effect) > size(kept[key]):
            kept[key] = effect
    return list(kept.values())
