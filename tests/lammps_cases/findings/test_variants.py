"""Variants of the reference, the scenes to which they apply, and several of them combined; without LAMMPS."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.findings import outcomes, variants
from lammps_cases.findings.forces import ForcePerVolume, has_forces, has_means_of_zeros
from lammps_cases.findings.kernels import WENDLAND_C4, falls_back
from lammps_cases.findings.thermal import HeatOverDensity
from lammps_cases.findings.variants import Variant, combined
from lammps_cases.findings.walls import WallsSummedAfterSetup, WallVelocityLost, sums_walls
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.particle_scenes import scene
from tests.support.roundings import rounded

Write = Callable[..., Path]


class OtherStepping(Simulation):
    """Another time step."""


class Fitted(HeatOverDensity):
    """A variant that builds on another."""

    factor = 0.0


@pytest.fixture
def problem(case_file: Callable[..., Path]) -> Problem:
    case = casefile.load((case_file(compare=["f"]),))[0]
    return problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))


def variant(stages: type[ArrayEvaluator] | None = None, **options: Any) -> Variant:
    return Variant(lambda problem: True, stages, **options)


def test_without_variants_it_is_the_reference(problem: Problem) -> None:
    assert combined([], problem, {}) == (ArrayEvaluator, Simulation)


def test_several_are_one_class_each_before_the_reference(problem: Problem) -> None:
    made = combined([variant(ForcePerVolume), variant(HeatOverDensity), variant(stepping=OtherStepping)], problem, {})
    assert made is not None
    stages, stepping = made
    assert stages.__mro__[1:4] == (ForcePerVolume, HeatOverDensity, ArrayEvaluator)
    assert stepping.__mro__[1:3] == (OtherStepping, Simulation)
    assert {stages.__module__, stepping.__module__} == {"lammps_cases.comparison.changed"}, (
        "predictions of it can be kept"
    )


def test_derived_variant_replaces_its_base(problem: Problem) -> None:
    for order in ([HeatOverDensity, Fitted], [Fitted, HeatOverDensity], [Fitted, Fitted]):
        made = combined([variant(stages) for stages in order], problem, {})
        assert made is not None
        assert made[0].__bases__ == (Fitted,)


def test_base_variant_adds_nothing_to_a_derived_one() -> None:
    assert variant(HeatOverDensity).within(variant(Fitted, stepping=OtherStepping))
    assert variant(stepping=Simulation).within(variant(Fitted, stepping=OtherStepping))
    assert not variant(Fitted).within(variant(HeatOverDensity))
    assert not variant(HeatOverDensity, stepping=OtherStepping).within(variant(Fitted))
    assert not variant().within(variant(Fitted)), "a case that LAMMPS ends is not part of another"


def test_variant_is_fitted_with_the_others_in_place(problem: Problem) -> None:
    given: list[tuple[Problem, tuple[type, ...], dict[str, Any]]] = []

    def fit(of: Problem, stages: type[ArrayEvaluator], snapshot: dict[str, Any]) -> dict[str, Any]:
        given.append((of, stages.__bases__, snapshot))
        return {"factor": snapshot["ratio"]}

    made = combined([variant(Fitted, fit=fit), variant(ForcePerVolume)], problem, {"ratio": 2.5})
    assert given == [(problem, (Fitted, ForcePerVolume), {"ratio": 2.5})]
    assert made is not None
    assert (vars(made[0])["factor"], Fitted.factor) == (2.5, 0.0)
    assert made[0].__module__ == variants.__name__


def test_variant_that_cannot_be_fitted_explains_nothing(problem: Problem) -> None:
    none = variant(Fitted, fit=lambda of, stages, snapshot: None)
    assert combined([variant(ForcePerVolume), none], problem, {}) is None


def test_a_lost_wall_velocity_leaves_the_extrapolated_difference() -> None:
    """(v_s - v_f) k without the v_s of the manual's v_s + (v_s - v_f) k."""
    built = scene(2, walls=True)
    stages = WallVelocityLost(built.model, built.box, built.state.type_n, built.state.solid_n)
    velocity = stages.wall_velocity(np.array([3.0]), np.array([0.5]), np.array([4.0]))
    assert value(velocity).tolist() == [10.0]


