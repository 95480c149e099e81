r"""Fluid between plates and in a tank: closed solutions."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.eos.table import EOS
from eos_ref.errors import InputError

Array = Any  # of any float type
NEGLIGIBLE = 50.0  # exponent beyond which a mode is below the last digit, of longdoubles too


def plane_start_up(y_n: Array, t: Any, width: Any, nu: Any, gravity: Any = 0.0, speed: Any = 0.0) -> Array:
    r"""Return the velocity (n,) between two plates, at rest until t = 0, when the force and one plate set in.

    .. math::
        \partial_t u = \nu\,\partial_y^2 u + g,\qquad u(0)=0,\quad u(L)=U,\quad u(t=0)=0,

        u = U\frac yL + \frac{g}{2\nu}y(L-y) + \sum_{n\ge1}\Big[\frac{2U}{n\pi}(-1)^n
        - \frac{2gL^2}{\nu n^3\pi^3}(1-(-1)^n)\Big]\sin\frac{n\pi y}L\,e^{-n^2\pi^2\nu t/L^2}

    The second and third terms are minus the sine series of the first two (the steady flow), mode by mode decaying.
    Source: Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997) (both flows).

    Parameters
    ----------
    y_n : array_like
        Distances from the plate at rest, 0 to ``width`` (length).
    t : float
        Time, >= 0.
    width, nu, gravity, speed : float
        Distance of the plates, kinematic viscosity (> 0), acceleration along the plates, speed of the other plate.

    Raises
    ------
    InputError
        A time that is negative, a width or viscosity that is not positive.
    """
    for what, value in (("width of the channel", width), ("kinematic viscosity", nu)):
        if not value > 0:
            raise InputError(what, "must be positive", value)
    if not t >= 0:
        raise InputError("time", "must not be negative", t)
    s_n, rate = np.asarray(y_n) / width, np.pi**2 * nu * t / width**2
    if t == 0:
        return 0 * s_n
    drive = gravity * width**2 / nu
    u_n = speed * s_n + drive / 2 * s_n * (1 - s_n)
    pi = 4 * np.arctan(np.ones((), s_n.dtype))  # np.pi is a double
    for n in range(1, int(np.sqrt(NEGLIGIBLE / float(rate))) + 2):
        odd = n % 2
        amplitude = 2 * speed / (n * pi) * (1 - 2 * odd) - 4 * drive / (n * pi) ** 3 * odd
        u_n = u_n + amplitude * np.sin(n * pi * s_n) * np.exp(-(n**2) * pi**2 * nu * t / width**2)
    return u_n


def depth_below_surface(law: EOS, rho_n: Array, gravity: Any) -> Array:
    r"""Return the depth (n,) at which a fluid at rest under gravity has a density; at the surface it is rho0.

    .. math:: \frac{dP}{dz} = \rho g \;\Rightarrow\; gz = \int_{\rho_0}^{\rho}\frac{c^2(\rho')}{\rho'}\,d\rho'

    linear: :math:`c^2\ln(\rho/\rho_0)`; Tait's law: :math:`\frac{c^2}{\gamma-1}[(\rho/\rho_0)^{\gamma-1}-1]`.

    Raises
    ------
    InputError
        Another law, an exponent of 1, or a gravity that is not positive.
    """
    if not gravity > 0:
        raise InputError("gravity", "must be positive (downwards)", gravity)
    power = _exponent(law) - 1
    if power == 0:
        return law.cs**2 * np.log(rho_n / law.rho0) / gravity
    return law.cs**2 / power * ((rho_n / law.rho0) ** power - 1) / gravity


def _exponent(law: EOS) -> float:
    """Return the exponent of Tait's law; 1 for the linear law."""
    if law.style == "linear":
        return 1.0
    if law.exponent is None or law.exponent == 1:
        raise InputError("law of a column", "must be linear or one of Tait's with an exponent other than 1", law.style)
    return law.exponent


def weight_of_column(law: EOS, depth_n: Array, gravity: Any) -> Array:
    """Return the pressure (n,) above the background at depths (n,) of a fluid at rest; depths may be negative.

    It is the inverse of `depth_below_surface`, put into the law.

    Raises
    ------
    InputError
        See `depth_below_surface`.
    """
    depth_below_surface(law, law.rho0, gravity)  # its checks
    w_n = gravity * np.asarray(depth_n) / law.cs**2
    gamma = _exponent(law)
    if gamma == 1:
        return law.rho0 * law.cs**2 * np.expm1(w_n)
    power = gamma - 1
    return law.rho0 * law.cs**2 / gamma * np.expm1(gamma / power * np.log1p(power * w_n))


def column(law: EOS, mass_above_n: Array, gravity: Any) -> tuple[Array, Array]:
    r"""Return the depth and density, (n,) each, below a mass per area of a fluid at rest under gravity.

    The pressure carries the weight, :math:`P = P(\rho_0) + gM`; the law gives the density, and `depth_below_surface`
    the place. Particles of equal mass therefore lie at equal steps of M.

    Raises
    ------
    InputError
        See `depth_below_surface`.
    """
    rho_n = law.density(law.background + gravity * np.asarray(mass_above_n))
    return depth_below_surface(law, rho_n, gravity), rho_n
