r"""A drop of liquid that stretches freely in a plane: closed solution.

The velocity :math:`(Ax, -Ay)` keeps an ellipse of semi-axes a, b an ellipse: :math:`\dot a=Aa`, :math:`\dot b=-Ab`.
Euler's equation needs :math:`(\dot A+A^2)x=-\partial_xP/\rho` and :math:`(-\dot A+A^2)y=-\partial_yP/\rho`, which a
pressure :math:`P=\tfrac12\rho\kappa(1-x^2/a^2-y^2/b^2)`, zero on the surface, gives if :math:`\dot A+A^2=\kappa/a^2`
and :math:`-\dot A+A^2=\kappa/b^2`:

.. math:: \kappa=\frac{2A^2a^2b^2}{a^2+b^2},\qquad \dot A=A^2\,\frac{b^2-a^2}{a^2+b^2}

(Monaghan, J. Comput. Phys. 110, 399 (1994)). The area is conserved, :math:`a=Re^\sigma`,
:math:`b=Re^{-\sigma}`, and with it :math:`d\ln A/d\sigma=-\tanh2\sigma`, so that :math:`A=A_0/\sqrt{\cosh2\sigma}`:
the kinetic energy, proportional to :math:`A^2(a^2+b^2)`, stays. What remains is
:math:`A_0t=\int_0^\sigma\sqrt{\cosh2s}\,ds`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref.errors import InputError

Array = Any  # of any float type
NODES = 40  # of Gauss' quadrature; the integrand is analytic, its error below 1e-16 for strains up to 2


@dataclass(frozen=True)
class Ellipse:
    """A stretching drop at one time: semi-axes, rate of strain, and pressure at the centre over the density."""

    a: Any
    b: Any
    rate: Any

    @property
    def centre(self) -> Any:
        """Pressure at the centre over the density."""
        return self.rate**2 * self.a**2 * self.b**2 / (self.a**2 + self.b**2)

    def velocity(self, x_nc: Array) -> Array:
        """Return the velocity (n, 2) at positions (n, 2) inside."""
        return x_nc * np.array([self.rate, -self.rate])

    def pressure(self, x_nc: Array, rho: Any) -> Array:
        """Return the pressure (n,) at positions (n, 2) inside."""
        return rho * self.centre * (1 - (x_nc[:, 0] / self.a) ** 2 - (x_nc[:, 1] / self.b) ** 2)


def stretched(radius: Any, rate: Any, t: Any) -> Ellipse:
    """Return, at a time t, a drop that was round, of a radius and a rate of strain, at t = 0.

    Raises
    ------
    InputError
        A radius or a rate that is not positive; a time outside 0 to 3/rate, beyond which the quadrature loses digits.
    """
    for what, value in (("radius", radius), ("rate of strain", rate)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{what} of a drop", "must be positive", value)
    if not 0 <= rate * t <= 3:
        raise InputError("time", f"must lie within 0 to {3 / rate:g}", t)
    strain = _strain(rate * t)
    stretch = np.exp(strain)
    return Ellipse(radius * stretch, radius / stretch, rate / np.sqrt(np.cosh(2 * strain)))


def _strain(time: Any) -> Any:
    """Return the strain at a time in units of the first rate, by Newton's method from above: the integral is convex."""
    place, weight = (0 * time + w for w in np.polynomial.legendre.leggauss(NODES))
    strain, last = time, np.inf
    while True:
        integral = strain / 2 * (weight * np.sqrt(np.cosh(strain * (place + 1)))).sum()
        step = (integral - time) / np.sqrt(np.cosh(2 * strain))
        if not abs(step) < last:
            return strain
        strain, last = strain - step, abs(step)
