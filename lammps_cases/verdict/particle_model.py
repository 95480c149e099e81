"""A case of the particle model: LAMMPS' fields at some steps against the reference, and the explanation of differences.

A field that exceeds its bound is compared with the ledger: the search is for the smallest set of findings whose
variants, together, are inside their bounds on every atom, at every step, in every field. No list of engines decides
here. The findings that an engine is known to have are tried first, as the most likely; then sets of those that apply
to the scene, so that a LAMMPS in which one of several faults is fixed is explained by the remaining ones.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import Comparison, compare_field, components, excess
from lammps_cases.comparison.predictor import Made, Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Fields, Prediction
from lammps_cases.findings import Finding, applicable
from lammps_cases.findings.variants import Snapshot, combined
from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import Beyond, Blame
from lammps_cases.records.progress import stage
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import FIELDS, in_step_order
from lammps_cases.verdict.mistakes import undetected_in_model
from lammps_cases.verdict.model_fields import blame_of, compare_all, first_left, first_outside, over_steps, sides

SETS = 300  # sets of findings tried, at most: all sets of eight, those of up to three of a dozen


@dataclass(frozen=True)
class Explanation:
    """Findings that explain a difference, or else the remainder beyond those that come furthest."""

    entries: list[Finding]
    beyond: Beyond | None = None


@dataclass
class Trial:
    """LAMMPS' fields of a scene, against which sets of findings are tried.

    Attributes
    ----------
    problem, snapshots, id_n : the scene, LAMMPS' fields at its steps, and the ids of its particles
    reference : the reference's prediction without any finding
    random : seed of the moved runs
    """

    problem: Problem
    snapshots: Sequence[Snapshot]
    id_n: Any
    reference: Prediction
    random: int
    predictor: Predictor
    _left: dict[tuple[str, ...], Blame] = field(default_factory=dict, repr=False)

    @cached_property
    def applicable(self) -> list[Finding]:
        """Return the findings that make a difference to the scene."""
        return applicable(self.problem, "lists" in self.snapshots[0])

    def listed(self, engine: str) -> list[Finding]:
        """Return those of them that an engine is known to have."""
        return [entry for entry in self.applicable if entry.listed(engine)]

    def explain(self, engine: str, first: Blame) -> Explanation:
        """Return the smallest set of findings tried that is inside the bounds everywhere, each of them necessary.

        ``first`` is the reference's first value outside. If no set is inside, the remainder beyond the set that comes
        furthest is returned, without the findings that are unnecessary for it.
        """
        listed = self.listed(engine)
        if listed and self._inside(listed, at_once=True):
            return Explanation(self._necessary(listed))
        for entries in itertools.islice(self._sets(self.applicable, listed), SETS):
            if self._inside(entries):
                return Explanation(list(entries))
        # Some findings show only together with others; and sets of all but one of many are not among those tried.
        for large in (self.applicable, *(tuple(e for e in listed if e is not mended) for mended in listed)):
            if len(large) > 1 and self._inside(large):
                return Explanation(self._necessary(large))
        known = [entry.id for entry in listed if self.shows(entry)]
        return Explanation([], self._furthest(first, known))

    def _necessary(self, entries: Sequence[Finding]) -> list[Finding]:
        """Return the necessary findings of a set."""
        needed = list(entries)
        for entry in entries:
            fewer = [other for other in needed if other is not entry]
            if fewer and self._inside(fewer):
                needed = fewer
        return needed

    def _sets(self, entries: Sequence[Finding], listed: Sequence[Finding]) -> Iterator[tuple[Finding, ...]]:
        """Yield every set of the findings that change the scene by themselves, the smallest first."""
        alone = [entry for entry in entries if self.shows(entry)]
        alone.sort(key=lambda entry: entry not in listed)
        for size, _ in enumerate(alone, 1):
            for chosen in itertools.combinations(alone, size):
                yield tuple(sorted(chosen, key=lambda entry: entry.number))

    def _inside(self, entries: Sequence[Finding], at_once: bool = False) -> bool:
        """Return whether findings together reproduce LAMMPS; most sets, tried step by step, fail within the first."""
        steps = self.problem.steps
        left = None
        for count in (len(steps),) if at_once else dict.fromkeys((1, len(steps))):
            left = self._first_left(entries, replace(self.problem, steps=steps[:count]))
            if left is not None:
                self._left[tuple(entry.id for entry in entries)] = left
                if left.bound != math.inf:  # else later steps may exceed bounds
                    return False
        return left is None

    def _first_left(self, entries: Sequence[Finding], problem: Problem) -> Blame | None:
        """Return the first value outside the bounds of several findings together, or None."""
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        undefined = any(variant.undefined for variant in variants)
        left = None
        for prediction in self._predictions(combined(variants, problem, self.snapshots[0]), problem):
            left = self._first_outside(problem, prediction, undefined)
            if left is None:
                return None
        return left

    def _predictions(self, made: Made | None, problem: Problem) -> Iterator[Prediction]:
        """Yield the prediction of findings with wider and wider bounds; the reference's prediction without findings."""
        try:
            yield from self.predictor.widening(problem, made, self.random) if made else (self.reference,)
        except InputError:  # fitted to wrong numbers it diverges, and reproduces nothing
            yield self.reference

    def _first_outside(self, problem: Problem, prediction: Prediction, undefined: bool) -> Blame | None:
        """Return the first value outside a prediction, or None; ``undefined``: values without a bound are allowed."""
        return first_left(problem, lambda name, at: self._outside(name, at, prediction, undefined))

    def _outside(self, name: str, at: int, prediction: Prediction, undefined: bool) -> Blame | None:
        """Return the first value of a field outside a prediction at a step, or None."""
        lammps_n, variant_n, bound_n = sides(self.problem, name, self.snapshots[at], prediction, at)
        ratio_n = excess(lammps_n, variant_n, bound_n)[1]
        # A NaN where the reference has one is also reproduced, value by value.
        none_n = np.isnan(lammps_n) & np.isnan(variant_n) & np.isfinite(self.reference.fields[at][name])
        if np.all((ratio_n <= 1) | none_n):
            return None
        own_n = np.broadcast_to(self.reference.bounds[at][name], bound_n.shape)
        if undefined and _defined_part_inside(lammps_n, variant_n, bound_n, own_n):
            return None
        comparison = compare_field(name, FIELDS[name].stage, self.id_n, lammps_n, variant_n, bound_n)
        return blame_of(comparison, self.id_n, self.problem.steps[at])

    def _furthest(self, first: Blame, known: list[str]) -> Beyond | None:
        """Return the remainder beyond the smallest set that comes as far as any tried; of no set if none helps."""
        order = in_step_order(self.problem.fields)

        def place(left: Blame) -> tuple[int, int]:
            """Return the place in the order of steps: after all of them if all values with a bound are inside."""
            if left.bound == math.inf:
                return len(self.problem.steps), 0
            return self.problem.steps.index(left.step or 0), order.index(left.field)

        def reaches(names: tuple[str, ...]) -> bool:
            """Return whether fewer findings come as far."""
            if names not in self._left:
                self._inside([entry for entry in self.applicable if entry.id in names])
            return names in self._left and place(self._left[names]) >= furthest

        self._left[()] = first
        names = max(self._left, key=lambda names: (place(self._left[names]), -len(names)))
        furthest = place(self._left[names])
        for name in names:
            fewer = tuple(other for other in names if other != name)
            names = fewer if reaches(fewer) else names
        return Beyond(findings=list(names), blame=self._left[names], known=known) if names or known else None

    def unpredictable(self, entries: Sequence[Finding]) -> dict[str, str]:
        """Return, by field and in words, the steps at which explaining findings leave no value with a bound."""
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        open_ = [entry.id for entry in entries if entry.model_variant and entry.model_variant.undefined]
        if not open_:
            return {}
        *_, prediction = self._predictions(combined(variants, self.problem, self.snapshots[0]), self.problem)
        steps = {
            name: [step for step, bounds in zip(self.problem.steps, prediction.bounds, strict=True)
                   if np.all(np.isinf(bounds[name]))]
            for name in in_step_order(self.problem.fields)
        }  # fmt: skip
        return {name: case_wording.not_predictable(at, open_) for name, at in steps.items() if at}

    def shows(self, entry: Finding) -> bool:
        """Return whether a finding moves some field out of the reference's bound."""
        made = combined([entry.model_variant] if entry.model_variant else [], self.problem, self.snapshots[0])
        changed: list[Fields] = []
        with contextlib.suppress(InputError):
            changed = self.predictor.values(self.problem, made) if made else []
        return any(
            bool(np.any(excess(*sides(self.problem, name, fields, self.reference, at))[1] > 1))
            for (at, fields), name in itertools.product(enumerate(changed), self.problem.fields)
        )


