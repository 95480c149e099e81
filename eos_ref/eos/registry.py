"""The equations of state of fix rheo/pressure, one record each; everything else about a law is read from here.

A new law is a set of formulas in `eos_ref.eos.laws` and its record in `LAWS`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from eos_ref.eos import lammps_rounding, laws
from eos_ref.eos.law import EVERYWHERE, EnergyTerms, Interval, Law
from eos_ref.numbers.elementary import powm1

SUBNORMAL = 2.0**-1074


def _cubic_branch(rho0: float, a3: float) -> Interval:
    """Return the interval between the spinodals of a negative A3."""
    half_width = math.inf if a3 >= 0 else 1 / math.sqrt(3 * -a3)
    return Interval(rho0 - half_width, rho0 + half_width)


def _tait_terms(rho: Any, rho0: Any, cs: Any, gamma: Any) -> Any:
    power = np.abs(powm1(rho, rho0, gamma) + 1)
    return cs * cs * rho0 / abs(gamma) * (power + 1)


def _tait_domain(gamma: float) -> Interval:
    """Return the positive densities, unless the exponent is a whole number; a negative one excludes 0 as well."""
    return EVERYWHERE if gamma == round(gamma) else Interval(0.0, math.inf)


def _tait_branch(rho0: float, gamma: float) -> Interval:
    odd = gamma == 1 or (gamma > 0 and gamma % 2 == 1)
    return EVERYWHERE if odd else Interval(0.0, math.inf)


def _tait_as_printed(rho: Any, rho0: Any, cs: Any, gamma: Any) -> Any:
    return cs**2 * rho0 / gamma * ((rho / rho0) ** gamma - 1)


LINEAR = Law(
    "linear",
    pressure=lambda rho, e, rho0, cs, _: laws.linear(rho, rho0, cs),
    density=lambda p, e, rho0, cs, _: laws.linear_density(p, rho0, cs),
    stiffness=lambda rho, e, rho0, cs, _: laws.linear_stiffness(rho, rho0, cs),
    terms=lambda rho, e, rho0, cs, _: cs * cs * (np.abs(rho) + rho0),
    terms_text="c^2 (|rho| + rho0)",
    roundings=lambda _: 3,  # rho - rho0; c*c; product
    reference_eps=2,
    lammps=lambda rho, energy, mass, rho0, cs, _: lammps_rounding.linear(rho, rho0, cs),
)

CUBIC = Law(
    "cubic",
    pressure=lambda rho, e, rho0, cs, a3: laws.cubic(rho, rho0, cs, a3),
    density=lambda p, e, rho0, cs, a3: laws.cubic_density(p, rho0, cs, a3),
    stiffness=lambda rho, e, rho0, cs, a3: laws.cubic_stiffness(rho, rho0, cs, a3),
    terms=lambda rho, e, rho0, cs, a3: (
        cs * cs * (np.abs(rho) + rho0) + cs * cs * np.abs(a3 * (rho - rho0) * (rho - rho0) * (rho - rho0))
    ),
    terms_text="c^2 (|rho| + rho0) + c^2 |A3 (rho - rho0)^3|",
    roundings=lambda _: 9,  # d three times, two products, A3, sum, c*c, product
    reference_eps=5,
    lammps=lambda rho, energy, mass, rho0, cs, a3: lammps_rounding.cubic(rho, rho0, cs, a3),
    parameter="A3",
    monotone=_cubic_branch,
    textbook=lambda rho, e, rho0, cs, a3: cs**2 * ((rho - rho0) + a3 * (rho - rho0) ** 3),
    example=2.5,
)

TAIT_WATER = Law(
    "tait/water",
    pressure=lambda rho, e, rho0, cs, _: laws.tait_water(rho, rho0, cs),
    density=lambda p, e, rho0, cs, _: laws.tait_density(p, rho0, cs, 7.0),
    stiffness=lambda rho, e, rho0, cs, _: laws.tait_stiffness(rho, rho0, cs, 7.0),
    terms=lambda rho, e, rho0, cs, _: _tait_terms(rho, rho0, cs, 7.0),
    terms_text="c^2 rho0/7 ((rho/rho0)^7 + 1)",
    roundings=lambda _: 2 * 7 + 12,  # as of tait/general, but the power may be a chain of 6 products
    reference_eps=4,
    lammps=lambda rho, energy, mass, rho0, cs, _: lammps_rounding.tait_water(rho, rho0, cs),
    exponent=lambda _: 7.0,
    textbook=lambda rho, e, rho0, cs, _: _tait_as_printed(rho, rho0, cs, 7.0),
)

TAIT_GENERAL = Law(
    "tait/general",
    pressure=lambda rho, e, rho0, cs, gamma: laws.tait_general(rho, rho0, cs, gamma),
    density=lambda p, e, rho0, cs, gamma: laws.tait_density(p, rho0, cs, gamma),
    stiffness=lambda rho, e, rho0, cs, gamma: laws.tait_stiffness(rho, rho0, cs, gamma),
    terms=lambda rho, e, rho0, cs, gamma: _tait_terms(rho, rho0, cs, gamma),
    terms_text="c^2 rho0/|gamma| ((rho/rho0)^gamma + 1)",
    # base: reciprocal and product, both to the power gamma; pow 2; less one 1; c*c, rho0, product; 1/gamma 2
    roundings=lambda gamma: 2 * abs(gamma) + 8,
    reference_eps=4,
    lammps=lambda rho, energy, mass, rho0, cs, gamma: lammps_rounding.tait_general(rho, rho0, cs, gamma),
    parameter="gamma",
    allows=lambda gamma: gamma != 0,
    rule="must not be 0 (the law divides by it)",
    exponent=lambda gamma: gamma,
    uses_powm1=True,
    defined=_tait_domain,
    has_pole=lambda gamma: gamma < 0,
    monotone=_tait_branch,
    textbook=lambda rho, e, rho0, cs, gamma: _tait_as_printed(rho, rho0, cs, gamma),
    example=1.4,
)

IDEAL_GAS = Law(
    "ideal/gas",
    pressure=lambda rho, e, rho0, cs, gamma: laws.ideal_gas(rho, e, gamma),
    # Without energy the pressure is 0 at every density, so that it has no inverse.
    density=lambda p, e, rho0, cs, gamma: laws.ideal_gas_density(p, np.where(e == 0, np.nan, e), gamma),
    stiffness=lambda rho, e, rho0, cs, gamma: laws.ideal_gas_stiffness(e + 0 * rho, gamma),
    terms=lambda rho, e, rho0, cs, gamma: (gamma + 1) * np.abs(rho * e),
    terms_text="(gamma + 1) |rho e|",
    roundings=lambda _: 4,  # gamma - 1, rho, energy, mass
    reference_eps=2,
    lammps=lambda rho, energy, mass, rho0, cs, gamma: lammps_rounding.ideal_gas(rho, energy, mass, gamma),
    parameter="gamma",
    allows=lambda gamma: gamma > 1,
    rule="must exceed 1 (a heat capacity ratio)",
    takes_cs=False,
    energy=EnergyTerms(
        slope=lambda rho, e, rho0, cs, gamma: (gamma - 1) * rho,
        inverse_slope=lambda rho, e, rho0, cs, gamma: rho / e,
        underflow=lambda rho, e, rho0, cs, gamma: (gamma + 1) * (SUBNORMAL * np.abs(rho) + SUBNORMAL * np.abs(e)),
        sound_squared=lambda e, gamma: laws.ideal_gas_stiffness(e, gamma),
    ),
    example=1.4,
)

LAWS: dict[str, Law] = {law.style: law for law in (LINEAR, CUBIC, TAIT_WATER, TAIT_GENERAL, IDEAL_GAS)}
STYLES = tuple(LAWS)
if TYPE_CHECKING:
    Style = str
else:
    Style = Literal[STYLES]  # for the schema of scenes
# Name of the argument of every entry of fix rheo/pressure that takes one.
PARAMETER = {law.style: law.parameter for law in LAWS.values() if law.parameter} | {"background": "P_b"}
