"""The stretching drop: Euler's equation, area and energy."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.analytic.drops import Ellipse, stretched

RADIUS, RATE = 1.7, 0.6
TIMES = (0.1, 0.5, 1.3, 3.0, 4.9)
times = pytest.mark.parametrize("t", TIMES)
DIFFERENCE = 1e-8  # truncation of central differences at a step of 1e-4, and rounding over the step


def slopes(t: float) -> tuple[float, float, float]:
    d = 1e-4
    later, earlier = stretched(RADIUS, RATE, t + d), stretched(RADIUS, RATE, t - d)
    a, b, rate = ((getattr(later, k) - getattr(earlier, k)) / (2 * d) for k in ("a", "b", "rate"))
    return a, b, rate


@times
def test_axes_and_rate_follow_their_equations(t: float) -> None:
    e, (a_t, b_t, rate_t) = stretched(RADIUS, RATE, t), slopes(t)
    assert a_t == pytest.approx(e.rate * e.a, rel=DIFFERENCE)
    assert b_t == pytest.approx(-e.rate * e.b, rel=DIFFERENCE)
    assert rate_t == pytest.approx(e.rate**2 * (e.b**2 - e.a**2) / (e.a**2 + e.b**2), rel=10 * DIFFERENCE)


@times
def test_euler_equation(t: float) -> None:
    """Acceleration of the fluid against the pressure gradient; no pressure on the surface."""
    e, rho, d = stretched(RADIUS, RATE, t), 1.3, 1e-4
    place = np.array([[0.3 * e.a, -0.4 * e.b], [-0.5 * e.a, 0.2 * e.b]])
    rate_t = slopes(t)[2]
    acceleration = np.stack([(rate_t + e.rate**2) * place[:, 0], (-rate_t + e.rate**2) * place[:, 1]], axis=1)
    for axis in (0, 1):
        step = d * np.eye(2)[axis]
        gradient = (e.pressure(place + step, rho) - e.pressure(place - step, rho)) / (2 * d)
        np.testing.assert_allclose(acceleration[:, axis], -gradient / rho, rtol=1e-6)
    angle = np.linspace(0.0, 6.0, 13)
    on_surface = np.stack([e.a * np.cos(angle), e.b * np.sin(angle)], axis=1)
    np.testing.assert_allclose(e.pressure(on_surface, rho), 0.0, atol=1e-14)


@times
def test_area_and_energy_stay(t: float) -> None:
    e = stretched(RADIUS, RATE, t)
    assert e.a * e.b == pytest.approx(RADIUS**2, rel=1e-14)
    assert e.rate**2 * (e.a**2 + e.b**2) == pytest.approx(2 * RATE**2 * RADIUS**2, rel=1e-14)


def test_begins_round() -> None:
    assert stretched(RADIUS, RATE, 0.0) == Ellipse(RADIUS, RADIUS, RATE)
    x_nc = np.array([[1.0, 2.0]])
    np.testing.assert_array_equal(stretched(RADIUS, RATE, 0.0).velocity(x_nc), RATE * x_nc * [1, -1])


def test_quadrature_has_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    last = stretched(RADIUS, RATE, 3 / RATE)
    monkeypatch.setattr("eos_ref.analytic.drops.NODES", 80)
    finer = stretched(RADIUS, RATE, 3 / RATE)
    assert finer.a == pytest.approx(last.a, rel=1e-14)


def test_bad_input() -> None:
    for radius, rate, t in ((0.0, 1.0, 0.1), (1.0, -1.0, 0.1), (1.0, 1.0, -0.1), (1.0, 1.0, 3.1)):
        with pytest.raises(InputError, match="must"):
            stretched(radius, rate, t)
