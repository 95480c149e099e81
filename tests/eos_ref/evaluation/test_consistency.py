"""Kernels on disordered particles: gradients of polynomials are exact, and where they fall back to the spline.

Tolerances are the rounding bounds that `Rounded` runs give, of both sides of a comparison.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.numbers.rounded import Rounded, error, value
from tests.support.particle_scenes import EPS, Scene, dyadic, scene

pytestmark = pytest.mark.slow

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])
OPEN = {2: ((False, True), 3.0), 3: ((False, True, False), 3.0)}


def free(dimension: int, kernel: str, zmin: int = 0, cut: float = 3.25) -> Scene:
    """A disordered block with free surfaces."""
    periodic, margin = OPEN[dimension]
    return scene(dimension, kernel=kernel, zmin=zmin, cut=cut, periodic=periodic, margin=margin)


def polynomial(x_nc: Any, order: int, random: Any) -> tuple[Any, Any]:
    """A polynomial of an order at the points, and its gradient."""
    d = x_nc.shape[1]
    a, B = dyadic(random.uniform(-1, 1, d)), dyadic(random.uniform(-1, 1, (d, d))) * (order == 2)
    return 0.5 + x_nc @ a + np.einsum("na,ab,nb->n", x_nc, B, x_nc), a + x_nc @ (B + B.T)


@DIMENSIONS
@pytest.mark.parametrize(("kernel", "order"), [("RK1", 1), ("RK2", 2), ("RK2", 1)])
def test_gradients_are_exact(dimension: int, kernel: str, order: int) -> None:
    """RK1 on linear fields, RK2 on quadratic ones, up to a free surface and at its corners.

    The field is made periodic nowhere: every axis is open.
    """
    cells = (6, 5) if dimension == 2 else (3, 4, 3)  # two layers could not carry a quadratic field
    built = scene(dimension, cells=cells, kernel=kernel, cut=3.25, periodic=(False,) * dimension, margin=1.0)
    x_nc = built.state.x_nc
    f_n, true_nc = polynomial(x_nc, order, np.random.default_rng(5))
    evaluator = built.simulate().evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(Rounded(x_nc))
    evaluator.correct(Rounded(built.state.rho_n))
    assert evaluator.corrected_n.all()
    assert value(evaluator.coordination_n).min() < 0.8 * value(evaluator.coordination_n).max(), "the surface is reached"
    field = Rounded(f_n, 8 * EPS * (0.5 + np.abs(x_nc).sum(axis=1) ** 2))  # its own evaluation
    found = evaluator.gradients(
        replace(built.state, rho_n=Rounded(built.state.rho_n), energy_n=field), want=["energy"]
    ).energy_nc
    assert (np.abs(value(found) - true_nc) <= error(found) + 8 * EPS * (1 + np.abs(x_nc)).sum()).all()
    assert error(found).max() < 1e-5  # at the corners moments of RK2 are nearly singular


@DIMENSIONS
def test_lower_kernels_are_not_exact(dimension: int) -> None:
    """The test above is sensitive: RK1 misses quadratic fields, the quintic spline even linear ones."""
    for kernel, order in (("RK1", 2), ("quintic", 1), ("RK0", 1)):
        built = scene(dimension, kernel=kernel, cut=3.25, periodic=(False,) * dimension, margin=1.0)
        f_n, true_nc = polynomial(built.state.x_nc, order, np.random.default_rng(5))
        evaluator = built.simulate().evaluator
        evaluator.move(built.state.x_nc)
        evaluator.correct(built.state.rho_n)
        found = evaluator.gradients(replace(built.state, energy_n=f_n), want=["energy"]).energy_nc
        assert np.abs(found - true_nc).max() > 1e-3


@DIMENSIONS
@pytest.mark.parametrize("kernel", ["RK1", "RK2"])
def test_sums_of_corrected_gradients(kernel: str, dimension: int) -> None:
    r"""sum V gradW = 0 and sum V x(x)gradW = -1, on every particle, the surface's included."""
    built = free(dimension, kernel)
    evaluator = built.simulate().evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(Rounded(built.state.x_nc))
    evaluator.correct(Rounded(built.state.rho_n))
    assert evaluator.corrected_n.all()
    volume = evaluator.mass_n[evaluator.j] / Rounded(built.state.rho_n)[evaluator.j]
    for b in range(dimension):
        zero = evaluator.total(volume * evaluator.g[b])
        assert (np.abs(value(zero)) <= error(zero)).all()
        assert error(zero).max() < 1e-5  # RK2 at the surface
        for a in range(dimension):
            minus = evaluator.total(volume * evaluator.x[a] * evaluator.g[b])
            assert (np.abs(value(minus) + (a == b)) <= error(minus)).all()


@DIMENSIONS
def test_zmin_decides_for_each_side(dimension: int) -> None:
    """A particle below zmin keeps the plain gradient, independent of its neighbours."""
    count = free(dimension, "RK1").simulate(["coordination"]).evaluate()["coordination"]
    zmin = int(np.median(count))
    built = free(dimension, "RK1", zmin)
    evaluator = built.simulate().evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(built.state.x_nc)
    evaluator.correct(built.state.rho_n)
    assert np.array_equal(evaluator.corrected_n, count >= zmin)
    assert 0 < evaluator.corrected_n.sum() < len(count)
    plain = np.array(evaluator.gradw) == np.array(evaluator.g)
    used_p = evaluator.corrected_n[evaluator.i]
    assert plain[:, ~used_p].all()
    assert not plain[:, used_p].all(axis=0).any()


@DIMENSIONS
def test_too_few_neighbours_for_a_matrix(dimension: int) -> None:
    """A pair alone has no moment matrix: it falls back to the spline, without any NaN."""
    built = scene(dimension, kernel="RK2", periodic=(False,) * dimension, margin=9.0)
    s = built.state
    two = built.with_state(**{k: getattr(s, k)[:2] for k in ("x_nc", "v_nc", "rho_n", "type_n", "solid_n")})
    simulation = two.simulate()
    assert np.isfinite(simulation.evaluate()["f"]).all()
    evaluator = simulation.evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    assert not evaluator.corrected_n.any()
    assert np.array_equal(evaluator.g, evaluator.gradw)
