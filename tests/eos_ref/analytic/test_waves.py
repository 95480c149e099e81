"""Closed solutions of periodic flows: they solve their equations, point by point."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.analytic import waves
from eos_ref.kernels.quintic import QUINTIC

Array = Any
RADIUS, POINTS = 0.25, 24  # of Cauchy's circle: the error of the sum over its points falls with RADIUS**POINTS/POINTS!
EPS = np.finfo(float).eps
K, NU, C, RHO0, AMPLITUDE = 1.7, 0.13, 2.3, 1.4, 0.3
X, Y, T = 0.37, -0.81, 0.6


def derivative(f: Callable[[Array], Array], x: float, order: int) -> float:
    """Derivative of an analytic function by Cauchy's integral over a circle, good to rounding; see `rounding`."""
    angle_n = 2 * np.pi * np.arange(POINTS) / POINTS
    values_n = f(x + RADIUS * np.exp(1j * angle_n))
    mean = np.mean(values_n * np.exp(-1j * order * angle_n))
    return float((math.factorial(order) / RADIUS**order * mean).real)


def rounding(size: float, order: int) -> float:
    """Rounding of a derivative of values of a size: a dozen operations each, divided by the circle's powers."""
    return 12 * EPS * size * math.factorial(order) / RADIUS**order


@pytest.mark.parametrize(
    "solution",
    [
        lambda x, t: waves.shear_wave(x, t, K, NU, AMPLITUDE),
        lambda x, t: waves.heat_wave(x, t, K, NU, AMPLITUDE, 2.0),
    ],
    ids=["shear", "heat"],
)
def test_waves_diffuse(solution: Callable[[Array, Array], Array]) -> None:
    rate = derivative(lambda t: solution(X, t), T, 1)
    spread = NU * derivative(lambda x: solution(x, T), X, 2)
    assert abs(rate - spread) < rounding(3.0, 2)
    assert abs(rate - 1.05 * spread) > 100 * rounding(3.0, 2)


def test_sound_obeys_the_linear_equations() -> None:
    def rho(x: Array, t: Array) -> Array:
        return waves.sound_wave(x, t, K, C, NU, RHO0, AMPLITUDE)[0]

    def v(x: Array, t: Array) -> Array:
        return waves.sound_wave(x, t, K, C, NU, RHO0, AMPLITUDE)[1]

    size = 8.0 * RHO0 * C**2
    mass = derivative(lambda t: rho(X, t), T, 1) + RHO0 * derivative(lambda x: v(x, T), X, 1)
    assert abs(mass) < rounding(size, 1)
    push = C**2 * derivative(lambda x: rho(x, T), X, 1)
    drag = RHO0 * NU * derivative(lambda x: v(x, T), X, 2)
    inertia = RHO0 * derivative(lambda t: v(X, t), T, 1)
    assert abs(inertia + push - drag) < rounding(size, 2)
    assert abs(inertia + push - 1.05 * drag) > 100 * rounding(size, 2)
    assert abs(inertia + 1.05 * push - drag) > 100 * rounding(size, 2)


def test_sound_starts_compressed_and_at_rest() -> None:
    rho, v = waves.sound_wave(np.longdouble(X), np.longdouble(0), K, C, NU, RHO0, AMPLITUDE)
    assert v == 0
    assert abs(float(rho) / (RHO0 * (1 + AMPLITUDE * math.cos(K * X))) - 1) <= 4 * EPS  # eight roundings


def test_vortices_obey_navier_and_stokes() -> None:
    def field(which: int, x: Array, y: Array, t: Array) -> Array:
        return waves.taylor_green(x, y, t, K, NU, AMPLITUDE)[which]

    def along(which: int, axis: int, order: int) -> float:
        def line(s: Array) -> Array:
            x, y, t = (s if a == axis else place for a, place in enumerate((X, Y, T)))
            return field(which, x, y, t)

        return derivative(line, (X, Y, T)[axis], order)

    assert abs(along(0, 0, 1) + along(1, 1, 1)) < rounding(1.0, 1)
    u, v, _ = waves.taylor_green(X, Y, T, K, NU, AMPLITUDE)
    for which in (0, 1):
        spread = NU * (along(which, 0, 2) + along(which, 1, 2))
        push = along(2, which, 1)
        change = along(which, 2, 1) + u * along(which, 0, 1) + v * along(which, 1, 1)
        assert abs(change + push - spread) < rounding(1.0, 2)
        assert abs(change + 1.05 * push - spread) > 100 * rounding(1.0, 2)
        assert abs(change + push - 1.05 * spread) > 100 * rounding(1.0, 2)


@pytest.mark.parametrize("dimension", [2, 3])
def test_viscous_pair_force_is_the_laplacian_alone(dimension: int) -> None:
    """The integral of W'/r x_a x_b is minus the unit tensor; Gauss' quadrature is exact on each piece of the spline."""
    nodes, weights = np.polynomial.legendre.leggauss(6)  # exact to degree 11; the integrand has degree 4 + 3 at most
    q_n = (np.arange(3)[:, None] + (nodes + 1) / 2).ravel()
    sphere = {2: 2 * math.pi, 3: 4 * math.pi}[dimension]
    slope_n = QUINTIC.normalisation(dimension, 3.0) * QUINTIC.slope(q_n)
    trace = sphere * np.sum(np.tile(weights / 2, 3) * slope_n * q_n**dimension)
    # Nodes, weights and 18 additions: an eps each; the spline's fourth powers cancel, and are off by 4 eps each.
    powers_n = sum(k * np.maximum(r - q_n, 0) ** 4 for k, r in ((1, 3), (6, 2), (15, 1)))
    size = sphere * np.sum(
        np.tile(weights / 2, 3) * QUINTIC.normalisation(dimension, 3.0) * 5 * powers_n * q_n**dimension
    )
    assert abs(trace / dimension + 1) < EPS * (20 + 4 * size / dimension)


def test_oscillation_is_recovered() -> None:
    rate, omega, dt = 0.21, 1.9, 0.4
    t = dt * np.arange(1, 9)
    f_t = np.exp(-rate * t) * (0.7 * np.cos(omega * t) - 0.2 * np.sin(omega * t))
    # Least squares lose the condition number; p and q are 2 dt or so times as steep as the rates.
    condition = np.linalg.cond(np.stack([f_t[1:-1], f_t[:-2]], axis=1))
    assert waves.damped_oscillation(f_t, dt) == pytest.approx((rate, omega), abs=8 * EPS * condition / (2 * dt))


def test_signal_without_oscillation_has_no_frequency() -> None:
    assert np.isnan(waves.damped_oscillation(2.0 ** np.arange(6) + 3.0 ** np.arange(6), 1.0)[1])


@pytest.mark.parametrize(
    "call",
    [lambda: waves.sound_wave(X, T, K, C, 2 * C / K), lambda: waves.damped_oscillation(np.ones(3), 1.0)],
)
def test_bad_input_is_refused(call: Callable[[], object]) -> None:
    with pytest.raises(InputError):
        call()
