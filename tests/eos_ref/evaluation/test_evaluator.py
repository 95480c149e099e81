"""Stages that evaluate a particle's sums, against values by hand; the constructor both evaluators share."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import Evaluator, is_class
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.box import Box
from eos_ref.model.parameters import Thermal, Viscosity
from eos_ref.numbers.rounded import Decision, Rounded, value
from eos_ref.syntax.fixes import Shift
from tests.support.particle_scenes import CS, MASS, RHO0, Scene, scene

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
    with pytest.raises(InputError, match="threads: must be a whole number, at least 1, found 0"):
        CompiledEvaluator(built.model, built.box, s.type_n, s.solid_n, threads=0)


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


def test_viscosity_of_each_style() -> None:
    """At the strain rate 2: K rate^(n-1) + tau0/rate with tau0 = eta gd0 - K gd0^n = 0.5 - 0.25."""
    laws = (Viscosity("power", 0.5, 1.0, 0.25, 2.0), Viscosity("constant", 0.7))
    evaluator = stages(scene(2, viscosity=laws))
    G_ncc = np.zeros((evaluator.n, 2, 2))
    G_ncc[:, 0, 1] = 2.0
    expected_n = np.where(evaluator.type_n == 1, 0.25 * 2 + 0.25 / 2, 0.7)
    assert (np.abs(value(evaluator.viscosity(G_ncc)) - expected_n) <= 16 * U * expected_n).all()


def test_temperature_stays_at_freezing_until_the_latent_heat_is_absorbed() -> None:
    thermal = (Thermal(0.1, 2.0, 1.0, 1.5), Thermal(0.1, 2.0))
    evaluator = stages(scene(2, thermal=thermal, one_type=True))
    e_n = np.array([2.0, 3.0, 3.5, 4.0, 5.0])
    evaluator.type_n, evaluator.mass_n = np.ones(5, int), np.full(5, 0.5)
    assert value(evaluator.temperature(0.5 * e_n)).tolist() == [1.0, 1.5, 1.5, 1.5, 2.0]


@pytest.mark.parametrize("periodic", [(True, True), (True, False), (False, False)])
def test_no_particles_have_no_pairs(periodic: tuple[bool, ...]) -> None:
    i, j, shift_pc = directed_pairs(np.zeros((0, 2)), Box((0.0, 0.0), (4.0, 5.0), periodic), 1.0)
    assert i.shape == j.shape == (0,)
    assert shift_pc.shape == (0, 2)
