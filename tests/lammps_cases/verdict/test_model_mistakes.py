"""Mistakes in the particle model: which ones a scene can detect, and which it cannot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict import mistakes
from lammps_cases.verdict.mistakes import MODEL_MUTANTS, ModelMutant, shown, undetected_in_model
from lammps_cases.verdict.problems import problem_of

# A scene that detects each mistake.
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


def blind(name: str) -> list[str]:
    problem = first_evaluation(name)
    return undetected_in_model(problem, Predictor(None).predict(problem))


def test_every_mistake_has_a_scene() -> None:
    assert SHOWN.keys() == MODEL_MUTANTS.keys()


@pytest.mark.parametrize("mistake", SHOWN)
def test_scene_detects_the_mistake(mistake: str) -> None:
    problem = first_evaluation(SHOWN[mistake])
    right, wrong = (problem.simulation(*stages) for stages in ((), (MODEL_MUTANTS[mistake].stages,)))
    for simulation in (right, wrong):
        with np.errstate(all="ignore"):
            simulation.setup()
    changed = [f for f in problem.fields if not np.array_equal(right.output(f), wrong.output(f), equal_nan=True)]
    assert changed
    assert mistake not in blind(SHOWN[mistake])


def test_mutant_uses_the_particles_own_volume() -> None:
    problem = first_evaluation("forces.all.quintic.2d")
    mutant = MODEL_MUTANTS["V_i for V_j"]
    sim = problem.simulation(mutant.stages)
    sim.setup()
    stages: Any = sim.evaluator
    rho_i, rho_j = stages.density_pair(problem.state.rho_n)
    mass_i, mass_j = stages.mass_n[stages.i], stages.mass_n[stages.j]
    assert np.any(mass_i != mass_j) and np.any(mass_i != 1)
    # A quotient and a product in rho_j, and the two quotients here.
    np.testing.assert_allclose(mass_j / rho_j, mass_i / rho_i, rtol=4 * 2.0**-53)


@pytest.mark.parametrize("harmonic", [True, False])
def test_mutant_uses_the_other_mean(harmonic: bool) -> None:
    problem = first_evaluation("forces.all.quintic.2d")
    model = replace(problem.model, pair=replace(problem.model.pair, harmonic_means=harmonic))
    mutant = MODEL_MUTANTS["arithmetic for harmonic mean, or the reverse"]
    sim = Simulation(model, problem.box, problem.state, problem.wanted, mutant.stages)
    sim.setup()
    assert sim.evaluator.model.pair.harmonic_means == (not harmonic)


def test_mutant_uses_the_largest_conductivity(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ArrayEvaluator, "conduction", lambda self: np.array([0.0, 2.0, 1.0]))
    stages = MODEL_MUTANTS["one conductivity for all types"].stages
    np.testing.assert_array_equal(stages.__new__(stages).conduction(), 2.0)


def test_mistake_may_produce_nan_without_a_warning() -> None:
    class Divides(ArrayEvaluator):
        def density_pair(self, rho_n: Any) -> Any:
            rho_i, rho_j = super().density_pair(rho_n)
            return rho_i, rho_j / (0 * rho_j)

    problem = first_evaluation("fluids.unit")
    with np.errstate(all="raise"):
        prediction = Predictor().predict(problem)
        assert not mistakes.cannot_distinguish(problem, prediction, ModelMutant(Divides, ("f",)))


def test_parameters_of_one_hide_mistakes_in_their_factors() -> None:
    assert {"masses ignored", "rho0 for rho in volumes", "V_i for V_j", "no volume in the force"} <= set(
        blind("fluids.unit")
    )


def test_mistake_in_absent_parts_of_a_scene_is_not_reported() -> None:
    """Equal arrays are not reported as undetected mistakes if nothing can differ."""
    for name in ("fluids.unit", "forces.all.quintic.2d"):
        unseen = blind(name)
        assert not [mistake for mistake in unseen if MODEL_MUTANTS[mistake].needs_walls]
        assert "temperature of the whole energy" not in unseen


# --- quantities that a scene shows, and when a mistake in them counts


def shown_by(*fields: str, **changes: Any) -> set[str]:
    """Return the quantities in which a scene of two fluids and a solid at rest could show a mistake."""
    given: dict[str, Any] = {
        "damp": 0.0,
        "corrects": False,
        "sum": False,
        "artificial": 0.0,
        "types": [1, 2, 3],
        "v": 0.0,
    }
    given |= changes
    types_n = np.array(given["types"])
    problem = SimpleNamespace(
        fields=fields,
        model=SimpleNamespace(
            fix=SimpleNamespace(rho_sum=given["sum"]),
            pair=SimpleNamespace(rho_damp=given["damp"], artificial_viscosity=given["artificial"]),
            corrects_gradients=given["corrects"],
        ),
        state=SimpleNamespace(type_n=types_n, solid_n=types_n == 3, v_nc=np.full((3, 2), [[0.0], [1.0], [given["v"]]])),
    )
    return set(shown(problem))


@pytest.mark.parametrize(
    ("fields", "changes", "seen"),
    [
        (["f", "pressure"], {}, {"f", "pressure"}),
        (["rho", "f"], {}, {"f"}),
        (["rho", "f"], {"sum": True}, {"rho", "f"}),
        (["drho", "f"], {"damp": 0.1}, {"drho", "f"}),
        (["drho", "f"], {}, {"f"}),
        (["drho", "f"], {"damp": 0.1, "corrects": True}, {"f"}),
        (["drho", "f"], {"damp": 0.1, "types": [1, 1, 3]}, {"f"}),  # rho0 cancels for one fluid
        (["f"], {"artificial": 0.5}, {"f", "artificial"}),
        (["drho"], {"artificial": 0.5, "damp": 0.1}, {"drho"}),
        (["grad/v"], {"v": 2.0}, {"grad/v", "moving walls"}),
        (["grad/v"], {}, {"grad/v"}),
        (["f"], {"v": 2.0}, {"f"}),
    ],
)
def test_quantities_in_which_a_mistake_could_show(fields: list[str], changes: dict[str, Any], seen: set[str]) -> None:
    assert shown_by(*fields, **changes) == seen


def test_mistakes_in_walls_need_scenes_with_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mistakes, "cannot_distinguish", lambda *_: True)
    of_force = [name for name, mutant in MODEL_MUTANTS.items() if {"f", "artificial"} & set(mutant.changes)]
    plain = [name for name in of_force if not MODEL_MUTANTS[name].needs_walls]
    problem = replace(first_evaluation("fluids.unit"), fields=("f",))
    fix, n = problem.model.fix, len(problem.state.x_nc)
    for reconstructs, solid, names in ((True, True, of_force), (True, False, plain), (False, True, plain)):
        model = replace(problem.model, fix=replace(fix, interface_reconstruct=reconstructs))
        state = replace(problem.state, solid_n=np.full(n, solid))
        of = replace(problem, model=model, state=state)
        assert undetected_in_model(of, Prediction((), ())) == names


@pytest.mark.parametrize(("over", "unseen"), [(1.0, True), (1.5, False)])
def test_mistake_within_the_bound_is_undetected(over: float, unseen: bool) -> None:
    problem = replace(first_evaluation("forces.all.quintic.2d"), fields=("f",))
    mutant = MODEL_MUTANTS["no volume in the force"]
    right, wrong = (problem.simulation(stages) for stages in (ArrayEvaluator, mutant.stages))
    for simulation in (right, wrong):
        simulation.setup()
    bound_nc = np.abs(wrong.output("f") - right.output("f")) / over
    assert (
        mistakes.cannot_distinguish(problem, Prediction(({"f": right.output("f")},), ({"f": bound_nc},)), mutant)
        == unseen
    )
