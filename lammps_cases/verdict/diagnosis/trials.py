"""Trials of changes of the reference against LAMMPS: on a group's smallest case first, then on all others."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.pairs import Candidates, sharing
from lammps_cases.comparison import changed
from lammps_cases.comparison.compare import excess
from lammps_cases.comparison.predictor import Made, Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Fields, Prediction, predict
from lammps_cases.findings.variants import Snapshot
from lammps_cases.scene.changes import Change
from lammps_cases.scene.fields import in_step_order
from lammps_cases.verdict.diagnosis.changes import candidates
from lammps_cases.verdict.model_fields import nearest_image, sides

R = TypeVar("R")

NEARER = 0.05  # remaining part of the largest difference below which a change is examined closely
PAIRED = 60  # pairs of changes whose effects add up that are tried
SUMMED = 1e-5  # tolerance of a sum of effects, as a part of the largest difference
COMPONENTS = 200  # values of the first red field that sums of effects are compared with
LONGEST_STEP = 20  # compared steps beyond this one are too far for hundreds of trials
MORE = 500  # changes tried at least after one that reproduces a case
FAR = 1e3  # deviation of a change before the first red step, at most, in bounds of the reference


class Spent(Exception):
    """The work allowed for hypotheses is spent."""


@dataclass
class Work:
    """Seconds that trials take, estimated from their size: the diagnosis of a run is the same on any machine."""

    left: float

    def spend(self, problem: Problem, times: float = 1.0) -> None:
        """Count the evaluations of a scene at all its steps.

        Raises
        ------
        Spent
        """
        self.left -= times * (1 + problem.steps[-1]) * (1.6e-3 + 1.6e-5 * len(problem.state.x_nc))
        if self.left < 0:
            raise Spent


@dataclass
class RedCase:
    """A case of the particle model that differs, up to the first step at which it does.

    Attributes
    ----------
    problem : compared up to the first red step
    snapshots : LAMMPS' fields at its steps
    red_field : the first red one
    base : stages and stepping of the findings that the case shows as well
    reference : the reference's prediction with these
    """

    name: str
    problem: Problem
    snapshots: Sequence[Snapshot]
    red_field: str
    base: Made
    reference: Prediction
    seed: int
    near: list[Candidates] = field(default_factory=list)  # pairs, the start of all trials

    @property
    def size(self) -> float:
        """Return the duration of a trial, in arbitrary units."""
        return (1 + self.problem.steps[-1]) * (100 + len(self.problem.state.x_nc))

    @property
    def place(self) -> tuple[int, int]:
        """Return the first red step, and the place of its first red field in the order of a step."""
        return self.problem.steps[-1], in_step_order(self.problem.fields).index(self.red_field)

    @property
    def types(self) -> int:
        """Return the number of atom types."""
        return len(self.problem.model.mass_t)

    @cached_property
    def up_to_field(self) -> RedCase:
        """Return the case with the fields up to the first red one."""
        names = in_step_order(self.problem.fields)
        fields = tuple(names[: names.index(self.red_field) + 1])
        return replace(self, problem=replace(self.problem, fields=fields))

    def values(self, tried: Sequence[Change]) -> list[Fields] | None:
        """Return the fields with some changes at all steps; None if they are undefined, or differ earlier."""
        return self._meaningful(lambda: self._values(tried))

    def _meaningful(self, of: Callable[[], R | None]) -> R | None:
        """Return a result of changes; None if it is undefined."""
        try:
            with sharing(self.near), np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return of()
        except Exception:  # in this scene: a type or a property that it lacks; for an edit anything
            return None

    def _values(self, tried: Sequence[Change]) -> list[Fields] | None:
        found = list[Fields]()
        with closing(changed.fields(self.problem, tried, self.base)) as outputs:
            for at, output in enumerate(outputs):
                found.append({f: np.array(values, float) for f, values in output.items()})
                if any(values.shape != self.reference.fields[at][f].shape for f, values in found[at].items()):
                    return None
                last = at + 1 == len(self.problem.steps)
                if not last and any(self._far(at, name, found[at]) for name in self.problem.fields):
                    return None
        return found

    def _far(self, at: int, name: str, values: Fields) -> bool:
        bound_n = np.broadcast_to(np.asarray(self.reference.bounds[at][name], float), values[name].shape)
        return bool(np.any(excess(self._lammps(name, at, values), values[name], bound_n)[1] > FAR))

    def evaluate(self) -> None:
        """Evaluate the scene once, without changes."""
        self._values(())

    def first(self) -> tuple[Any, Any]:
        """Return the first red field: LAMMPS' and the reference's."""
        at = len(self.problem.steps) - 1
        return self._lammps(self.red_field, at, self.reference.fields[at]), np.asarray(
            self.reference.fields[at][self.red_field], float
        )

    def _lammps(self, name: str, at: int, fields: Fields) -> Any:
        lammps_n = np.asarray(self.snapshots[at][name], float)
        if name != "x":
            return lammps_n
        return nearest_image(
            self.problem.box_of_images(self.problem.steps[at]), lammps_n, np.asarray(fields[name], float)
        )

    def changed(self, values: list[Fields]) -> bool:
        """Return whether fields differ from the reference's where LAMMPS' do first."""
        return not np.array_equal(values[-1][self.red_field], self.first()[1], equal_nan=True)

    def nearer(self, values: list[Fields]) -> bool:
        """Return whether fields are much closer to LAMMPS' than the reference's, where these differ first."""
        lammps_n, reference_n = self.first()
        with np.errstate(all="ignore"):
            before = np.abs(lammps_n - reference_n).max(initial=0.0)
            after = np.abs(lammps_n - values[-1][self.red_field]).max(initial=0.0)
        return bool(after <= NEARER * before)

    def inside(self, values: Sequence[Fields], bounds: Sequence[Fields]) -> bool:
        """Return whether LAMMPS is inside the bounds of some fields, all of them up to the end of the red step.

        A bound within which the reference also lies proves nothing.
        """
        names, last = in_step_order(self.problem.fields), len(self.problem.steps) - 1
        lammps_n, reference_n = self.first()
        bound_n = np.broadcast_to(np.asarray(bounds[last][self.red_field], float), reference_n.shape)
        if np.all(excess(lammps_n, reference_n, bound_n)[1] <= 1):
            return False
        for at, name in itertools.product(range(last + 1), names):
            values_n = np.asarray(values[at][name], float)
            bound_n = np.broadcast_to(np.asarray(bounds[at][name], float), values_n.shape)
            if not np.all(excess(self._lammps(name, at, values[at]), values_n, bound_n)[1] <= 1):
                return False
        return True

    def own_bounds(self, tried: Sequence[Change]) -> Prediction | None:
        """Return the fields with some changes and their own bounds."""

        def bounded() -> Prediction:
            with changed.made(*tried):
                return predict(self.problem, *changed.classes(tried, self.base), self.seed)

        return self._meaningful(bounded)

    def reproduced(self, tried: Sequence[Change], work: Work, strictly: bool = False) -> bool:
        """Return whether changes reproduce LAMMPS on every atom, in all fields up to the end of the first red step.

        Inside the bounds of the reference, or of the change itself; ``strictly``: of the change itself.
        """
        work.spend(self.problem)
        values = self.values(tried)
        if values is None or not self.nearer(values):
            return False
        if not strictly and self.inside(values, self.reference.bounds):
            return True
        work.spend(self.problem, 10.0)
        own = self.own_bounds(tried)
        return own is not None and self.inside(own.fields, own.bounds)


Tried = tuple[Change, ...]


@dataclass
class HypothesisSearch:
    """Hypotheses of a case: single changes that reproduce it, or else pairs."""

    case: RedCase
    work: Work
    tried: int = 0
    spent: bool = False
    effects: list[tuple[Change, FloatArray]] = field(default_factory=list)

    def singles(self) -> Iterator[list[Tried]]:
        """Yield nothing after each trial, at last the single changes that reproduce a case; keep the effects of all.

        After the first success half as many are tried as before it, at least `MORE`: others may do the same.
        """
        survivors: list[Tried] = []
        shapes: set[bytes] = set()
        last = math.inf
        near = self.case.up_to_field
        try:
            for change in candidates(near.types, near.evaluate):
                if self.tried >= last:
                    break
                yield []
                self.tried += 1
                self.work.spend(near.problem)
                values = near.values((change,))
                if values is None or not near.changed(values):
                    continue
                if near.nearer(values) and self.case.reproduced((change,), self.work, strictly=True):
                    survivors.append((change,))
                    last = min(last, self.tried + max(self.tried // 2, MORE))
                shown = np.asarray(values[-1][near.red_field], float).ravel()
                if np.isfinite(shown).all() and shown.tobytes() not in shapes:
                    shapes.add(shown.tobytes())
                    self.effects.append((change, shown))
        except Spent:
            self.spent = True
        yield survivors

    def pairs(self) -> list[Tried]:
        """Return the pairs of changes that reproduce a case, from singles that had an effect on it."""
        if not self.effects:
            return []
        single = [change for change, _ in self.effects]
        lammps_n, reference_n = (side.ravel() for side in self.case.first())
        effects = np.array([shown for _, shown in self.effects]) - reference_n
        added = [(single[a], single[b]) for a, b in _adding_up(effects, lammps_n - reference_n)]
        return self._survivors(added)

    def _survivors(self, pairs: Sequence[Tried]) -> list[Tried]:
        survivors: list[Tried] = []
        try:
            for tried in pairs:
                self.tried += 1
                if self.case.reproduced(tried, self.work, strictly=True):
                    survivors.append(tried)
        except Spent:
            self.spent = True
        return survivors


def survivors_of(searches: Sequence[HypothesisSearch]) -> Iterator[list[Tried]]:
    """Yield what the searches find: single changes, tried in turns, as any search may be the first, then pairs."""
    yield from itertools.chain.from_iterable(
        itertools.zip_longest(*(each.singles() for each in searches), fillvalue=[])
    )
    yield from (each.pairs() for each in searches)


def _adding_up(effects: FloatArray, difference: FloatArray) -> list[tuple[int, int]]:
    """Return the pairs of effects, (k, m), whose sum is close to a difference, (m,), the closest first."""
    largest = np.argsort(-np.abs(difference))[:COMPONENTS]
    effects, difference = effects[:, largest], difference[largest]
    size = np.abs(difference).max(initial=0.0)
    sums: list[tuple[float, int, int]] = []
    for a, effect in enumerate(effects[:-1]):
        left = np.abs(effects[a + 1 :] - (difference - effect)).max(axis=1)
        sums += [(float(left[b]), a, a + 1 + int(b)) for b in np.flatnonzero(left <= SUMMED * size)]
    return [(a, b) for _, a, b in sorted(sums)[:PAIRED]]


def red_case(
    name: str, problem: Problem, snapshots: Sequence[Snapshot], base: Made, seed: int, predictor: Predictor
) -> RedCase | None:
    """Return a case up to its first red step; None if no step is red, or too late a one for hundreds of trials."""
    prediction = predictor.predict(problem, None if base == changed.PLAIN else base, seed)
    for at, step in enumerate(problem.steps):
        if step > LONGEST_STEP:
            return None
        for name_of in in_step_order(problem.fields):
            if not np.all(excess(*sides(problem, name_of, snapshots[at], prediction, at))[1] <= 1):
                until = replace(problem, steps=problem.steps[: at + 1])
                so_far = Prediction(prediction.fields[: at + 1], prediction.bounds[: at + 1])
                return RedCase(name, until, snapshots, name_of, base, so_far, seed)
    return None