def test_walls_are_summed_once_more_after_the_setup_alone() -> None:
    built = scene(2, walls=True, rho_sum=True)
    own, late = (
        stepping(built.model, built.box, built.state, (), ArrayEvaluator)
        for stepping in (Simulation, WallsSummedAfterSetup)
    )
    for sim in (own, late):
        sim.setup()
    solid_n, summed_n = built.state.solid_n, value(late.evaluator.density_sum())
    assert np.array_equal(late.state.rho_n, np.where(solid_n, summed_n, own.state.rho_n))
    assert not np.array_equal(late.state.rho_n[solid_n], own.state.rho_n[solid_n])
    assert np.array_equal(late.fields["f"], own.fields["f"])


@pytest.mark.parametrize(("field", "shows"), [("f", True), ("virial", True), ("press", True), ("grad/v", False)])
def test_forces_show_in_fields_derived_from_them(problem: Problem, field: str, shows: bool) -> None:
    thin = replace(problem, state=replace(problem.state, rho_n=0.9 * problem.model.mass[problem.state.type_n - 1]))
    assert has_forces(replace(thin, fields=(field,))) is shows


def test_sums_of_walls_show_after_any_set_up(problem: Problem) -> None:
    fix = replace(problem.model.fix, rho_sum=True, interface_reconstruct=True)
    n = len(problem.state.x_nc)
    stops = (ProblemStop(2, np.zeros(n, bool)),)
    walls = replace(
        problem, model=replace(problem.model, fix=fix), state=replace(problem.state, solid_n=np.ones(n, bool))
    )
    assert sums_walls(replace(walls, steps=(2,), stops=stops)) and not sums_walls(replace(walls, steps=(2,)))
    assert not sums_walls(replace(walls, steps=(3,), stops=stops))


def test_lists_are_fitted_before_variants_that_evaluate(problem: Problem) -> None:
    """A variant fitted by a separate run finds the lists in place, in any order."""
    order: list[str] = []

    def noted(name: str) -> Any:
        def fit(*_: object) -> dict[str, object]:
            order.append(name)
            return {}

        return fit

    combined([variant(fit=noted("numbers")), variant(fit=noted("lists"), lists=True)], problem, {})
    assert order == ["lists", "numbers"]


# --- scenes to which they apply

THREE = [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}] * 3
WALLS = {"interface_reconstruct": True}
CUBIC = [{"types": "*", "style": "cubic", "A3": 2.1}]


def stopped(by: str) -> dict[str, Any]:
    return {"steps": 2, "timestep": 0.001, "stops": [{"at": 1, "by": by}]}


@pytest.mark.parametrize(
    ("changes", "ends"),
    [
        ({}, {}),
        ({"rheo": {"rho_sum": True}, "rho": None}, {}),
        (
            {"rheo": {"rho_sum": True, "self_mass": True}, "rho": None},
            {"self-mass-missing": "Illegal fix rheo command: self/mass"},
        ),
        ({"rheo": {"shift": {"exclude": ["1", "3"]}}}, {"exclude-takes-one-range": "Illegal fix rheo command: 3"}),
        ({"rheo": {"shift": {"exclude": ["2"]}}}, {}),
        ({"rheo": {"shift": True}}, {}),
        (
            {"rheo": WALLS, "pressure": CUBIC},
            {"reconstruct-refuses-cubic": "interface reconstruction incompatible with pressure equation of state"},
        ),
        ({"pressure": CUBIC}, {}),
        ({"rheo": WALLS}, {}),
        ({"rheo": WALLS, "evolve": stopped("data")}, {"data-file-of-walls": "rheo_interface_fix_property_atom"}),
        ({"rheo": WALLS, "evolve": stopped("restart")}, {}),
        ({"evolve": stopped("data")}, {}),
        ({"compare": ["stress/t"]}, {"stress-without-pressure-segfault": "SIGSEGV"}),
        ({"compare": ["stress/t", "pressure"]}, {}),
        ({"compare": ["pressure"]}, {}),
    ],
)
def test_refused_scene_is_predicted(case_file: Write, changes: dict[str, Any], ends: dict[str, str]) -> None:
    (case,) = casefile.load((case_file(types=THREE, **{"compare": ["f"]} | changes),))
    foretold = {entry.id: entry.ends(case.scene) for entry in outcomes.ENTRIES}
    assert {name: text for name, text in foretold.items() if text} == ends


