"""Elementary functions, columns and small matrices in every number type."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

from eos_ref.numbers import elementary
from eos_ref.numbers.columns import joined
from eos_ref.numbers.matrices import cholesky, solve_unit
from eos_ref.numbers.rounded import Decision, Rounded, error
from tests.support.eos_cases import EPS

# --- elementary functions

GAMMAS = (7.0, 2.0, 1.0, 0.01, 0.5, 4.3, 150.0, -1.3, -2.0, -3.0)


def power_minus_one(rho: float, rho0: float, gamma: float) -> arb:
    """The definition, with the sign of a whole power of a negative ratio."""
    before, ctx.prec = ctx.prec, 400
    try:
        power = (arb(gamma) * (abs(arb(rho)).log() - arb(rho0).log())).exp()
        return (-power if rho < 0 and gamma % 2 == 1 else power) - 1
    finally:
        ctx.prec = before


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("rho0", [1.0, 997.3, 1e-290, 1e290])
def test_powm1_keeps_its_digits(gamma: float, rho0: float) -> None:
    """Relative error at most 4 eps (1 + |gamma ln(rho/rho0)|), also where the quotient would leave the floats."""
    change = 10.0 ** np.linspace(-16, -0.1, 60)
    ratios = np.concatenate([1 + change, 1 - change, 10.0 ** np.linspace(-12, 12, 40)])
    rho_n = np.concatenate([rho0 * ratios, 10.0 ** np.linspace(-300, 300, 60)])
    for rho, value in zip(rho_n, elementary.powm1(rho_n, rho0, gamma), strict=True):
        true = power_minus_one(rho, rho0, gamma)
        if rho == rho0:
            assert value == 0
            continue
        if np.isinf(value):
            assert true >= np.finfo(float).max
            continue
        bound = 4 * EPS * (1 + abs(gamma * (math.log(rho) - math.log(rho0))))
        error = float((abs(arb(value) - true) / abs(true)).upper())
        assert error <= bound, f"rho={rho!r} rho0={rho0!r} gamma={gamma}: {error / EPS:.3g} eps"


@pytest.mark.parametrize("gamma", [g for g in GAMMAS if g == round(g)])
def test_powm1_of_a_negative_ratio(gamma: float) -> None:
    """Relative to |rho/rho0|^gamma + 1, and no worse where |rho| is close to rho0."""
    change = 10.0 ** np.linspace(-16, -0.1, 60)
    rho_n = -997.3 * np.concatenate([1 + change, 1 - change, [1.0]])
    for rho, value in zip(rho_n, elementary.powm1(rho_n, 997.3, gamma), strict=True):
        true = power_minus_one(rho, 997.3, gamma)
        bound = 4 * EPS * (1 + abs(gamma * math.log(rho / -997.3))) * (abs(true + 1) + 1)
        assert abs(arb(value) - true) <= bound, f"rho={rho!r}: {value!r}, not {true}"


@pytest.mark.parametrize("gamma", GAMMAS)
def test_powm1_at_the_edges(gamma: float) -> None:
    at = {rho: float(elementary.powm1(np.float64(rho), 997.3, gamma)) for rho in (0.0, -0.0, 997.3, np.inf, np.nan)}
    assert at[997.3] == 0
    assert at[0.0] == at[-0.0] == (-1 if gamma > 0 else np.inf)
    assert at[np.inf] == (np.inf if gamma > 0 else -1)
    assert np.isnan(at[np.nan])
    assert np.isnan(elementary.powm1(-1.0, 997.3, gamma)) == (gamma != round(gamma))


@pytest.mark.parametrize("number", [np.float32, np.float64, np.longdouble])
def test_powm1_keeps_the_type(number: type) -> None:
    assert type(elementary.powm1(number(3), 2.0, 4.3)) is number
    assert elementary.powm1(np.array([3, 4], number), 2.0, 4.3).dtype == number


@pytest.mark.parametrize("gamma", [7.0, 0.5, -2.0])
def test_root1p_undoes_powm1(gamma: float) -> None:
    """ln(1 + y)/gamma: y is exact to 4 eps (1 + |g|), g = gamma ln x; magnified by y/(1 + y) and divided by gamma."""
    x_n = np.linspace(0.2, 3, 57)
    y_n = elementary.powm1(x_n, 1.0, gamma)
    log_n = np.abs(np.log(x_n))
    in_y = 4 * (1 + np.abs(gamma) * log_n) * np.abs(y_n / (1 + y_n)) / abs(gamma)
    # in addition: log1p 2 (two units of the last place), the division, and exp 2
    bound_n = EPS * (in_y + 3 * log_n + 2)
    assert np.all(np.abs(elementary.root1p(y_n, gamma) / x_n - 1) <= bound_n)


def test_root1p_has_no_root_below_minus_one() -> None:
    assert np.isnan(elementary.root1p(-1.5, 7.0))
    assert elementary.root1p(-1.0, 7.0) == 0


@pytest.mark.parametrize("name", ["asin", "asinh", "exp", "log1p", "sin", "sinh", "sqrt"])
def test_unary_functions_of_floats_and_balls(name: str) -> None:
    """Floats lie in the ball to four units of the last place, what numpy's vector functions promise."""
    function = getattr(elementary, name)
    for x in (0.0, 1e-8, 0.25, 0.9):
        ball = function(arb(x))
        assert isinstance(ball, arb)
        assert abs(arb(float(function(x))) - ball) <= 4 * EPS * abs(ball) + ball.rad()
        assert function(np.float32(x)).dtype == np.float32
    assert function.__name__ == name


# --- columns


def test_joined_keeps_errors() -> None:
    a, b = Rounded(np.ones(3), 0.5), np.zeros(3)
    assert error(joined([a, b])).tolist() == [[0.5, 0.0]] * 3


# --- matrices

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
    assert abs(x.value[0] - exact) <= error(x)[0] <= 1e-7 * exact


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
