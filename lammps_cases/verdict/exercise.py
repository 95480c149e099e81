"""Which rules of the reference a scene exercises: particles and pairs counted by running the reference on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Halt, own_stages, reached
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.rules import RULES, Evaluated
from lammps_cases.setup import reference_side
from lammps_cases.verdict.problems import problem_of


def counts(case: Case, atoms: Atoms, predictor: Predictor, names: Sequence[str] = tuple(RULES)) -> dict[str, int]:
    """Return how many particles or pairs of a case take some rules: the most of the steps compared; others have none.

    A case that LAMMPS has to refuse takes none.
    """
    if case.scene.expect is not None:
        return {}
    scene = case.scene
    if scene.interacts:
        problem = problem_of(scene, atoms, case.where, scene.snapshots, predictor)
    else:  # states of a law: a density may have any sign
        given = reference_side.unchecked_state(scene, atoms, case.where)
        model, box = reference_side.model(scene, atoms, case.where), reference_side.box(scene, atoms)
        problem = Problem(model, box, given, 0.0, scene.compare, (0,))
    shared = scene.interacts and own_stages(problem) is ArrayEvaluator
    halts = predictor.halts(problem) if shared else None
    what = " ".join(("rules", *names))
    return predictor.counts(what, problem, lambda: counted(problem, scene.interacts, halts, names))


def exercised(case: Case, atoms: Atoms, predictor: Predictor) -> dict[str, int]:
    """Return the counts of the rules that a case says it exercises."""
    if not case.exercises:
        return {}
    every = counts(case, atoms, predictor, case.exercises)
    return {name: every.get(name, 0) for name in case.exercises}


def counted(
    problem: Problem,
    interacts: bool = True,
    halts: dict[int, Halt] | None = None,
    names: Sequence[str] = tuple(RULES),
) -> dict[str, int]:
    """Return the largest count of the rules named that a problem takes; without neighbours if nothing needs any.

    ``halts`` takes the reference as it is at every step, of which a prediction can be made.
    """
    most: dict[str, int] = {}
    with np.errstate(all="ignore"):
        for evaluated in _visited(problem, interacts, halts):
            for name in names:
                most[name] = max(most.get(name, 0), RULES[name].count(evaluated))
    return {name: count for name, count in most.items() if count}


def _visited(problem: Problem, interacts: bool, halts: dict[int, Halt] | None) -> Iterator[Evaluated]:
    """Yield the reference at every step compared."""
    start = problem.state
    if interacts:
        sim: Simulation = problem.simulation()
        for step, _ in reached(problem, sim, halts):
            if step in problem.steps:
                yield Evaluated(sim, start, problem.fields, step, problem.box, problem.step_changed(step))
    else:
        evaluator = ArrayEvaluator(problem.model, problem.box, start.type_n, start.solid_n)
        sim = Simulation.with_evaluator(start.copy(), evaluator, problem.fields)
        sim.evaluate()
        yield Evaluated(sim, start, problem.fields, 0, problem.box)
