"""Plausible mistakes in laws and in the particle model: what each changes, and which ones a scene can detect."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.changed import pressure
from lammps_cases.comparison.compare import EosState, evaluate
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.changes import Change
from lammps_cases.verdict import mistakes
from lammps_cases.verdict.mistakes import cannot_distinguish, changes, shown, undetected_in_laws, undetected_in_model
from lammps_cases.verdict.problems import problem_of

BY_NAME = {change.what: change for change in changes().values() if change.role == "mistake"}
IN_LAWS = [name for name, change in BY_NAME.items() if not change.stages]
ODD = EOSTable([EOS("cubic", 1.2, 3.1, 0.7, 0.3), EOS("tait/general", 0.9, 2.3, 4.1)])
PLAIN = EOSTable([EOS("linear", 1.0, 1.0)])


# --- in a law


def state(table: EOSTable, energy: float | None = None) -> EosState:
    n = 40
    type_n, energy_n = np.arange(n) % len(table) + 1, None if energy is None else np.linspace(energy, 2.1, n)
    return EosState(np.arange(1, n + 1), type_n, np.linspace(0.71, 1.53, n), np.full(n, 1.3), energy_n)


def mistaken(name: str, table: EOSTable, scene: EosState) -> Any:
    return pressure(BY_NAME[name], table, scene)


@pytest.mark.parametrize(
    ("table", "energy", "blind"),
    [
        (ODD, None, []),
        (PLAIN, None, ["cs instead of cs^2", "cs ignored", "rho0 ignored", "rho0 and cs exchanged"]),
        (EOSTable([EOS("linear", 1.2, 3.4)]), None, []),
        (EOSTable([EOS("ideal/gas", parameter=1.4)]), 0.9, []),
    ],
)
def test_parameters_of_one_hide_mistakes_in_their_factors(
    table: EOSTable, energy: float | None, blind: list[str]
) -> None:
    scene = state(table, energy)
    bound_n = bounds.comparison(table, scene.rho_n, scene.type_n, scene.e_n)
    assert undetected_in_laws(table, scene, evaluate(table, scene), bound_n) == blind
    unit = replace(scene, mass_n=np.ones(40))
    names = undetected_in_laws(table, unit, evaluate(table, unit), bounds.comparison(table, *_given(unit)))
    assert ("energy not per unit mass" in names) == (energy is not None), "only unit masses hide it"


def _given(scene: EosState) -> tuple[Any, ...]:
    return scene.rho_n, scene.type_n, scene.e_n


@pytest.mark.parametrize("name", IN_LAWS)
def test_mistake_changes_the_pressure_or_does_not_apply(name: str) -> None:
    scene = state(ODD)
    p_n = mistaken(name, ODD, scene)
    assert (p_n is None) == (name in ("gamma instead of gamma - 1", "energy not per unit mass"))
    assert p_n is None or (p_n.dtype == np.float64 and not np.array_equal(p_n, evaluate(ODD, scene)))


LINEAR = EOS("linear", 1.2, 2.25, background=0.3)
CUBIC = EOS("cubic", 1.2, 2.25, 0.7, 0.3)
TAIT = EOS("tait/general", 1.2, 2.25, 4.1, 0.3)
WATER = EOS("tait/water", 1.2, 2.25, background=0.3)
GAS = EOS("ideal/gas", parameter=1.4, background=0.3)
# A law that each mistake applies to, the resulting law, and laws that it leaves unchanged.
MADE: dict[str, tuple[EOS, EOS, tuple[EOS, ...]]] = {
    "cs instead of cs^2": (LINEAR, EOS("linear", 1.2, 1.5, background=0.3), (GAS,)),
    "cs ignored": (CUBIC, EOS("cubic", 1.2, 1.0, 0.7, 0.3), (GAS,)),
    "rho0 ignored": (TAIT, EOS("tait/general", 1.0, 2.25, 4.1, 0.3), (GAS,)),
    "rho0 and cs exchanged": (WATER, EOS("tait/water", 2.25, 1.2, background=0.3), (GAS,)),
    "cs off by 1e-6": (LINEAR, EOS("linear", 1.2, 2.25 * (1 + 1e-6), background=0.3), (GAS,)),
    "background dropped": (GAS, EOS("ideal/gas", parameter=1.4), (EOS("linear"),)),
    "background subtracted": (GAS, EOS("ideal/gas", parameter=1.4, background=-0.3), (EOS("linear"),)),
    "A3 dropped": (CUBIC, EOS("cubic", 1.2, 2.25, 0.0, 0.3), (TAIT, GAS, EOS("cubic", parameter=0.0))),
    "A3 of the wrong sign": (CUBIC, EOS("cubic", 1.2, 2.25, -0.7, 0.3), (TAIT, GAS, EOS("cubic", parameter=0.0))),
    "exponent 7 for every Tait law": (TAIT, EOS("tait/general", 1.2, 2.25, 7.0, 0.3), (WATER, LINEAR, CUBIC, GAS)),
    "exponent off by one": (WATER, EOS("tait/general", 1.2, 2.25, 8.0, 0.3), (LINEAR, CUBIC, GAS)),
    "linear instead of Tait or cubic": (TAIT, LINEAR, (LINEAR, EOS("tait/general", parameter=1.0), GAS)),
    "gamma instead of gamma - 1": (GAS, EOS("ideal/gas", parameter=2.4, background=0.3), (TAIT, CUBIC)),
}


@pytest.mark.parametrize("name", MADE)
def test_mistake_turns_a_law_into_another(name: str) -> None:
    """This concerns the types that it applies to; without any such type there is no mistake."""
    law, wrong, others = MADE[name]
    for other in others:
        alone, both, expected = EOSTable([other]), EOSTable([law, other]), EOSTable([wrong, other])
        scene = state(both, 0.9)
        assert mistaken(name, alone, state(alone, 0.9)) is None
        np.testing.assert_array_equal(mistaken(name, both, scene), evaluate(expected, scene))


def test_exponent_off_by_one_is_never_zero() -> None:
    p_n = mistaken("exponent off by one", EOSTable([EOS("tait/general", 1.2, parameter=-1.0)]), state(PLAIN))
    np.testing.assert_array_equal(p_n, evaluate(EOSTable([EOS("tait/general", 1.2, parameter=0.5)]), state(PLAIN)))


def test_mistakes_in_the_arguments_of_a_law() -> None:
    three, two = EOSTable([LINEAR, TAIT, GAS]), EOSTable([LINEAR, TAIT])
    scene = state(three, 0.9)
    p_n = evaluate(three, scene)
    for name, right_n in {
        "sign of the pressure": -p_n,
        "types exchanged": evaluate(EOSTable([TAIT, GAS, LINEAR]), scene),
        "energy not per unit mass": evaluate(three, replace(scene, mass_n=np.ones(40))),
        "density in float32": evaluate(three, replace(scene, rho_n=np.float64(np.float32(scene.rho_n)))),
        "pressure in float32": np.float64(np.float32(p_n)),
    }.items():
        np.testing.assert_array_equal(mistaken(name, three, scene), right_n, err_msg=name)
    exchanged_n = evaluate(EOSTable([TAIT, LINEAR]), state(two))
    np.testing.assert_array_equal(mistaken("types exchanged", two, state(two)), exchanged_n, err_msg="no energy")


@pytest.mark.parametrize(
    ("name", "table", "scene"),
    [
        ("energy not per unit mass", EOSTable([LINEAR]), state(PLAIN, 0.9)),
        ("energy not per unit mass", EOSTable([GAS]), state(PLAIN)),
        ("types exchanged", EOSTable([LINEAR, GAS]), state(ODD)),
        ("types exchanged", PLAIN, state(PLAIN)),
    ],
)
def test_mistake_in_absent_energies_or_types_does_not_apply(name: str, table: EOSTable, scene: EosState) -> None:
    assert mistaken(name, table, scene) is None


@pytest.mark.parametrize(("bound", "seen"), [(0.5, True), (1.0, False), (2.0, False)])
def test_mistake_is_detected_by_a_particle_outside_its_bound(bound: float, seen: bool) -> None:
    """A pressure of one half with the wrong sign is off by one; particles at rho0 do not show it."""
    scene = EosState(np.arange(1, 4), np.ones(3, int), np.array([1.0, 1.5, 1.0]), np.ones(3))
    names = undetected_in_laws(PLAIN, scene, evaluate(PLAIN, scene), np.full(3, bound))
    assert ("sign of the pressure" in names) == (not seen)


def test_overflow_of_float32_is_detected_without_a_warning() -> None:
    table = EOSTable([EOS("linear", 1.0, 1e25)])
    scene = state(table)
    scene.rho_n[7] = 1e39
    assert np.isinf(mistaken("pressure in float32", table, scene)).any()
    names = undetected_in_laws(table, scene, evaluate(table, scene), np.ones(40))
    assert not {"pressure in float32", "density in float32"} & set(names)


# --- in the particle model

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


@cache
def first_evaluation(name: str) -> Problem:
    (case,) = casefile.select(casefile.load(), [name])
    return problem_of(case.scene, prepared_case.prepare(case).atoms, case.where, (0,))


@cache
def blind(name: str) -> list[str]:
    problem = first_evaluation(name)
    return undetected_in_model(problem, Predictor(None).predict(problem))


def evaluated(problem: Problem, stages: type[ArrayEvaluator] = ArrayEvaluator) -> Simulation:
    sim: Simulation = problem.simulation(stages)
    with np.errstate(all="ignore"):
        sim.setup()
    return sim


@pytest.mark.parametrize("name", [name for name, change in BY_NAME.items() if change.stages])
def test_scene_detects_the_mistake(name: str) -> None:
    problem = first_evaluation(SHOWN[name])
    right, wrong = evaluated(problem), evaluated(problem, BY_NAME[name].stages)
    assert any(not np.array_equal(right.output(f), wrong.output(f), equal_nan=True) for f in problem.fields)
    assert name not in blind(SHOWN[name])


def test_unit_scene_hides_mistakes_but_not_those_in_absent_parts() -> None:
    """Equal arrays are not reported as undetected mistakes if nothing can differ."""
    hidden = {"masses ignored", "rho0 for rho in volumes", "V_i for V_j", "no volume in the force"}
    assert hidden <= set(blind("fluids.unit"))
    for name in ("fluids.unit", "forces.all.quintic.2d"):
        assert not [mistake for mistake in blind(name) if BY_NAME[mistake].walls]
        assert "temperature of the whole energy" not in blind(name)


def test_mistake_uses_the_particles_own_volume() -> None:
    problem = first_evaluation("forces.all.quintic.2d")
    stages: Any = evaluated(problem, BY_NAME["V_i for V_j"].stages).evaluator
    rho_i, rho_j = stages.density_pair(problem.state.rho_n)
    mass_i, mass_j = stages.mass_n[stages.i], stages.mass_n[stages.j]
    assert np.any(mass_i != mass_j) and np.any(mass_i != 1)
    # A quotient and a product in rho_j, and the two quotients here.
    np.testing.assert_allclose(mass_j / rho_j, mass_i / rho_i, rtol=4 * 2.0**-53)


@pytest.mark.parametrize("harmonic", [True, False])
def test_mistake_uses_the_other_mean(harmonic: bool) -> None:
    problem = first_evaluation("forces.all.quintic.2d")
    model = replace(problem.model, pair=replace(problem.model.pair, harmonic_means=harmonic))
    stages = BY_NAME["arithmetic for harmonic mean, or the reverse"].stages
    assert evaluated(replace(problem, model=model), stages).evaluator.model.pair.harmonic_means == (not harmonic)


def test_mistake_uses_the_largest_conductivity(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ArrayEvaluator, "conduction", lambda self: np.array([0.0, 2.0, 1.0]))
    stages: Any = BY_NAME["one conductivity for all types"].stages
    np.testing.assert_array_equal(stages.__new__(stages).conduction(), 2.0)


def test_mistake_may_produce_nan_without_a_warning() -> None:
    class Divides(ArrayEvaluator):
        def density_pair(self, rho_n: Any) -> Any:
            rho_i, rho_j = super().density_pair(rho_n)
            return rho_i, rho_j / (0 * rho_j)

    problem = first_evaluation("fluids.unit")
    with np.errstate(all="raise"):
        prediction = Predictor().predict(problem)
        assert not cannot_distinguish(problem, prediction, Change("here", "", stages=Divides))


@pytest.mark.parametrize(("over", "unseen"), [(1.0, True), (1.5, False)])
def test_mistake_within_the_bound_is_undetected(over: float, unseen: bool) -> None:
    problem, mistake = (
        replace(first_evaluation("forces.all.quintic.2d"), fields=("f",)),
        BY_NAME["no volume in the force"],
    )
    right_nc, wrong_nc = evaluated(problem).output("f"), evaluated(problem, mistake.stages).output("f")
    prediction = Prediction(({"f": right_nc},), ({"f": np.abs(wrong_nc - right_nc) / over},))
    assert cannot_distinguish(problem, prediction, mistake) == unseen


@pytest.mark.parametrize(
    ("fields", "given", "seen"),
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
def test_quantities_in_which_a_mistake_could_show(fields: list[str], given: dict[str, Any], seen: set[str]) -> None:
    """In a scene of two fluids and a solid."""
    type_n, pair = np.array(given.get("types", [1, 2, 3])), {"damp": "rho_damp", "artificial": "artificial_viscosity"}
    model = SimpleNamespace(
        fix=SimpleNamespace(rho_sum="sum" in given),
        pair=SimpleNamespace(**{key: given.get(name, 0.0) for name, key in pair.items()}),
        corrects_gradients="corrects" in given,
    )
    v_nc = np.full((3, 2), [[0.0], [1.0], [given.get("v", 0.0)]])
    state = SimpleNamespace(type_n=type_n, solid_n=type_n == 3, v_nc=v_nc)
    assert set(shown(SimpleNamespace(fields=fields, model=model, state=state))) == seen


def test_mistakes_in_walls_need_scenes_with_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mistakes, "cannot_distinguish", lambda *_: True)
    of_force = [name for name, mistake in BY_NAME.items() if {"f", "artificial"} & set(mistake.shows)]
    plain = [name for name in of_force if not BY_NAME[name].walls]
    problem = replace(first_evaluation("fluids.unit"), fields=("f",))
    fix, n = problem.model.fix, len(problem.state.x_nc)
    for reconstructs, solid, names in ((True, True, of_force), (True, False, plain), (False, True, plain)):
        model = replace(problem.model, fix=replace(fix, interface_reconstruct=reconstructs))
        of = replace(problem, model=model, state=replace(problem.state, solid_n=np.full(n, solid)))
        assert undetected_in_model(of, Prediction((), ())) == names
