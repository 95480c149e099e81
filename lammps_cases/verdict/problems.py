"""Scenes as problems of the reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.comparison.trajectory import COMPILED_ABOVE, evaluations, own_stages
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.runs import AS_TEXT, FROM_FILE, upper_corners
from lammps_cases.setup import reference_side

TEXT_DIGITS = 16  # significant digits of a number in a file of write_data


def problem_of(
    scene: Scene, atoms: Atoms, where: str, steps: tuple[int, ...], predictor: Predictor | None = None
) -> Problem:
    """Return a scene in the reference's form, to be compared at some steps; with a predictor it is made once."""
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
    """Return the ends of a scene's runs before others, in the reference's form."""
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
    """Name the evaluator of the reference that judges a case, and the size that decides it; None for a refusal."""
    if case.scene.expect:
        return None
    if not case.scene.whole_model:
        return "the formula of the law, in numpy"
    problem = problem_of(case.scene, atoms, case.where, case.scene.snapshots)
    name = "array" if issubclass(own_stages(problem), ArrayEvaluator) else "compiled"
    return f"the {name} evaluator ({evaluations(problem)} evaluations of a particle; compiled above {COMPILED_ABOVE})"
