"""Which evaluator predicts a scene: its size alone decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.comparison.trajectory import COMPILED_ABOVE, MOVED_RUNS, Problem, evaluations, own_stages
from lammps_cases.run import campaign
from lammps_cases.scene import casefile
from lammps_cases.verdict.model_cases import problem_of

Write = Callable[..., Path]


def problem(case_file: Write) -> Problem:
    case = casefile.load((case_file(compare=["f"], velocity={"random": 0.3}),))[0]
    return problem_of(case.scene, campaign.prepare(case).atoms, "", (0,))


def of_size(scene: Problem, n: int) -> Problem:
    return replace(scene, state=replace(scene.state, x_nc=np.zeros((n, 2))))


def test_scenes_are_compiled_above_a_size_alone(case_file: Write) -> None:
    scene = problem(case_file)
    assert own_stages(of_size(scene, COMPILED_ABOVE)) is ArrayEvaluator
    assert own_stages(of_size(scene, COMPILED_ABOVE + 1)) is CompiledEvaluator


def test_steps_and_the_moved_runs_that_they_need_count(case_file: Write) -> None:
    scene = of_size(problem(case_file), 100)
    assert evaluations(scene) == 100
    stepped = replace(scene, steps=(0, 9))
    assert evaluations(stepped) == 100 * 10 * (1 + MOVED_RUNS)
    n = COMPILED_ABOVE // (10 * (1 + MOVED_RUNS))
    assert own_stages(of_size(stepped, n)) is ArrayEvaluator
    assert own_stages(of_size(stepped, n + 1)) is CompiledEvaluator
