"""Riemann problem of two isothermal gases: its equations, jump conditions and conservation laws."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.analytic import riemann
from eos_ref.analytic.riemann import Gas, Riemann

LONG = np.longdouble
EPS = float(np.finfo(LONG).eps)


def gas(rho: float, u: float, c: float) -> Gas:
    return Gas(LONG(rho), LONG(u), LONG(c))


PROBLEMS = {
    "sod": Riemann(gas(1.0, 0.0, 1.0), gas(0.125, 0.0, 0.9)),
    "mirrored": Riemann(gas(0.2, 0.0, 1.3), gas(1.7, 0.0, 0.6)),
    "two shocks": Riemann(gas(1.1, 0.9, 1.0), gas(0.7, -0.8, 1.4)),
    "two rarefactions": Riemann(gas(1.1, -0.9, 1.0), gas(0.7, 0.8, 1.4)),
    "moving": Riemann(gas(1.0, 2.5, 1.0), gas(0.4, 2.4, 0.5)),
    "nothing": Riemann(gas(1.0, 0.3, 0.5), gas(0.25, 0.3, 1.0)),
}
problems = pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS)


def sound(problem: Riemann, x_n: Any, t: Any) -> Any:
    return np.where(x_n < problem.velocity * t, problem.left.c, problem.right.c)


def content(problem: Riemann, t: Any, edge: Any) -> tuple[Any, Any]:
    """Mass and momentum between -edge and edge, piece by piece between the waves, where the solution is smooth."""
    places, weights = np.polynomial.legendre.leggauss(24)
    ends = [-edge, *(speed * t for speed in problem.waves()), edge]
    mass = momentum = LONG(0)
    for low, high in itertools.pairwise(ends):
        x_n = (low + high) / 2 + (high - low) / 2 * places
        rho_n, u_n = problem.at(x_n, t)
        mass += (high - low) / 2 * (weights * rho_n).sum()
        momentum += (high - low) / 2 * (weights * rho_n * u_n).sum()
    return mass, momentum


def missing(problem: Riemann) -> float:
    """Largest imbalance of mass and momentum with the inflow through far edges, in units of the content."""
    t, edge = LONG(0.7), LONG(5)
    left, right = problem.left, problem.right
    mass, momentum = content(problem, t, edge)
    mass_0, momentum_0 = edge * (left.rho + right.rho), edge * (left.rho * left.u + right.rho * right.u)
    flow = t * (left.rho * left.u - right.rho * right.u)
    thrust = t * (left.rho * left.u**2 + left.pressure - right.rho * right.u**2 - right.pressure)
    scale = edge * (left.rho * (abs(left.u) + left.c) + right.rho * (abs(right.u) + right.c))
    return float(
        max(abs(mass - mass_0 - flow) / (edge * (left.rho + right.rho)), abs(momentum - momentum_0 - thrust) / scale)
    )


# Nodes and weights of Gauss are doubles, off by an eps each, and so are the contents: for weights by an eps of
# themselves, for nodes by an eps of the variation of densities and momenta over a piece, which is less than twice them.
QUADRATURE = 4 * float(np.finfo(float).eps)


@problems
def test_mass_and_momentum_are_conserved(problem: Riemann) -> None:
    assert missing(problem) < QUADRATURE


@pytest.mark.parametrize("fault", ["shock as a rarefaction", "adiabatic", "shock speed"])
def test_conservation_detects_wrong_solutions(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if fault == "shock as a rarefaction":
        monkeypatch.setattr(riemann, "jump", lambda c, log_ratio: (c * log_ratio, c))
    elif fault == "adiabatic":
        true = riemann.jump
        monkeypatch.setattr(riemann, "jump", lambda c, log_ratio: true(1.4**0.5 * c, log_ratio))
    else:
        true_edges = Riemann.edges
        monkeypatch.setattr(Riemann, "edges", lambda self, g, side: (true_edges(self, g, side)[0] * 1.001,) * 2)
    sod = PROBLEMS["sod"]
    assert missing(Riemann(sod.left, sod.right)) > 1e4 * QUADRATURE


@problems
def test_shocks_jump(problem: Riemann) -> None:
    """Mass and momentum through a shock, in its own frame, to rounding."""
    speeds = problem.waves()
    for side, state, speed in ((-1, problem.left, speeds[0]), (1, problem.right, speeds[-1])):
        if problem.pressure <= state.pressure * (1 + 100 * EPS):
            continue
        behind = Gas(problem.pressure / state.c**2, problem.velocity, state.c)
        through = [g.rho * (g.u - speed) for g in (state, behind)]
        push = [g.rho * (g.u - speed) ** 2 + g.pressure for g in (state, behind)]
        # Velocities are rounded, a few times half an eps, before their difference is taken.
        bound = 2 * EPS * (1 + (abs(behind.u) + abs(state.u) + abs(speed)) / abs(behind.u - speed))
        assert abs(through[1] / through[0] - 1) < bound
        assert abs(push[1] / push[0] - 1) < bound
        assert side * (state.u - speed) < 0 < side * (behind.u - speed) + state.c  # supersonic before, subsonic behind


@problems
def test_fans_solve_the_equations(problem: Riemann) -> None:
    """Isothermal Euler equations by central differences inside every fan.

    They are off by d^2/6 of third derivatives; with s = x/ct those are at most rho (s^3 + 6 s^2 + 6 s)/t^3 and
    rho/(ct)^3 of the density, 6 x/t^4 and 0 of the velocity.
    """
    speeds, t, d = problem.waves(), LONG(1.3), LONG(1e-5)
    for outer, inner in ((speeds[0], speeds[1]), (speeds[4], speeds[3])):
        if abs(outer - inner) < 1e-3:
            continue
        x_n = t * (outer + (inner - outer) * np.linspace(LONG(0.1), LONG(0.9), 9))
        rho_n, u_n = problem.at(x_n, t)
        (rho_t, u_t), (rho_x, u_x) = (
            [(a - b) / (2 * d) for a, b in zip(problem.at(x_n + dx, t + dt), problem.at(x_n - dx, t - dt), strict=True)]
            for dx, dt in ((0, d), (d, 0))
        )
        c_n, per_t = sound(problem, x_n, t), d**2 / (6 * t**3)
        s_n, rounding = np.abs(x_n) / (c_n * t), 100 * EPS / d
        of_mass_n = rho_n * (s_n**3 + 6 * s_n**2 + 6 * s_n + np.abs(u_n) / c_n**3) * per_t
        assert (np.abs(rho_t + u_n * rho_x + rho_n * u_x) < of_mass_n + rounding).all()
        of_momentum_n = (6 * s_n * c_n + 1 / c_n) * per_t
        assert (np.abs(u_t + u_n * u_x + c_n**2 * rho_x / rho_n) < of_momentum_n + rounding).all()


@problems
def test_pieces_meet(problem: Riemann) -> None:
    """Pressure and velocity are continuous at the contact, everything at the edges of a fan.

    Inside a fan the slope of u over x/t is 1, and that of ln P is 1/c.
    """
    speeds = problem.waves()
    for k, speed in enumerate(speeds):
        step = LONG(1e-12)
        around = np.array([speed - step, speed + step])
        rho_n, u_n = problem.at(around, LONG(1))
        shock = k in (0, 1, 3, 4) and speeds[k] == speeds[k + 1 if k in (0, 3) else k - 1]
        if not shock:
            c_n = sound(problem, around, LONG(1))
            p_n, bound = c_n**2 * rho_n, 2 * step + 100 * EPS
            assert abs(u_n[1] - u_n[0]) < bound
            assert abs(p_n[1] - p_n[0]) < bound / c_n.min() * p_n[0]


@problems
def test_frame_and_mirror(problem: Riemann) -> None:
    boost, x_n, t = LONG(0.75), np.linspace(LONG(-2), LONG(2), 101), LONG(0.6)
    left, right = problem.left, problem.right
    moved = Riemann(Gas(left.rho, left.u + boost, left.c), Gas(right.rho, right.u + boost, right.c))
    mirror = Riemann(Gas(right.rho, -right.u, right.c), Gas(left.rho, -left.u, left.c))
    rho_n, u_n = problem.at(x_n, t)
    # Speeds are rounded four times; the density of a fan depends on their ratio to c.
    speeds = float(np.abs(x_n).max() / t + boost + abs(left.u) + abs(right.u))
    of_u = 4 * EPS * speeds
    of_rho = of_u / float(min(left.c, right.c))
    for (rho_2n, u_2n), sign, shift in ((moved.at(x_n + boost * t, t), 1, boost), (mirror.at(-x_n, t), -1, 0)):
        np.testing.assert_allclose(rho_2n, rho_n, rtol=of_rho)
        np.testing.assert_allclose(sign * u_2n - shift, u_n, rtol=0, atol=of_u)


def test_equal_gases_at_equal_pressure_stay() -> None:
    rho_n, u_n = Riemann(Gas(1.0, 0.0, 1.0), Gas(0.25, 0.0, 2.0)).at(np.array([-3.0, -1e-9, 1e-9, 3.0]), 1.0)
    np.testing.assert_array_equal(rho_n, [1.0, 1.0, 0.25, 0.25])
    np.testing.assert_array_equal(u_n, 0.0)


def test_bad_input() -> None:
    for values in ((0.0, 0.0, 1.0), (1.0, np.nan, 1.0), (1.0, 0.0, -1.0)):
        with pytest.raises(InputError, match="of a gas: must be"):
            Gas(*values)
    with pytest.raises(InputError, match="time"):
        PROBLEMS["sod"].at(np.zeros(1), 0.0)
