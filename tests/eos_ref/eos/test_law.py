"""Records of laws: their statements hold in rational numbers."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from eos_ref.eos.law import EVERYWHERE, Law
from eos_ref.eos.registry import LAWS

POLYNOMIAL = ("linear", "cubic", "ideal/gas")  # which rational numbers go through
RHO, E, RHO0, CS = Fraction(13, 11), Fraction(5, 7), Fraction(9, 8), Fraction(3, 2)


def parameter(law: Law) -> Fraction:
    return Fraction(0 if law.example is None else law.example)


def test_law_is_defined_and_monotone_except_where_declared() -> None:
    linear = LAWS["linear"]
    plain = Law("plain", *(linear.pressure,) * 4, "", lambda parameter: 1.0, 1.0, linear.lammps)
    assert plain.defined(0.0) == plain.monotone(1.0, 0.0) == EVERYWHERE == (-math.inf, math.inf)
    assert not (plain.has_pole(0.0) or plain.needs_energy or plain.uses_powm1) and plain.exponent(0.0) is None
    assert plain.allows(math.inf), "a law without a parameter has no rule for one"


@pytest.mark.parametrize("style", LAWS)
def test_example_is_valid_and_increases_with_density_about_rho0(style: str) -> None:
    law = LAWS[style]
    assert (
        law.style == style
        and (law.parameter is None) == (law.example is None)
        and bool(law.rule) <= bool(law.parameter)
    )
    example = float(parameter(law))
    low, high = law.monotone(float(RHO0), example)
    assert law.allows(example) and low < RHO0 < high
    assert law.defined(example).low <= low and high <= law.defined(example).high


def test_laws_differ_at_the_examples() -> None:
    rho, e, rho0, cs = (float(number) for number in (RHO, E, RHO0, CS))
    pressures = {law.pressure(rho, e, rho0, cs, float(parameter(law))) for law in LAWS.values()}
    assert len(pressures) == len(LAWS)


@pytest.mark.parametrize("style", POLYNOMIAL)
def test_terms_bound_the_pressure_and_stiffness_is_its_slope(style: str) -> None:
    law, a = LAWS[style], parameter(LAWS[style])
    p = law.pressure(RHO, E, RHO0, CS, a)
    assert isinstance(p, Fraction) and abs(p) <= law.terms(RHO, E, RHO0, CS, a)
    h = Fraction(1, 1000)
    sides = [law.pressure(RHO + sign * h, E, RHO0, CS, a) for sign in (1, -1)]
    # A cubic's central difference is its slope and cs^2 A3 h^2.
    cubic = CS**2 * a * h**2 if style == "cubic" else 0
    assert (sides[0] - sides[1]) / (2 * h) - cubic == law.stiffness(RHO, E, RHO0, CS, a)


def test_energy_terms_are_slopes_of_the_pressure() -> None:
    (gas,) = (law for law in LAWS.values() if law.needs_energy)
    assert gas.energy is not None
    a, h = parameter(gas), Fraction(1, 1000)
    rise = gas.pressure(RHO, E + h, RHO0, CS, a) - gas.pressure(RHO, E, RHO0, CS, a)
    assert rise / h == gas.energy.slope(RHO, E, RHO0, CS, a), "linear in the energy"
    assert gas.density(gas.pressure(RHO, E, RHO0, CS, a), E, RHO0, CS, a) == RHO
    stiffness = gas.stiffness(RHO, E, RHO0, CS, a)
    assert stiffness * gas.energy.inverse_slope(RHO, E, RHO0, CS, a) == gas.energy.slope(RHO, E, RHO0, CS, a)
    assert gas.energy.sound_squared(E, a) == stiffness
