"""Mistakes in the particle model: which ones a scene can show, and to which it is blind."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.trajectory import Problem, wanted
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.model_cases import problem_of
from lammps_cases.verdict.model_mistakes import MUTANTS, unseen_in_model

# A scene that shows each mistake.
SHOWN = {
    "masses ignored": "forces.all.quintic.2d",
    "rho0 for rho in volumes": "forces.all.quintic.2d",
    "V_i for V_j": "forces.all.quintic.2d",
    "no volume in the force": "forces.all.quintic.2d",
    "arithmetic for harmonic mean, or the reverse": "forces.harmonic.quintic.2d",
    "speed of sound ignored in artificial viscosity": "forces.artificial.quintic.2d",
    "rho0 ignored in density diffusion": "forces.all.quintic.2d",
    "no-slip extrapolation ignored": "walls.reconstructed.plain",
    "velocity of walls lost": "walls-moving.free.rk1",
    "no lower limit to the density of walls": "walls.reconstructed.plain",
    "temperature of the whole energy": "thermal.latent.2d",
    "heat divided by the density": "thermal.arithmetic.2d",
    "one conductivity for all types": "thermal.arithmetic.2d",
}
CASES = {case.name: case for case in casefile.load()}


@cache
def first_evaluation(name: str) -> Problem:
    case = CASES[name]
    return problem_of(case.scene, prepared_case.prepare(case).atoms, case.where, (0,))


@cache
def blind(name: str) -> list[str]:
    problem = first_evaluation(name)
    return unseen_in_model(problem, Predictor(None).predict(problem))


def test_every_mistake_has_a_scene() -> None:
    assert SHOWN.keys() == MUTANTS.keys()


@pytest.mark.parametrize("mistake", SHOWN)
def test_a_scene_shows_the_mistake(mistake: str) -> None:
    problem = first_evaluation(SHOWN[mistake])
    right, wrong = (
        Simulation(problem.model, problem.box, problem.state, wanted(problem), *stages)
        for stages in ((), (MUTANTS[mistake].stages,))
    )
    for simulation in (right, wrong):
        with np.errstate(all="ignore"):
            simulation.setup()
    changed = [f for f in problem.fields if not np.array_equal(right.output(f), wrong.output(f), equal_nan=True)]
    assert changed
    assert mistake not in blind(SHOWN[mistake])


def test_units_of_one_hide_what_they_multiply() -> None:
    assert {"masses ignored", "rho0 for rho in volumes", "V_i for V_j", "no volume in the force"} <= set(
        blind("fluids.unit")
    )


def test_a_mistake_in_what_a_scene_does_not_have_is_not_said() -> None:
    """Equal arrays where nothing can differ are not called blindness."""
    for name in ("fluids.unit", "forces.all.quintic.2d"):
        unseen = blind(name)
        assert not [mistake for mistake in unseen if MUTANTS[mistake].needs_walls]
        assert "temperature of the whole energy" not in unseen
