"""Scenes as problems of the reference, and the rules of the reference that each exercises."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.comparison.trajectory import COMPILED_ABOVE, Halt, evaluations, own_stages, reached
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.rules import RULES, Evaluated
from lammps_cases.scene.runs import AS_TEXT, FROM_FILE, upper_corners
from lammps_cases.setup import reference_side

TEXT_DIGITS = 16  # significant digits of a number in a file of write_data


def problem_of(
    scene: Scene, atoms: Atoms, where: str, steps: tuple[int, ...], predictor: Predictor | None = None
) -> Problem:
    """Return a scene as the reference takes it, to be compared at some steps; with a predictor it is made once."""
    if predictor is not None:
        return predictor.problem((scene, atoms), steps, lambda: problem_of(scene, atoms, where, steps))
    return Problem(
        reference_side.model(scene, atoms, where),
        reference_side.box(scene, atoms),
        reference_side.state(scene, atoms, where),
        scene.evolve.timestep if scene.evolve else 0.0,
        scene.compare,
        steps,
        stops_of(scene, atoms),
        scene.engine.ranks,
        scene.engine.newton_flags,
    )


def stops_of(scene: Scene, atoms: Atoms) -> tuple[ProblemStop, ...]:
    """Return where a scene's runs end and others begin, as the reference takes them."""
    evolve = scene.evolve
    corners = upper_corners(evolve.stops if evolve else (), atoms.low_c.tolist(), atoms.high_c.tolist())
    return tuple(
        ProblemStop(
            stop.at,
            np.arange(len(atoms)) >= len(atoms) - stop.count_recreated_atoms(len(atoms)),
            stop.timestep,
            reference_side.displacement(stop, scene, atoms),
            stop.by in FROM_FILE,
            TEXT_DIGITS if stop.by in AS_TEXT else None,
            replace(atoms, high_c=np.array(corners[stop.at])).box(scene.dimension) if stop.stretch else None,
            stop.by == "minimize",
            stop.by == "continued",
        )
        for stop in (evolve.beginnings if evolve else ())
    )


def evaluated_by(case: Case, atoms: Atoms) -> str | None:
    """Name the evaluator of the reference that judges a case, and the size that decides it; None of a refusal."""
    if case.scene.expect:
        return None
    if not case.scene.whole_model:
        return "the formula of the law, in numpy"
    problem = problem_of(case.scene, atoms, case.where, case.scene.snapshots)
    name = "array" if issubclass(own_stages(problem), ArrayEvaluator) else "compiled"
    return f"the {name} evaluator ({evaluations(problem)} evaluations of a particle; compiled above {COMPILED_ABOVE})"


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


def exercise_rows(case: Case, atoms: Atoms, predictor: Predictor) -> list[dict[str, Any]]:
    """List the rules that a case is for, then the others it takes, with the number of particles or pairs of each."""
    taken = counts(case, atoms, predictor)
    names = [*case.exercises, *(name for name in RULES if name in taken and name not in case.exercises)]
    return [
        {
            "rule": name,
            "sentence": RULES[name].sentence,
            "count": taken.get(name, 0),
            "of": RULES[name].of,
            "for": name in case.exercises,
        }
        for name in names
    ]


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
