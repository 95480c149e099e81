"""The stretching drop: Euler's equation, area and energy."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.analytic.drops import Ellipse, stretched

RADIUS, RATE = 1.7, 0.6
TIMES = (0.1, 0.5, 1.3, 3.0, 4.9)
times = pytest.mark.parametrize("t", TIMES)
D = 1e-4  # step of central differences
EPS = float(np.finfo(float).eps)


def slopes(t: float) -> tuple[float, float, float]:
    later, earlier = stretched(RADIUS, RATE, t + D), stretched(RADIUS, RATE, t - D)
    a, b, rate = ((getattr(later, k) - getattr(earlier, k)) / (2 * D) for k in ("a", "b", "rate"))
    return a, b, rate


def off(e: Ellipse) -> tuple[float, float]:
    r"""Bounds of the relative errors of the slopes of an axis and of the rate A.

    Truncation is d^2/6 times the third derivative, which is at most 8 A^2 times the first for an axis, and
    |22 - 28 T^2| A^2 times it for the rate, T = tanh of twice the strain. Rounding is 4 eps of a value over d.
    """
    tanh = (e.a**2 - e.b**2) / (e.a**2 + e.b**2)
    rounding = 4 * EPS / (D * e.rate)
    return 8 / 6 * (e.rate * D) ** 2 + rounding, 22 / 6 * (e.rate * D) ** 2 + rounding / tanh


@times
def test_axes_and_rate_follow_their_equations(t: float) -> None:
    e, (a_t, b_t, rate_t) = stretched(RADIUS, RATE, t), slopes(t)
    of_axis, of_rate = off(e)
    assert abs(a_t / (e.rate * e.a) - 1) < of_axis
    assert abs(b_t / (-e.rate * e.b) - 1) < of_axis
    assert abs(rate_t / (e.rate**2 * (e.b**2 - e.a**2) / (e.a**2 + e.b**2)) - 1) < of_rate


@times
def test_euler_equation(t: float) -> None:
    """Acceleration of the fluid against the pressure gradient; no pressure on the surface."""
    e, rho = stretched(RADIUS, RATE, t), 1.3
    place = np.array([[0.3 * e.a, -0.4 * e.b], [-0.5 * e.a, 0.2 * e.b]])
    rate_t = slopes(t)[2]
    acceleration = np.stack([(rate_t + e.rate**2) * place[:, 0], (-rate_t + e.rate**2) * place[:, 1]], axis=1)
    for axis in (0, 1):
        step = D * np.eye(2)[axis]
        gradient = (e.pressure(place + step, rho) - e.pressure(place - step, rho)) / (2 * D)  # of a parabola: exact
        bound_n = np.abs(rate_t * place[:, axis]) * off(e)[1] + 4 * EPS * e.centre / D
        assert (np.abs(acceleration[:, axis] + gradient / rho) < bound_n).all()
    angle = np.linspace(0.0, 6.0, 13)
    on_surface = np.stack([e.a * np.cos(angle), e.b * np.sin(angle)], axis=1)
    # Places, quotients and squares are rounded, 3 eps together, and then two differences of numbers below 1.
    np.testing.assert_allclose(e.pressure(on_surface, rho), 0.0, atol=5 * EPS * rho * e.centre)


@times
def test_area_and_energy_stay(t: float) -> None:
    """Each within half an eps per operation: 4 of the area; 16 of the energy, with those of exp and cosh."""
    e = stretched(RADIUS, RATE, t)
    assert abs(e.a * e.b / RADIUS**2 - 1) <= 2 * EPS
    assert abs(e.rate**2 * (e.a**2 + e.b**2) / (2 * RATE**2 * RADIUS**2) - 1) <= 8 * EPS


def test_drop_starts_round() -> None:
    assert stretched(RADIUS, RATE, 0.0) == Ellipse(RADIUS, RADIUS, RATE)
    x_nc = np.array([[1.0, 2.0]])
    np.testing.assert_array_equal(stretched(RADIUS, RATE, 0.0).velocity(x_nc), RATE * x_nc * [1, -1])


def test_quadrature_has_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    last = stretched(RADIUS, RATE, 3 / RATE)
    monkeypatch.setattr("eos_ref.analytic.drops.NODES", 80)
    finer = stretched(RADIUS, RATE, 3 / RATE)
    # Sums of 40 and 80 terms, added pairwise in blocks of 8, are off by some 7 eps each; the strain is 1.6.
    assert abs(finer.a / last.a - 1) <= 24 * EPS


def test_bad_input() -> None:
    for radius, rate, t in ((0.0, 1.0, 0.1), (1.0, -1.0, 0.1), (1.0, 1.0, -0.1), (1.0, 1.0, 3.1)):
        with pytest.raises(InputError, match="must"):
            stretched(radius, rate, t)
