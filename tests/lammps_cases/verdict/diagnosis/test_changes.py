"""Changes of the reference's formulas that have a memory."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.quantities import needed_to_step
from eos_ref.numbers.rounded import placed
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.diagnosis.changes import Watched, stale
from lammps_cases.verdict.problems import problem_of


def test_stale_wall_densities_are_kept_per_solid() -> None:
    """Each solid keeps its own density of the previous evaluation, while the solids that meet fluid change."""
    (case,) = (case for case in casefile.load() if case.name == "open.walls-after-rebuild")
    problem = problem_of(case.scene, prepare(case).atoms, case.where, case.scene.snapshots)
    quick = replace(problem.state, v_nc=10 * problem.state.v_nc)
    fresh: list[np.ndarray] = []
    met: list[np.ndarray] = []

    class RecordingEvaluator(ArrayEvaluator):
        def wall_density(self, at: Any, p: Any, energy_n: Any) -> Any:
            density = super().wall_density(at, p, energy_n)
            fresh.append(placed(density, at, self.rho0_n))
            met.append(at)
            return density

    stages = type("Tried", (stale("wall_density"), RecordingEvaluator), {})
    sim = Watched(problem.model, problem.box, quick, needed_to_step(problem.model), stages)
    sim.setup()
    for _ in range(10):
        sim.step(problem.timestep)
        np.testing.assert_array_equal(
            sim.state.rho_n[met[-1]], fresh[-3][met[-1]]
        )  # in between lies that of the first half of the step
    assert len({len(at) for at in met}) > 1, "the same solids meet fluid in every step"
