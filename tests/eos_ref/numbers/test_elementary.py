"""The elementary functions in every number type."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flint import arb, ctx

from eos_ref.numbers import elementary
from tests.support.eos_cases import EPS

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
