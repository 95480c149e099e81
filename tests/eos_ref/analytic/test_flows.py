"""Analytic solutions of smooth flows: they solve their equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, InputError
from eos_ref.analytic import waves
from eos_ref.analytic.channel import NEGLIGIBLE, column, depth_below_surface, plane_start_up, weight_of_column
from eos_ref.analytic.drops import Ellipse, stretched
from eos_ref.kernels.quintic import QUINTIC

# --- plane flow and the column at rest

LONG, LONG_EPS = np.longdouble, float(np.finfo(np.longdouble).eps)
WIDTH, NU = LONG("1.7"), LONG("0.3")
DRIVES = {"force": {"gravity": LONG("0.9")}, "plate": {"speed": LONG("-1.1")}, "both": {"gravity": 2, "speed": 3}}
drives = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
TIMES = (0.01, 0.1, 1.0, 3.0)  # from a thin layer at the walls to 5 % from the steady flow


def residual(flow: Callable[..., Any], t: Any, gravity: Any, nu: Any) -> float:
    """Residual of du/dt = nu d2u/dy2 + g, over the largest term."""
    y_n, d = WIDTH * np.linspace(LONG(0.05), LONG(0.95), 19), WIDTH * LONG(1e-4)
    dt = min(t, WIDTH**2 / (np.pi**2 * NU)) * LONG(1e-4)  # of the age of the flow, or the life of its slowest mode
    u_t = (flow(y_n, t + dt) - flow(y_n, t - dt)) / (2 * dt)
    u_yy = (flow(y_n + d, t) - 2 * flow(y_n, t) + flow(y_n - d, t)) / d**2
    scale = np.abs(nu * u_yy).max() + abs(gravity)
    return float(np.abs(u_t - nu * u_yy - gravity).max() / scale)


@drives
@pytest.mark.parametrize("t", TIMES)
def test_diffusion(drive: dict[str, Any], t: float) -> None:
    found = residual(lambda y_n, s: plane_start_up(y_n, s, WIDTH, NU, **drive), LONG(t), drive.get("gravity", 0), NU)
    # Differences are off by the relative steps squared, times fourth derivatives: (width/layer)^2 at most.
    assert found < 1e-8 * max(1.0, float(WIDTH**2 / (NU * t)))


@pytest.mark.parametrize(("nu", "gravity"), [(1.05, 1.0), (1.0, 1.02)])
def test_diffusion_detects_wrong_solutions(nu: float, gravity: float) -> None:
    def flow(y_n: Any, t: Any) -> Any:
        return plane_start_up(y_n, t, WIDTH, nu * NU, gravity)

    assert residual(flow, LONG(0.1), LONG(1.0), NU) > 0.005


def off_by(drive: dict[str, Any], t: float) -> float:
    """Bound of off_by errors: half an eps per addition of a mode, and the errors of every mode.

    The argument n pi s of a sine is off by 1.5 eps, the exponent by 5 eps, the factors of the amplitude by 8 eps.
    """
    speed, rate = abs(float(drive.get("speed", 0))), float(NU / WIDTH**2) * t
    force = abs(float(drive.get("gravity", 0))) * float(WIDTH**2 / NU)
    k_n = np.pi * np.arange(1, int(np.sqrt(NEGLIGIBLE / (np.pi**2 * rate))) + 2)
    size_n = (2 * speed / k_n + 4 * force / k_n**3) * np.exp(-(k_n**2) * rate)
    modes = np.sum(size_n * (1.5 * k_n + 8 + 5 * k_n**2 * rate))
    return LONG_EPS * float(len(k_n) * (speed + force / 8) / 2 + modes)


@drives
def test_walls_and_start(drive: dict[str, Any]) -> None:
    ends_n, inside_n = np.array([0, WIDTH]), WIDTH * np.linspace(LONG(0.2), LONG(0.8), 5)
    for t in TIMES:
        at_walls = plane_start_up(ends_n, LONG(t), WIDTH, NU, **drive)
        np.testing.assert_allclose(at_walls, [0, drive.get("speed", 0)], rtol=0, atol=off_by(drive, t))
    assert not plane_start_up(inside_n, 0.0, WIDTH, NU, **drive).any()
    early = LONG("1e-4")  # far from walls only the force acts so far
    early_n = plane_start_up(inside_n, early, WIDTH, NU, **drive)
    np.testing.assert_allclose(early_n, drive.get("gravity", 0) * early, rtol=0, atol=off_by(drive, float(early)))


LAWS = (EOS("linear", 1.3, 2.1), EOS("tait/water", 0.9, 3.0, background=0.4), EOS("tait/general", 1.1, 1.7, 1.4))
laws = pytest.mark.parametrize("law", LAWS, ids=lambda law: law.style)


@laws
def test_pressure_carries_the_weight(law: EOS) -> None:
    """dP/dz = rho g; the difference is off by d^2/6 |2 - gamma| (g/c^2)^2 of itself, and by rounding over d."""
    gravity, z_n, d = LONG("0.21"), np.linspace(LONG("0.1"), LONG(4), 9), LONG("1e-5")
    slope_n = (weight_of_column(law, z_n + d, gravity) - weight_of_column(law, z_n - d, gravity)) / (2 * d)
    rho_n = law.density(weight_of_column(law, z_n, gravity) + law.background)
    truncation = d**2 / 6 * abs(2 - (law.exponent or 1)) * (gravity / law.cs**2) ** 2
    pressure_n = weight_of_column(law, z_n, gravity) + law.rho0 * law.cs**2
    rounding_n = 4 * LONG_EPS * pressure_n / (d * slope_n) + 4 * np.finfo(float).eps  # densities are doubles
    assert (np.abs(slope_n / (rho_n * gravity) - 1) < truncation + rounding_n).all()
    assert np.abs(slope_n / (1.02 * rho_n * gravity) - 1).min() > 0.01  # 2 % more gravity would be detected


@laws
def test_column_has_its_mass(law: EOS) -> None:
    """Mass above a depth is the integral of the density; places and densities agree with the law.

    Depths and densities are good to some eps, times the condition number c^2/(g z) of the depth of a density.
    """
    gravity, mass = 0.21, 5.0
    depth, rho = column(law, mass, gravity)
    places, weights = np.polynomial.legendre.leggauss(30)
    z_n = depth / 2 * (places + 1)
    rho_n = law.density(weight_of_column(law, z_n, gravity) + law.background)
    eps = float(np.finfo(float).eps)
    condition_n = 1 + law.sound_speed(rho_n) ** 2 / (gravity * z_n)
    of_depth = 1 + float(law.sound_speed(rho)) ** 2 / (gravity * depth)
    assert abs(depth / 2 * float(weights @ rho_n) / mass - 1) < 4 * eps * of_depth
    assert rho == float(law.density(law.background + mass * gravity))
    assert (np.abs(depth_below_surface(law, rho_n, gravity) / z_n - 1) < 4 * eps * condition_n).all()


def test_bad_input_of_channels() -> None:
    for law in (EOS("cubic", 1.0, 1.0, 0.5), EOS("tait/general", 1.0, 1.0, 1.0)):
        with pytest.raises(InputError, match="law of a column"):
            column(law, 1.0, 0.1)
    with pytest.raises(InputError, match="gravity"):
        weight_of_column(LAWS[0], 1.0, 0.0)
    for t, width, nu in ((-1.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, -1.0)):
        with pytest.raises(InputError, match="must"):
            plane_start_up(np.zeros(1), t, width, nu)


# --- waves and vortices


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
def test_bad_input_of_waves(call: Callable[[], object]) -> None:
    with pytest.raises(InputError):
        call()


# --- the stretching drop

RADIUS_OF_DROP, RATE = 1.7, 0.6
TIMES_OF_DROP = (0.1, 0.5, 1.3, 3.0, 4.9)
times = pytest.mark.parametrize("t", TIMES_OF_DROP)
STEP = 1e-4  # step of central differences


def slopes(t: float) -> tuple[float, float, float]:
    later, earlier = stretched(RADIUS_OF_DROP, RATE, t + STEP), stretched(RADIUS_OF_DROP, RATE, t - STEP)
    a, b, rate = ((getattr(later, k) - getattr(earlier, k)) / (2 * STEP) for k in ("a", "b", "rate"))
    return a, b, rate


def off(e: Ellipse) -> tuple[float, float]:
    r"""Bounds of the relative errors of the slopes of an axis and of the rate A.

    Truncation is d^2/6 times the third derivative, which is at most 8 A^2 times the first for an axis, and
    |22 - 28 T^2| A^2 times it for the rate, T = tanh of twice the strain. Rounding is 4 eps of a value over d.
    """
    tanh = (e.a**2 - e.b**2) / (e.a**2 + e.b**2)
    rounding = 4 * EPS / (STEP * e.rate)
    return 8 / 6 * (e.rate * STEP) ** 2 + rounding, 22 / 6 * (e.rate * STEP) ** 2 + rounding / tanh


@times
def test_axes_and_rate_follow_their_equations(t: float) -> None:
    e, (a_t, b_t, rate_t) = stretched(RADIUS_OF_DROP, RATE, t), slopes(t)
    of_axis, of_rate = off(e)
    assert abs(a_t / (e.rate * e.a) - 1) < of_axis
    assert abs(b_t / (-e.rate * e.b) - 1) < of_axis
    assert abs(rate_t / (e.rate**2 * (e.b**2 - e.a**2) / (e.a**2 + e.b**2)) - 1) < of_rate


@times
def test_euler_equation(t: float) -> None:
    """Acceleration of the fluid against the pressure gradient; no pressure on the surface."""
    e, rho = stretched(RADIUS_OF_DROP, RATE, t), 1.3
    place = np.array([[0.3 * e.a, -0.4 * e.b], [-0.5 * e.a, 0.2 * e.b]])
    rate_t = slopes(t)[2]
    acceleration = np.stack([(rate_t + e.rate**2) * place[:, 0], (-rate_t + e.rate**2) * place[:, 1]], axis=1)
    for axis in (0, 1):
        step = STEP * np.eye(2)[axis]
        gradient = (e.pressure(place + step, rho) - e.pressure(place - step, rho)) / (2 * STEP)  # of a parabola: exact
        bound_n = np.abs(rate_t * place[:, axis]) * off(e)[1] + 4 * EPS * e.centre / STEP
        assert (np.abs(acceleration[:, axis] + gradient / rho) < bound_n).all()
    angle = np.linspace(0.0, 6.0, 13)
    on_surface = np.stack([e.a * np.cos(angle), e.b * np.sin(angle)], axis=1)
    # Places, quotients and squares are rounded, 3 eps together, and then two differences of numbers below 1.
    np.testing.assert_allclose(e.pressure(on_surface, rho), 0.0, atol=5 * EPS * rho * e.centre)


@times
def test_area_and_energy_stay(t: float) -> None:
    """Each within half an eps per operation: 4 of the area; 16 of the energy, with those of exp and cosh."""
    e = stretched(RADIUS_OF_DROP, RATE, t)
    assert abs(e.a * e.b / RADIUS_OF_DROP**2 - 1) <= 2 * EPS
    assert abs(e.rate**2 * (e.a**2 + e.b**2) / (2 * RATE**2 * RADIUS_OF_DROP**2) - 1) <= 8 * EPS


def test_drop_starts_round() -> None:
    assert stretched(RADIUS_OF_DROP, RATE, 0.0) == Ellipse(RADIUS_OF_DROP, RADIUS_OF_DROP, RATE)
    x_nc = np.array([[1.0, 2.0]])
    np.testing.assert_array_equal(stretched(RADIUS_OF_DROP, RATE, 0.0).velocity(x_nc), RATE * x_nc * [1, -1])


def test_quadrature_has_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    last = stretched(RADIUS_OF_DROP, RATE, 3 / RATE)
    monkeypatch.setattr("eos_ref.analytic.drops.NODES", 80)
    finer = stretched(RADIUS_OF_DROP, RATE, 3 / RATE)
    # Sums of 40 and 80 terms, added pairwise in blocks of 8, are off by some 7 eps each; the strain is 1.6.
    assert abs(finer.a / last.a - 1) <= 24 * EPS


def test_bad_input_of_drops() -> None:
    for radius, rate, t in ((0.0, 1.0, 0.1), (1.0, -1.0, 0.1), (1.0, 1.0, -0.1), (1.0, 1.0, 3.1)):
        with pytest.raises(InputError, match="must"):
            stretched(radius, rate, t)