def _defined_part_inside(lammps_n: FloatArray, reference_n: FloatArray, bound_n: FloatArray, own_n: FloatArray) -> bool:
    """Return whether all values that have a bound are inside it.

    Only the variant may leave a value without a bound, not the reference with its bound ``own_n``.
    """
    defined = np.isfinite(bound_n) | ~np.isfinite(own_n)
    ratio = excess(lammps_n[defined], reference_n[defined], bound_n[defined])[1]
    return bool(np.all(ratio <= 1))


@dataclass(frozen=True)
class ModelVerdict:
    """Comparisons of a case, one per field with its worst step; their explanation; the blame, and the remainder.

    ``table`` has the comparisons of all steps; ``unpredictable`` why some of them are void, by field.
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
    """The first value outside its bound, the first beyond the findings that the scene shows, and what explains all."""

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
    """Return whether a finding is among several, or is the base of one of them."""
    own = entry.model_variant
    variants = [other.model_variant for other in entries if other.model_variant]
    return entry in entries or (own is not None and any(own.within(variant) for variant in variants))


def _unseen(problem: Problem, random: int, predictor: Predictor) -> list[str]:
    """Name the mistakes that a scene cannot tell apart; see `lammps_cases.verdict.mistakes`."""
    return predictor.names(
        "unseen", problem, lambda: undetected_in_model(problem, predictor.predict(problem, seed=random)), random
    )


def _add_digits_lost(precise: Fields, table: dict[str, list[Comparison]], comparisons: Sequence[Comparison]) -> None:
    """Add the digits lost by each side in the first evaluation; not LAMMPS' where it evaluates another formula."""
    for comparison in comparisons:
        first = table[comparison.record.field][0]
        exact = precise[comparison.record.field]
        comparison.record.digits_lost.reference = digits(first.reference_n, exact)
        if first.record.verdict in ("exact", "pass"):
            comparison.record.digits_lost.lammps = digits(first.lammps_n, exact)


def digits(values: FloatArray, exact: Any) -> float:
    """Return the decimal digits lost by the worst particle: log10 of its row's error over eps times the row's size."""
    error_n, size_n = (np.abs(components(side)).max(axis=1) for side in (values - exact, exact))
    with np.errstate(all="ignore"):
        ratio_n = np.where(error_n == 0, 1.0, error_n / (EPS * size_n))
    return round(min(float(np.log10(max(ratio_n.max(), 1.0))), 99.0), 2)


def reason(
    problem: Problem, name: str, id_n: Any, snapshots: Sequence[Snapshot], engine: str, predictor: Predictor
) -> Reason | None:
    """Find the first step, stage, field and atom outside the bound, and the first beyond the known findings."""
    random = seed(f"{name}/moved runs")
    prediction = predictor.predict(problem, seed=random)
    first = first_outside(problem, compare_all(problem, id_n, snapshots, prediction), id_n)
    if first is None:
        return None
    explanation = Trial(problem, snapshots, id_n, prediction, random, predictor).explain(engine, first)
    return Reason(first, explanation.beyond, explanation.entries)
