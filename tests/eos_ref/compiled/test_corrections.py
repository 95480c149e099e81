"""Compiled reproducing kernels: their basis, their matrices, and the polynomials that their gradients reproduce."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref.compiled import corrections
from eos_ref.compiled.evaluator import LANES, CompiledEvaluator
from eos_ref.compiled.vectors import graded
from eos_ref.kernels import reproducing
from tests.support.particle_scenes import scene

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("order", "dimension"), [(1, 2), (1, 3), (2, 2), (2, 3)])
def test_basis_is_that_of_the_arrays(order: int, dimension: int) -> None:
    """Every basis function, and every product of two, at a point: as a factor times a monomial."""
    basis = corrections.Basis(order, dimension)
    u = [0.5, -0.25, 0.75][:dimension]
    monomial = np.array([np.prod([u[a] for a in axes]) for axes in graded(dimension, 2 * order)])
    h = np.array(reproducing.basis(order, u))
    assert basis.moments == len(monomial)
    assert np.array_equal(basis.factor_b * monomial[basis.place_b], h)
    assert np.array_equal(np.outer(basis.factor_b, basis.factor_b) * monomial[basis.index_bb], np.outer(h, h))


@pytest.mark.parametrize("particles", [3, 8, 11])
def test_coefficients_are_columns_of_the_inverse(particles: int) -> None:
    """Of RK1 in 2D, for fewer particles than lanes, as many, and more; a matrix without a factor is left out."""
    basis, random = corrections.Basis(1, 2), np.random.default_rng(2)
    u_nkc = random.uniform(-1, 1, (particles, 9, 2))
    axes = graded(2, 2)
    moment_nm = np.stack([np.prod(u_nkc[..., list(a)], axis=-1).mean(axis=1) for a in axes], axis=1)
    moment_nm[1] = -moment_nm[1]
    corrected_n = np.ones(particles, bool)
    corrected_n[0] = False  # below zmin
    out_nf = np.zeros((particles, 6))
    tables = basis.index_bb, basis.place_b, basis.factor_b
    corrections.coefficients(moment_nm, *tables, -2.0, corrected_n, LANES, out_nf)
    assert np.array_equal(corrected_n, np.arange(particles) > 1)
    assert not out_nf[:2].any()
    for n in range(2, particles):
        matrix_bb = moment_nm[n][basis.index_bb]
        expected_bc = -2.0 * np.linalg.inv(matrix_bb)[:, 1:]
        # Columns of a Cholesky solution and of an LU inverse: (3 b + 1) b and 4 b^2 times b roundings of condition
        # number times U (Higham, Accuracy and Stability of Numerical Algorithms, theorems 10.4 and 9.4), b = 3.
        bound_c = (30 + 36 * 3) * 3 * 2.0**-53 * np.linalg.cond(matrix_bb) * np.linalg.norm(expected_bc, axis=0)
        assert (np.abs(out_nf[n].reshape(3, 2) - expected_bc) <= bound_c).all()


@pytest.mark.parametrize(("kernel", "power"), [("RK1", 1), ("RK2", 2)])
@pytest.mark.parametrize("dimension", [2, 3])
def test_gradients_of_polynomials_are_exact(kernel: str, power: int, dimension: int) -> None:
    """Of the degree of the order, in the middle of a disordered block; those of the quintic spline are far off."""
    built = scene(dimension, cells=(8,) * dimension, kernel=kernel, one_type=True, cut=2.625)
    x_nc = built.state.x_nc
    middle_n = (np.abs(x_nc - 4) < 1.25).all(axis=1)  # whose neighbours lie in the same image
    state = replace(built.state, energy_n=x_nc[:, 0] ** power - x_nc[:, 1])
    true_nc = np.zeros(x_nc.shape)
    true_nc[:, 0], true_nc[:, 1] = power * x_nc[:, 0] ** (power - 1), -1.0
    evaluator = CompiledEvaluator(built.model, built.box, state.type_n, state.solid_n)
    evaluator.move(x_nc)
    plain_nc = evaluator.gradients(state, want=["energy"]).energy_nc
    evaluator.correct(state.rho_n)
    assert evaluator.corrected_n.all()
    corrected_nc = evaluator.gradients(state, want=["energy"]).energy_nc
    # Some roundings of energies up to 72, times the condition of the matrices; any number far below the next would do.
    assert np.abs(corrected_nc - true_nc)[middle_n].max() < 1e-11
    assert np.abs(plain_nc - true_nc)[middle_n].max() > 1e-3
