"""Cholesky factors and solutions of many small matrices at once, for several number types."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.numbers.matrices import cholesky, solve_unit
from eos_ref.numbers.rounded import Decision, Rounded, error, value

SIZES = (1, 2, 3, 6, 10)


def gamma(k: int) -> float:
    """Relative error of k roundings, k u/(1 - k u) (Higham, section 3.1)."""
    u = 2.0**-53
    return k * u / (1 - k * u)


def definite(n: int, size: int) -> Any:
    """Positive definite matrices A A^T + 1, (n, size, size)."""
    a_nij = np.random.default_rng(size).normal(size=(n, size, size))
    return a_nij @ a_nij.transpose(0, 2, 1) + np.eye(size)


def rows(m_nij: Any) -> list[list[Any]]:
    """Rows of the lower triangles, one array per entry."""
    size = m_nij.shape[-1]
    return [[m_nij[:, a, b] for b in range(a + 1)] for a in range(size)]


@pytest.mark.parametrize("size", SIZES)
def test_factors_multiply_to_the_matrix(size: int) -> None:
    m_nij = definite(5, size)
    factor, definite_n = cholesky(rows(m_nij))
    l_nij = np.array([[np.broadcast_to(entry, 5) for entry in row] for row in factor]).transpose(2, 0, 1)
    assert definite_n.all()
    assert not np.triu(l_nij, 1).any()
    size_nij = np.abs(l_nij) @ np.abs(l_nij).transpose(0, 2, 1)
    # Backward error of the factor (Higham, theorem 10.3), and the rounding of the product taken here.
    bound_nij = (gamma(size + 1) + gamma(size)) * size_nij
    assert (np.abs(l_nij @ l_nij.transpose(0, 2, 1) - m_nij) <= bound_nij).all()


@pytest.mark.parametrize("size", SIZES)
def test_solutions_are_columns_of_the_inverse(size: int) -> None:
    m_nij = definite(5, size)
    factor, _ = cholesky(rows(m_nij))
    l_nij = np.array([[np.broadcast_to(entry, 5) for entry in row] for row in factor]).transpose(2, 0, 1)
    size_nij = np.abs(l_nij) @ np.abs(l_nij).transpose(0, 2, 1)
    for row in range(size):
        x_ni = np.stack(np.broadcast_arrays(*solve_unit(factor, row)), axis=-1)
        residual_ni = np.einsum("nij,nj->ni", m_nij, x_ni) - np.eye(size)[row]
        # Backward error of the solution (Higham, theorem 10.4), and the rounding of the residual taken here.
        solved_ni = gamma(3 * size + 1) * np.einsum("nij,nj->ni", size_nij, np.abs(x_ni))
        rounded_ni = gamma(size + 1) * (np.einsum("nij,nj->ni", np.abs(m_nij), np.abs(x_ni)) + np.eye(size)[row])
        assert (np.abs(residual_ni) <= solved_ni + rounded_ni).all()


@pytest.mark.parametrize("last", [0.0, -1.0])
def test_matrices_without_a_factor_are_flagged_and_affect_no_other(last: float) -> None:
    m_nij = np.stack([np.diag([2.0, 4.0]), np.diag([2.0, last]), np.diag([9.0, 1.0])])
    factor, definite_n = cholesky(rows(m_nij))
    assert definite_n.tolist() == [True, False, True]
    assert factor[1][1][[0, 2]].tolist() == [2.0, 1.0]
    assert np.isfinite(solve_unit(factor, 1)[1]).all()


def test_rounding_bound_covers_the_error_of_an_ill_conditioned_matrix() -> None:
    m_nij = np.array([[[1.0, 1.0], [1.0, 1.0 + 2.0**-20]]])
    exact = 2.0**20  # entry 1, 1 of the inverse: 1/determinant
    m = [[Rounded(entry, np.zeros(1)) for entry in row] for row in rows(m_nij)]
    factor, definite_n = cholesky(m)
    assert isinstance(definite_n, Decision)
    x = solve_unit(factor, 1)[1]
    assert abs(value(x)[0] - exact) <= error(x)[0] <= 1e-7 * exact


def test_definiteness_is_open_where_rounding_decides() -> None:
    one, almost = Rounded(np.ones(2), np.zeros(2)), Rounded(np.array([1.0, 2.0]), np.full(2, 1e-15))
    _, definite_n = cholesky([[one], [one, almost]])
    assert definite_n.open.tolist() == [True, False]


@pytest.mark.parametrize("along", [0, 1])
def test_neighbours_in_a_row_along_an_axis_have_no_factor(along: int) -> None:
    """That is certain; for neighbours in a row across the axes rounding decides, and the factor is unbounded."""
    u = [Rounded(np.zeros(3)), Rounded(np.zeros(3))]
    u[along] = Rounded([0.3, -0.4, 0.7], [1e-16] * 3)

    def moments(u_x: Rounded, u_y: Rounded) -> list[list[Rounded]]:
        h = [Rounded(np.ones(3)), u_x, u_y]
        return [[(h[a] * h[b]).sum_by(np.zeros(3, int), 1) for b in range(a + 1)] for a in range(3)]

    factor, definite_n = cholesky(moments(*u))
    assert not definite_n.answer.any() and not definite_n.open.any()
    factor, definite_n = cholesky(moments(u[along], u[along] * 0.7))
    assert definite_n.open.all() and np.isinf(error(factor[2][2])).all()
