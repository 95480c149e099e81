"""Dimensions of the formulas that the two pages quote, derived and compared with the units that they name."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import pytest

from lammps_cases.claims.model import claims

BY_ID = {claim.id: claim for claim in claims()}


@dataclass(frozen=True)
class Dimension:
    """Exponents of mass, length and time; terms of a sum must be equal, and only pure numbers take any exponent."""

    mass: Fraction = Fraction(0)
    length: Fraction = Fraction(0)
    time: Fraction = Fraction(0)

    def __mul__(self, other: Dimension) -> Dimension:
        """Product."""
        return Dimension(self.mass + other.mass, self.length + other.length, self.time + other.time)

    def __truediv__(self, other: Dimension) -> Dimension:
        """Quotient."""
        return self * other**-1

    def __pow__(self, power: int | Dimension) -> Dimension:
        """Power; if the exponent is a quantity, exponent and base must be pure numbers."""
        if isinstance(power, Dimension):
            assert self == power == PURE
            return PURE
        return Dimension(self.mass * power, self.length * power, self.time * power)

    def __add__(self, other: Dimension) -> Dimension:
        """Sum or difference."""
        assert self == other, f"{self} and {other} cannot be added"
        return self

    __sub__ = __add__


PURE = Dimension()
MASS, LENGTH, TIME = Dimension(mass=Fraction(1)), Dimension(length=Fraction(1)), Dimension(time=Fraction(1))
DENSITY, VELOCITY = MASS / LENGTH**3, LENGTH / TIME
PRESSURE, ENERGY = DENSITY * VELOCITY**2, MASS * VELOCITY**2
rho, rho0, c, e = DENSITY, DENSITY, VELOCITY, ENERGY / MASS


def kernel(dimension: int) -> Dimension:
    """W, whose integral over the volume is 1."""
    return PURE / LENGTH**dimension


def test_sum_of_different_dimensions_is_refused() -> None:
    with pytest.raises(AssertionError, match="cannot be added"):
        DENSITY + PRESSURE
    with pytest.raises(AssertionError):
        DENSITY**PURE


def test_laws_are_pressures() -> None:
    gamma = PURE
    assert c**2 * (rho - rho0) == PRESSURE
    assert (c**2 * rho0 / PURE) * ((rho / rho0) ** 7 - PURE) == PRESSURE
    assert (c**2 * rho0 / gamma) * ((rho / rho0) ** gamma - PURE) == PRESSURE
    assert (gamma - PURE) * rho * e == PRESSURE


def cubic(a3: Dimension) -> Dimension:
    """The cubic law with a prefactor of some dimension."""
    return c**2 * ((rho - rho0) + a3 * (rho - rho0) ** 3)


def test_prefactor_of_the_cubic_law() -> None:
    """The formula requires 1/density^2; the syntax names pressure/density^2."""
    assert cubic(PURE / DENSITY**2) == PRESSURE
    with pytest.raises(AssertionError):
        cubic(PRESSURE / DENSITY**2)
    assert BY_ID["pressure-a3-unit"].refuted_by and not BY_ID["pressure-a3-unit-of-formula"].refuted_by


@pytest.mark.parametrize("dimension", [2, 3])
def test_thresholds_of_the_support(dimension: int) -> None:
    """Neither the sum of W nor that of r W is the pure number of the syntax, nor is the latter a distance."""
    w = kernel(dimension)
    assert w != PURE and LENGTH * w not in (PURE, LENGTH)
    assert BY_ID["rheo-scale-wmin-unit"].refuted_by and BY_ID["rheo-scale-rmin-unit"].refuted_by
    assert BY_ID["rheo-scale-rmin-distance"].falls


def test_sums_of_the_kernel() -> None:
    """A summed density has the dimension of density; the divergence of positions, with volumes, is a pure number."""
    assert kernel(3) * MASS == DENSITY
    volume, gradient = MASS / DENSITY, kernel(3) / LENGTH
    assert volume * LENGTH * gradient == PURE
    assert not BY_ID["rheo-sum-formula"].refuted_by and not BY_ID["rheo-surface-limit-unit"].refuted_by
