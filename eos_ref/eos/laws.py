r"""The equations of state of fix rheo/pressure, each written once.

Every function holds one formula in plain operators and `eos_ref.numbers.elementary` functions. The same body serves
float64 and float32 arrays, Arb balls (`eos_ref.eos.rigorous`) and compiled loops (`eos_ref.eos.compiled`).

Symbols: ``rho`` density, ``rho0`` equilibrium density, ``cs`` speed of sound, ``e`` internal energy per unit
mass, ``p`` pressure; pressures have the dimension of ``cs**2 * rho``. Source of all pressures: LAMMPS manual,
fix rheo/pressure. The inverses and derivatives follow from them by algebra.
"""

from __future__ import annotations

from eos_ref.numbers.elementary import asin, asinh, powm1, root1p, sin, sinh, sqrt
from eos_ref.numbers.number import Number


def linear(rho: Number, rho0: Number, cs: Number) -> Number:
    r"""Return the pressure of the linear law, :math:`P = c^2 (\rho - \rho_0)`."""
    return cs * cs * (rho - rho0)


def linear_density(p: Number, rho0: Number, cs: Number) -> Number:
    r"""Return the inverse of the linear law, :math:`\rho = \rho_0 + P/c^2`."""
    return rho0 + p / (cs * cs)


def linear_stiffness(rho: Number, rho0: Number, cs: Number) -> Number:
    r"""Return the derivative of the linear law, :math:`\partial P/\partial\rho = c^2`."""
    return cs * cs + 0 * rho


def cubic(rho: Number, rho0: Number, cs: Number, a3: Number) -> Number:
    r"""Return the pressure of the cubic law, :math:`P = c^2 [(\rho-\rho_0) + A_3 (\rho-\rho_0)^3]`.

    The formula requires ``a3`` in 1/density\ :sup:`2`; the manual gives pressure/density\ :sup:`2`.
    """
    d = rho - rho0
    return cs * cs * (d + a3 * d * d * d)


def cubic_density(p: Number, rho0: Number, cs: Number, a3: Number) -> Number:
    r"""Return the inverse of the cubic law on the branch through :math:`\rho_0`.

    With :math:`y = P/c^2` the root of :math:`\delta + A_3\delta^3 = y` is, for :math:`A_3 > 0`,
    :math:`\delta = \frac{2}{\sqrt{3A_3}}\sinh\!\big(\tfrac13\mathrm{asinh}(\tfrac{3\sqrt{3A_3}}{2}y)\big)`;
    for :math:`A_3 < 0` the hyperbolic functions become circular ones of :math:`|A_3|`, and the branch ends at
    the spinodal :math:`|\delta| = 1/\sqrt{3|A_3|}`. Neither form cancels near :math:`P = 0`, as Cardano's
    does.
    """
    y = p / (cs * cs)
    if a3 == 0:
        return rho0 + y
    s = sqrt(3 * abs(a3))
    if a3 > 0:
        return rho0 + 2 / s * sinh(asinh(3 * s / 2 * y) / 3)
    return rho0 + 2 / s * sin(asin(3 * s / 2 * y) / 3)


def cubic_stiffness(rho: Number, rho0: Number, cs: Number, a3: Number) -> Number:
    r"""Return the derivative of the cubic law, :math:`\partial P/\partial\rho = c^2 [1 + 3 A_3 (\rho-\rho_0)^2]`."""
    d = rho - rho0
    return cs * cs * (1 + 3 * a3 * d * d)


def tait_water(rho: Number, rho0: Number, cs: Number) -> Number:
    r"""Return the pressure of Tait's law for water, :math:`P = \frac{c^2\rho_0}{7}\big[(\rho/\rho_0)^7 - 1\big]`.

    Evaluated by the identity :math:`x^7 - 1 = (x - 1)[1 + x(1 + x)(1 + x^2 + x^4)]` with
    :math:`x = \rho/\rho_0`. The difference :math:`\rho - \rho_0` is taken first, and no other one follows where
    :math:`x > 0` or :math:`x < -1`: both terms in the brackets are positive there, so nothing cancels.
    """
    x = rho * (1 / rho0)
    xx = x * x
    return cs * cs / 7 * (rho - rho0) * (1 + x * (1 + x) * (1 + xx + xx * xx))


def tait_general(rho: Number, rho0: Number, cs: Number, gamma: Number) -> Number:
    r"""Return the pressure of Tait's law, :math:`P = \frac{c^2\rho_0}{\gamma}\big[(\rho/\rho_0)^\gamma - 1\big]`."""
    return cs * cs * rho0 / gamma * powm1(rho, rho0, gamma)  # type: ignore[no-any-return]


def tait_density(p: Number, rho0: Number, cs: Number, gamma: Number) -> Number:
    r"""Return the inverse of Tait's law, :math:`\rho = \rho_0 (1 + \gamma P/(c^2\rho_0))^{1/\gamma}`.

    NaN for a bracket below 0.
    """
    return rho0 * root1p(gamma * p / (cs * cs * rho0), gamma)


def tait_stiffness(rho: Number, rho0: Number, cs: Number, gamma: Number) -> Number:
    r"""Return the derivative of Tait's law, :math:`\partial P/\partial\rho = c^2 (\rho/\rho_0)^{\gamma-1}`."""
    return cs * cs * (rho / rho0) ** (gamma - 1)


def ideal_gas(rho: Number, e: Number, gamma: Number) -> Number:
    r"""Return the pressure of an ideal gas, :math:`P = (\gamma - 1)\rho e`."""
    return (gamma - 1) * rho * e


def ideal_gas_density(p: Number, e: Number, gamma: Number) -> Number:
    r"""Return the inverse of the ideal-gas law, :math:`\rho = P/((\gamma - 1) e)`."""
    return p / ((gamma - 1) * e)


def ideal_gas_stiffness(e: Number, gamma: Number) -> Number:
    r"""Return the derivative at constant energy, :math:`(\partial P/\partial\rho)_e = (\gamma-1)e`.

    The thermodynamic (adiabatic) value is :math:`\gamma(\gamma-1)e`.
    """
    return (gamma - 1) * e