@pytest.mark.parametrize(
    ("harmonic", "eta", "conductivity", "steps", "applies"),
    [
        (True, 0.0, 0.7, (0,), True),
        (True, 0.4, 0.0, (0,), True),
        (True, 0.0, None, (0,), True),
        (True, 0.4, None, (0,), False),
        (True, 1.0, 1.0, (0,), False),
        (False, 0.0, 0.0, (0,), False),
        (True, 0.0, 0.0, (0, 3), True),
    ],
)
def test_means_of_zeros_are_harmonic_ones(
    harmonic: bool, eta: float, conductivity: float | None, steps: tuple[int, ...], applies: bool
) -> None:
    problem: Any = SimpleNamespace(
        model=SimpleNamespace(
            viscosity=[SimpleNamespace(eta=0.3), SimpleNamespace(eta=eta)],
            thermal=None if conductivity is None else [SimpleNamespace(conductivity=conductivity)],
            pair=SimpleNamespace(harmonic_means=harmonic),
        ),
        steps=steps,
    )
    assert bool(has_means_of_zeros(problem)) == applies


def test_particles_fall_back_where_neighbours_are_or_may_become_few() -> None:
    """With kernels that correct gradients: below zmin at once, in an open box after a step."""
    (case,) = casefile.select(casefile.load(), ["forces.all.rk1.2d"])
    given = problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))
    fix = given.model.fix
    full = replace(given, model=replace(given.model, fix=replace(fix, zmin=3)))
    assert all(full.box.periodic) and not falls_back(full)
    assert falls_back(replace(full, model=replace(full.model, fix=replace(fix, zmin=len(given.state.x_nc)))))
    assert not falls_back(replace(full, steps=(0, 5)))
    opened = replace(full, box=replace(full.box, periodic=(True, False)))
    assert falls_back(replace(opened, steps=(0, 1)))
    (plain,) = casefile.select(casefile.load(), ["forces.all.quintic.2d"])
    assert not falls_back(problem_of(plain.scene, prepared_case.prepare(plain).atoms, "", (0,)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_wendlands_kernel_is_normalised_and_has_its_slope(dimension: int) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(16)  # exact for its degree
    cut = 2.4
    q = 1.5 * (nodes + 1)
    r, area = q * cut / 3, 2 * math.pi * (1 if dimension == 2 else 2)
    w = WENDLAND_C4.normalisation(dimension, cut) * WENDLAND_C4.shape(q)
    integral = (weights * cut / 2 * area * r ** (dimension - 1) * w).sum()
    assert integral == rounded(1.0, 32)  # positive terms: 15 sums, 17 roundings of each
    risen = np.array([(weights * q / 2 * WENDLAND_C4.slope(q * (nodes + 1) / 2)).sum() for q in (1.0, 2.9)])
    assert risen == rounded(WENDLAND_C4.shape(np.array([1.0, 2.9])) - 1.0, 32)  # the same of negative ones
    np.testing.assert_array_equal(WENDLAND_C4.shape(np.array([0.0, 3.0, 3.5])), [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(WENDLAND_C4.slope(np.array([3.0, 3.5])), [0.0, 0.0])


def test_the_shape_is_the_polynomial_of_wendland() -> None:
    u = Polynomial([0.0, 1 / 3])
    derivative, q = ((1 - u) ** 6 * (1 + 6 * u + 35 / 3 * u**2)).deriv(), np.linspace(0.0, 3.0, 50)
    # Every coefficient is a sum of at most 8 products of as many factors: 16 roundings of the same with u for -u.
    rounding = 16 * EPS * ((1 + u) ** 6 * (1 + 6 * u + 35 / 3 * u**2)).deriv()(q)
    assert np.all(np.abs(WENDLAND_C4.slope(q) - derivative(q)) <= rounding)
