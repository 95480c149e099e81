r"""Riemann problem of two isothermal gases: closed solution.

A particle of `ideal/gas` keeps its energy per mass e (no work of pressure, no viscous heating), so its pressure is
:math:`P=(\gamma-1)\rho e=c^2\rho` with :math:`c^2=(\gamma-1)e` frozen. Behind and before the contact lie two gases,
each with its own c. For the right one, with :math:`x=P_*/P_R`,

- rarefaction (x < 1): :math:`u-c\ln\rho` is constant through the wave, so :math:`u_*=u_R+c\ln x`; inside the fan
  :math:`x/t=u+c`;
- shock (x > 1): :math:`[\rho(u-S)]=0` and :math:`[\rho u(u-S)+c^2\rho]=0` give :math:`S=u_R+c\sqrt x` and
  :math:`u_*=u_R+c(\sqrt x-1/\sqrt x)=u_R+2c\sinh(\tfrac12\ln x)`.

The left one is the mirror image. Source: Toro, Riemann Solvers and Numerical Methods for Fluid Dynamics (2009), ch. 4,
with the energy equation replaced by c constant on each side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eos_ref.errors import InputError

Array = Any  # of any float type


@dataclass(frozen=True)
class Gas:
    """State of one side: density, velocity, isothermal speed of sound.

    Raises
    ------
    InputError
        A density or a speed of sound that is not positive, or a number that is not finite.
    """

    rho: Any
    u: Any
    c: Any

    def __post_init__(self) -> None:
        for what, value in (("density", self.rho), ("velocity", self.u), ("speed of sound", self.c)):
            if not np.isfinite(value):
                raise InputError(f"{what} of a gas", "must be finite", value)
        for what, value in (("density", self.rho), ("speed of sound", self.c)):
            if value <= 0:
                raise InputError(f"{what} of a gas", "must be positive", value)

    @property
    def pressure(self) -> Any:
        """c^2 rho."""
        return self.c**2 * self.rho


@dataclass(frozen=True)
class Riemann:
    """Two gases that touch at x = 0 from t = 0 on; the solution depends on x/t alone.

    There is no vacuum: a rarefaction reaches every speed at some density.
    """

    left: Gas
    right: Gas

    @cached_property
    def log_pressure(self) -> Any:
        """Logarithm of the pressure between the waves.

        The velocity jump is an increasing, convex function of it, so that Newton's method converges to rounding.
        """
        target = self.left.u - self.right.u
        logs = [np.log(gas.pressure) for gas in (self.left, self.right)]
        log_p, last = max(logs) + max(target, 0) / (self.left.c + self.right.c), np.inf
        while True:
            jumps = [jump(gas.c, log_p - log) for gas, log in zip((self.left, self.right), logs, strict=True)]
            step = (jumps[0][0] + jumps[1][0] - target) / (jumps[0][1] + jumps[1][1])
            if not abs(step) < last:
                return log_p
            log_p, last = log_p - step, abs(step)

    @cached_property
    def pressure(self) -> Any:
        """Pressure between the waves."""
        return np.exp(self.log_pressure)

    @cached_property
    def velocity(self) -> Any:
        """Velocity between the waves, that of the contact."""
        return self.right.u + jump(self.right.c, self.log_pressure - np.log(self.right.pressure))[0]

    def waves(self) -> tuple[Any, Any, Any, Any, Any]:
        """Return the speeds from left to right: outer and inner edge of the left wave, contact, inner and outer edge.

        The two edges of a shock are the same.
        """
        outer_l, inner_l = self.edges(self.left, -1)
        outer_r, inner_r = self.edges(self.right, 1)
        return outer_l, inner_l, self.velocity, inner_r, outer_r

    def edges(self, gas: Gas, side: int) -> tuple[Any, Any]:
        """Return the speeds of the outer and inner edge of the wave on a side, -1 left or 1 right."""
        ratio = self.pressure / gas.pressure
        if ratio > 1:
            speed = gas.u + side * gas.c * np.sqrt(ratio)
            return speed, speed
        return gas.u + side * gas.c, self.velocity + side * gas.c

    def at(self, x_n: Array, t: Any) -> tuple[Array, Array]:
        """Return the density and velocity, (n,) each, at positions x (n,) and a time t > 0.

        Raises
        ------
        InputError
            A time that is not positive.
        """
        if not t > 0:
            raise InputError("time", "must be positive", t)
        xi_n = np.asarray(x_n) / t
        of_left = self._side(self.left, -1, xi_n)
        of_right = self._side(self.right, 1, xi_n)
        rho_n, u_n = (np.where(xi_n < self.velocity, a, b) for a, b in zip(of_left, of_right, strict=True))
        return rho_n, u_n

    def _side(self, gas: Gas, side: int, xi_n: Array) -> tuple[Array, Array]:
        outer, inner = self.edges(gas, side)
        far_n, star_n = side * (xi_n - outer) > 0, side * (xi_n - inner) <= 0
        fan_u_n = np.clip(xi_n, min(outer, inner), max(outer, inner)) - side * gas.c  # used between the edges only
        u_n = np.where(far_n, gas.u, np.where(star_n, self.velocity, fan_u_n))
        fan_rho_n = gas.rho * np.exp(side * (fan_u_n - gas.u) / gas.c)
        rho_n = np.where(far_n, gas.rho, np.where(star_n, self.pressure / gas.c**2, fan_rho_n))
        return rho_n, u_n


def jump(c: Any, log_ratio: Any) -> tuple[Any, Any]:
    """Return the velocity gained across the right wave, and its derivative, for the logarithm of the pressure ratio."""
    if log_ratio > 0:
        return 2 * c * np.sinh(log_ratio / 2), c * np.cosh(log_ratio / 2)
    return c * log_ratio, c
