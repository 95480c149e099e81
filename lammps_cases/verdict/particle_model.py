"""A case of the particle model judged: LAMMPS' fields at some steps against the reference, stage by stage.

A field that leaves its bound is held against the ledger: the variants of some findings, together, have to be inside
their bounds on every atom, at every step, in every field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import Comparison, components
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Fields
from lammps_cases.findings import Finding
from lammps_cases.findings.variants import Snapshot
from lammps_cases.records.case_parts import Beyond, Blame
from lammps_cases.records.progress import stage
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import in_step_order
from lammps_cases.verdict.explanation import Explanation, Trial
from lammps_cases.verdict.model_fields import compare_all, first_outside, over_steps
from lammps_cases.verdict.model_mistakes import unseen_in_model


@dataclass(frozen=True)
class ModelVerdict:
    """Comparisons of a case, one per field with its worst step; what explains them; the blame, and what is left.

    ``table`` has the comparisons of all steps; ``unpredictable`` why some of them say nothing, by field.
    """

    comparisons: list[Comparison]
    entries: list[Finding]
    unseen: list[Finding]
    first: Blame | None
    beyond: Beyond | None
    lint: list[str]
    table: dict[str, list[Comparison]]
    unpredictable: dict[str, str]


@dataclass(frozen=True)
class Reason:
    """What leaves its bound first, what does so beyond the findings that the scene shows, and what explains all."""

    first: Blame
    beyond: Beyond | None = None
    explained: list[Finding] = field(default_factory=list)


def compare_and_explain(
    problem: Problem, name: str, id_n: Any, snapshots: Sequence[Snapshot], engine: str, predictor: Predictor
) -> ModelVerdict:
    """Compare all fields at all steps, and explain what is outside by the ledger."""
    random = seed(f"{name}/moved runs")
    with stage("reference"):
        prediction = predictor.predict(problem, seed=random)
    table = compare_all(problem, id_n, snapshots, prediction)
    first = first_outside(problem, table, id_n)
    trial = Trial(problem, snapshots, id_n, prediction, random, predictor)
    with stage("variants"):
        explanation = trial.explain(engine, first) if first else Explanation([])
    entries = explanation.entries
    for comparison in (c for comparisons in table.values() for c in comparisons):
        if entries and comparison.record.verdict == "differs":
            comparison.record.verdict = "explained"
            comparison.record.explained_by = [entry.id for entry in entries]
    others = [entry for entry in trial.listed(engine) if not _contained(entry, entries)] if entries or not first else []
    with stage("variants"):
        unseen = [entry for entry in others if trial.shows(entry)]
    comparisons = [over_steps(table[field], problem.steps) for field in in_step_order(problem.fields)]
    with stage("digits"):
        if problem.steps[0] == 0:
            _add_digits_lost(predictor.precise(problem), table, comparisons)
    with stage("mistakes"):
        lint = _unseen(problem, random, predictor) if problem.steps[0] == 0 else []
    open_ = trial.unpredictable(entries)
    return ModelVerdict(comparisons, entries, unseen, first, explanation.beyond, lint, table, open_)


def _contained(entry: Finding, entries: Sequence[Finding]) -> bool:
    """Return whether a finding is one of several, or what one of them builds on."""
    own = entry.model_variant
    variants = [other.model_variant for other in entries if other.model_variant]
    return entry in entries or (own is not None and any(own.within(variant) for variant in variants))


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
    error_n, size_n = (np.abs(components(side)).max(axis=1) for side in (values - exact, exact))
    with np.errstate(all="ignore"):
        ratio_n = np.where(error_n == 0, 1.0, error_n / (EPS * size_n))
    return round(min(float(np.log10(max(ratio_n.max(), 1.0))), 99.0), 2)


def reason(
    problem: Problem, name: str, id_n: Any, snapshots: Sequence[Snapshot], engine: str, predictor: Predictor
) -> Reason | None:
    """Find the first step, stage, field and atom that leave the bound, and those that do beyond the findings known."""
    random = seed(f"{name}/moved runs")
    prediction = predictor.predict(problem, seed=random)
    first = first_outside(problem, compare_all(problem, id_n, snapshots, prediction), id_n)
    if first is None:
        return None
    explanation = Trial(problem, snapshots, id_n, prediction, random, predictor).explain(engine, first)
    return Reason(first, explanation.beyond, explanation.entries)
