"""Predictions of the reference for a scene, computed once: within a case, and from run to run.

A prediction follows from the problem (model, box, particles, time step, fields, steps), the variant, the seed of the
moved runs, and what `lammps_cases.comparison.store` adds to that: only these decide whether one is found again.
"""

from __future__ import annotations

import itertools
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.blocks import in_blocks
from eos_ref.evaluation.pairs import Candidates, sharing
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison import pair_sums
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.store import Store, Unnamed, fingerprint
from lammps_cases.comparison.trajectory import (
    Fields,
    Halt,
    Prediction,
    halted,
    input_spread,
    precise_setup,
    predict,
    visit,
    widening,
)

Made = tuple[type[ArrayEvaluator], type[Simulation]]  # the stages and the stepping of a variant
Arrays = dict[str, npt.NDArray[Any]]
ALL = sys.maxsize


@dataclass
class Predictor:
    """Provides predictions of the reference: from memory, from a store, or computed.

    Attributes
    ----------
    store : where predictions are kept between runs; None: nowhere
    computed, stored : how many were computed, and how many came from the store
    """

    store: Store | None = None
    computed: int = 0
    stored: int = 0
    _known: dict[str, Arrays] = field(default_factory=dict, repr=False)
    _named: dict[int, tuple[object, str]] = field(default_factory=dict, repr=False)
    _problems: dict[tuple[Any, ...], tuple[object, Problem]] = field(default_factory=dict, repr=False)
    _halts: dict[str, dict[int, Halt]] = field(default_factory=dict, repr=False)
    _found: list[Candidates] = field(default_factory=list, repr=False)

    def problem(self, of: tuple[object, ...], steps: tuple[int, ...], make: Callable[[], Problem]) -> Problem:
        """Return the problem for some objects and steps, made once for the same objects."""
        key = (*map(id, of), steps)
        if key not in self._problems:
            self._problems[key] = of, make()  # kept with its objects, so that their ids are not reused
        return self._problems[key][1]

    def predict(self, problem: Problem, made: Made | None = None, seed: int = 0) -> Prediction:
        """Return fields and bounds, of the reference or a variant; see `lammps_cases.comparison.trajectory.predict`."""

        def compute() -> Prediction:
            stages, stepping = made or (None, Simulation)
            return predict(problem, stages, stepping, seed, None if made else self.halts(problem))

        return self._prediction("prediction", problem, made, seed, compute)

    def widening(self, problem: Problem, made: Made, seed: int) -> Iterator[Prediction]:
        """Yield the prediction of a variant with the bounds of one moved run, then with those of all.

        The first bounds are no wider: where LAMMPS is inside, the other runs, half of the time, are not needed.
        """
        runs = widening(problem, *made, seed)
        if problem.goes_on:
            yield self._prediction("one moved run", problem, made, seed, lambda: next(itertools.islice(runs, 1, None)))
        yield self._prediction("prediction", problem, made, seed, lambda: deque(runs, 1)[0])

    def _prediction(
        self, what: str, problem: Problem, made: Made | None, seed: int, compute: Callable[[], Prediction]
    ) -> Prediction:
        def rows() -> Arrays:
            prediction = compute()
            return _rows("value", prediction.fields) | _rows("bound", prediction.bounds)

        arrays = self._recall((what, self._name(problem), made, seed), rows)
        return Prediction(*(tuple(_columns(of, problem, arrays)) for of in ("value", "bound")))

    def values(self, problem: Problem, made: Made) -> list[Fields]:
        """Return the fields of a variant without their bounds."""

        def compute() -> Arrays:
            stages, stepping = made
            sim = problem.simulation(in_blocks(stages, len(problem.state.x_nc)), stepping)
            visited = visit(sim, problem.steps, problem.timestep, problem.stops)
            return _rows("value", [{f: np.array(sim.output(f)) for f in problem.fields} for _ in visited])

        return _columns("value", problem, self._recall(("values", self._name(problem), made), compute))

    def input_spread(self, problem: Problem, prediction: Prediction, seed: int) -> list[Fields]:
        """Return the distance of the reference's fields from those of moved input, per step."""

        def compute() -> Arrays:
            return _rows("spread", input_spread(problem, ArrayEvaluator, Simulation, prediction.fields, seed))

        return _columns("spread", problem, self._recall(("input spread", self._name(problem), seed), compute))

    def precise(self, problem: Problem) -> Fields:
        """Return the fields of the first evaluation in extended precision."""

        def compute() -> Arrays:
            return {f: np.asarray(x) for f, x in precise_setup(problem).items()}

        return self._recall(("precise", self._name(problem)), compute)

    def pair_sums(self, problem: Problem, looks: Sequence[tuple[int, int]]) -> Arrays:
        """Return the pairs of particles, each a step and a row; see `lammps_cases.comparison.pair_sums.columns`."""

        def compute() -> Arrays:
            known = self._halts.get(self._name(problem), {})
            halts = {step: halt.sim for step, halt in known.items()} or halted(problem, problem.steps)
            by_step: dict[int, list[int]] = {}
            for step, row in looks:
                by_step.setdefault(step, []).append(row)
            of = [(s, one) for s, rows in by_step.items() for one in pair_sums.sums(halts[s], rows, ALL, forces=True)]
            return pair_sums.columns(of)

        return self._recall(("pair sums", self._name(problem), tuple(looks)), compute)

    def names(self, what: str, problem: Problem, compute: Callable[[], list[str]], seed: int) -> list[str]:
        """Return names that follow from a scene and a seed, such as those of formulas it cannot distinguish."""

        def made() -> Arrays:
            return {"names": np.array(compute(), dtype=str)}

        names: list[str] = self._recall((what, self._name(problem), seed), made)["names"].tolist()
        return names

    def counts(self, what: str, problem: Problem, compute: Callable[[], dict[str, int]]) -> dict[str, int]:
        """Return counts by name that follow from a scene, such as those of the rules it exercises."""

        def made() -> Arrays:
            counts = compute()
            return {"names": np.array(list(counts), dtype=str), "counts": np.array(list(counts.values()), dtype=int)}

        arrays = self._recall((what, self._name(problem)), made)
        return dict(zip(arrays["names"].tolist(), arrays["counts"].tolist(), strict=True))

    def halts(self, problem: Problem) -> dict[int, Halt] | None:
        """Return the reference at the steps of a scene, if it has run; None: too large to be kept."""
        large = len(problem.state.x_nc) > pair_sums.LARGEST
        return None if large else self._halts.setdefault(self._name(problem), {})

    def _name(self, problem: Problem) -> str:
        """Return the fingerprint of a scene; each part, which problems of a case share, is hashed once."""
        return fingerprint(*(self._name_of(getattr(problem, part.name)) for part in fields(problem)))

    def _name_of(self, part: object) -> str:
        if id(part) not in self._named:
            self._named[id(part)] = part, fingerprint(part)  # kept with its name, so that its id is not reused
        return self._named[id(part)][1]

    def _recall(self, what: tuple[object, ...], compute: Callable[[], Arrays]) -> Arrays:
        try:
            key = fingerprint(*what)
        except Unnamed:
            self.computed += 1
            return compute()
        if key in self._known:
            return self._known[key]
        arrays = self.store.read(key) if self.store else None
        if arrays is None:
            with sharing(self._found):  # the runs of a case start from the same state
                arrays = compute()
            self.computed += 1
            if self.store:
                self.store.write(key, arrays)
        else:
            self.stored += 1
        self._known[key] = arrays
        return arrays


def _rows(name: str, steps: Any) -> Arrays:
    return {f"{name} {k} {f}": np.asarray(array) for k, arrays in enumerate(steps) for f, array in arrays.items()}


def _columns(name: str, problem: Problem, arrays: Arrays) -> list[Fields]:
    return [{f: arrays[f"{name} {k} {f}"] for f in problem.fields} for k in range(len(problem.steps))]
