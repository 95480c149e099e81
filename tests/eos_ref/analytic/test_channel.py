"""Plane flow and the column at rest: their equations by finite differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, InputError
from eos_ref.analytic.channel import NEGLIGIBLE, column, depth_below_surface, plane_start_up, weight_of_column

LONG, EPS = np.longdouble, float(np.finfo(np.longdouble).eps)
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


def rounding(drive: dict[str, Any], t: float) -> float:
    """Bound of rounding errors: half an eps per addition of a mode, and the errors of every mode.

    The argument n pi s of a sine is off by 1.5 eps, the exponent by 5 eps, the factors of the amplitude by 8 eps.
    """
    speed, rate = abs(float(drive.get("speed", 0))), float(NU / WIDTH**2) * t
    force = abs(float(drive.get("gravity", 0))) * float(WIDTH**2 / NU)
    k_n = np.pi * np.arange(1, int(np.sqrt(NEGLIGIBLE / (np.pi**2 * rate))) + 2)
    size_n = (2 * speed / k_n + 4 * force / k_n**3) * np.exp(-(k_n**2) * rate)
    modes = np.sum(size_n * (1.5 * k_n + 8 + 5 * k_n**2 * rate))
    return EPS * float(len(k_n) * (speed + force / 8) / 2 + modes)


@drives
def test_walls_and_start(drive: dict[str, Any]) -> None:
    ends_n, inside_n = np.array([0, WIDTH]), WIDTH * np.linspace(LONG(0.2), LONG(0.8), 5)
    for t in TIMES:
        at_walls = plane_start_up(ends_n, LONG(t), WIDTH, NU, **drive)
        np.testing.assert_allclose(at_walls, [0, drive.get("speed", 0)], rtol=0, atol=rounding(drive, t))
    assert not plane_start_up(inside_n, 0.0, WIDTH, NU, **drive).any()
    early = LONG("1e-4")  # far from walls only the force acts so far
    early_n = plane_start_up(inside_n, early, WIDTH, NU, **drive)
    np.testing.assert_allclose(early_n, drive.get("gravity", 0) * early, rtol=0, atol=rounding(drive, float(early)))


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
    rounding_n = 4 * EPS * pressure_n / (d * slope_n) + 4 * np.finfo(float).eps  # densities are doubles
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


def test_bad_input() -> None:
    for law in (EOS("cubic", 1.0, 1.0, 0.5), EOS("tait/general", 1.0, 1.0, 1.0)):
        with pytest.raises(InputError, match="law of a column"):
            column(law, 1.0, 0.1)
    with pytest.raises(InputError, match="gravity"):
        weight_of_column(LAWS[0], 1.0, 0.0)
    for t, width, nu in ((-1.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, -1.0)):
        with pytest.raises(InputError, match="must"):
            plane_start_up(np.zeros(1), t, width, nu)
