"""Both evaluators against an independent double loop in scalar longdoubles; stages against values by hand."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import Evaluator, is_class
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.box import Box
from eos_ref.numbers.rounded import Decision, Rounded, error, value
from eos_ref.syntax.fixes import Shift
from tests.support.double_loop import DoubleLoop
from tests.support.particle_scenes import CS, MASS, RECIPES, RHO0, Scene, recipe, results, scene

DIMENSIONS = [2, pytest.param(3, marks=pytest.mark.slow)]
THREE = functools.partial(CompiledEvaluator, threads=3)


@functools.cache
def double_loop(name: str, dimension: int) -> tuple[Scene, Any, dict[str, Any], dict[str, Any]]:
    """A scene, accelerations as if left by a step (for Adami's g and a), its fields by the loop, their bounds."""
    built = recipe(name, dimension)
    history_nc = np.random.default_rng(3).uniform(-1, 1, built.state.x_nc.shape)
    double = DoubleLoop(built)
    double.other = [[np.longdouble(c) for c in row] for row in history_nc]
    simulation = built.simulate()
    simulation.other_nc = history_nc
    expected = {field: np.array(values, np.longdouble) for field, values in double.evaluate().items()}
    return built, history_nc, expected, results(simulation.rounded())


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("name", RECIPES)
@pytest.mark.parametrize(
    "evaluator", [ArrayEvaluator, *(pytest.param(k, marks=pytest.mark.slow) for k in (CompiledEvaluator, THREE))]
)
def test_every_field_of_an_evaluation(evaluator: Any, name: str, dimension: int) -> None:
    """Within the bound of the arrays, itself below 1e-10 of the largest value: it could hide no wrong formula."""
    built, history_nc, expected, bound = double_loop(name, dimension)
    simulation = built.simulate(evaluator=evaluator)
    simulation.other_nc = history_nc
    simulation.evaluate()
    found = results(simulation)
    assert found.keys() == bound.keys() == expected.keys()
    for field, values in found.items():
        errors, apart = error(bound[field]), np.abs(values - expected[field])
        assert evaluator is not ArrayEvaluator or np.array_equal(value(bound[field]), values), field
        assert (apart <= errors).all(), f"{field}: {apart.max()} > {errors.max()}"
        assert errors.max() <= 1e-10 * max(np.abs(values).max(), 1.0), field


# --- stages

U = 2.0**-53  # unit roundoff


def stages(built: Scene) -> ArrayEvaluator:
    return ArrayEvaluator(built.model, built.box, built.state.type_n, built.state.solid_n)


def test_both_evaluators_have_one_constructor() -> None:
    built = scene(2, walls=True)
    s = built.state
    for kind in (ArrayEvaluator, CompiledEvaluator):
        evaluator: Evaluator = kind(built.model, built.box, s.type_n.tolist(), s.solid_n)
        assert evaluator.n == len(s.type_n)
        assert evaluator.walls
        for values_n, values_t in ((evaluator.mass_n, MASS), (evaluator.rho0_n, RHO0), (evaluator.cs_n, CS)):
            assert np.array_equal(values_n, np.array(values_t)[s.type_n - 1])
    settled = CompiledEvaluator(built.model, built.box, s.type_n, s.solid_n, 0.25, 2)
    assert (settled.skin, settled.threads) == (0.25, 2)
    for threads in (0, -1, 1.5, "two"):
        with pytest.raises(InputError, match="threads: must be a whole number, at least 1"):
            CompiledEvaluator(built.model, built.box, s.type_n, s.solid_n, threads=threads)


@pytest.mark.parametrize(("left", "bounded"), [(1.0, True), (0.5, False)])
def test_unscaled_shift_needs_no_normal(left: float, bounded: bool) -> None:
    """In a regular lattice the gradient of the color function is pure rounding: it has no direction."""

    class Undirected(ArrayEvaluator):
        def cross_type_normal(self, gradient: Any) -> Any:
            return [Rounded(value(n), np.full(self.n, np.inf)) for n in super().cross_type_normal(gradient)]

    simulation = scene(2, shift=Shift(scale_cross_type=(left, 0.0, 0.0))).simulate(["shift/v"])
    simulation.evaluate()
    assert np.isfinite(simulation.rounded(Undirected).fields["shift/v"].error).all() == bounded


def test_class_is_open_where_its_error_is_nonzero() -> None:
    plain = is_class(np.array([0.0, 1.0]), 1)
    assert isinstance(plain, np.ndarray)
    assert plain.tolist() == [False, True]
    rounded = is_class(Rounded([0.0, 1.0, 1.0], [0.0, 0.0, 1.0]), 1)
    assert isinstance(rounded, Decision)
    assert rounded.answer.tolist() == [False, True, True]
    assert rounded.open.tolist() == [False, False, True]


def test_solid_has_at_least_its_equilibrium_density_in_pair_terms() -> None:
    built = scene(2, walls=True)
    evaluator, solid_n = stages(built), built.state.solid_n
    thin_n = np.full(evaluator.n, 0.5)
    apparent_n = value(evaluator.apparent_density(thin_n))
    assert np.array_equal(apparent_n, np.where(solid_n, evaluator.rho0_n, 0.5))
    assert np.array_equal(value(evaluator.volume_of_wall(thin_n)), evaluator.mass_n / apparent_n)
    assert np.array_equal(value(evaluator.apparent_density(2 * evaluator.rho0_n)), 2 * evaluator.rho0_n)


def test_density_of_a_wall_has_a_lower_limit() -> None:
    """P = c^2 (rho - rho0) + P_b of type 1; far below the pressure of vacuum a tenth of rho0 remains."""
    built = scene(2, walls=True, one_type=True)
    evaluator = stages(built)
    evaluator.move(built.state.x_nc)
    p = np.array([0.25 + CS[0] ** 2 * 0.5, -1e3])
    density = value(evaluator.wall_density(np.array([0, 1]), p, None))
    expected = np.array([RHO0[0] + 0.5, RHO0[0] / 10])
    # At most 8 operations round; P - P_b enlarges the rounding of P.
    assert (np.abs(density - expected) <= 8 * U * (1 + 0.25 / CS[0] ** 2) * expected).all()


def test_same_phase_fraction_of_a_particle_without_neighbours_is_0() -> None:
    evaluator = stages(scene(2))
    evaluator.coordination_n = np.array([0, 2])
    assert value(evaluator.same_fraction(np.array([0.0, 4.0]), np.array([0.0, 3.0]))).tolist() == [0.0, 0.75]


def test_normal_between_types_is_a_unit_vector_or_0() -> None:
    normal = stages(scene(2)).cross_type_normal([np.array([3.0, 0.0]), np.array([-4.0, 0.0])])
    assert [value(c).tolist() for c in normal] == [[0.6, 0.0], [-0.8, 0.0]]


@pytest.mark.parametrize("periodic", [(True, True), (True, False), (False, False)])
def test_no_particles_have_no_pairs(periodic: tuple[bool, ...]) -> None:
    i, j, shift_pc = directed_pairs(np.zeros((0, 2)), Box((0.0, 0.0), (4.0, 5.0), periodic), 1.0)
    assert i.shape == j.shape == (0,)
    assert shift_pc.shape == (0, 2)
