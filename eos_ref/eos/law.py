"""One equation of state: its formulas, its parameter, its domain and what rounding does to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

Formula = Callable[[Any, Any, Any, Any, Any], Any]  # of numbers of one type, see `eos_ref.numbers.number.Number`


class Interval(NamedTuple):
    """An interval of densities; the ends may be infinite."""

    low: float
    high: float


EVERYWHERE = Interval(-math.inf, math.inf)


@dataclass(frozen=True)
class EnergyTerms:
    r"""Further formulas of a law that depends on the internal energy per unit mass.

    Attributes
    ----------
    slope, inverse_slope : Formula
        :math:`(\partial P/\partial e)_\rho` and :math:`(\partial\rho/\partial e)_P` up to its sign, of density and
        energy.
    underflow : Formula
        Change of the pressure by one spacing of the subnormal numbers in a factor; see `eos_ref.eos.bounds.underflow`.
    sound_squared : function of e and the parameter
        Square of the speed of sound that the pair terms use in place of that of fix rheo.
    """

    slope: Formula
    inverse_slope: Formula
    underflow: Formula
    sound_squared: Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Law:
    r"""One equation of state; everything that distinguishes it from the others.

    A `Formula` takes density (or pressure, of an inverse), energy per unit mass, rho0, cs and the parameter; the law
    ignores what it does not depend on. It does not include the background pressure.

    Attributes
    ----------
    style : str
        Name in fix rheo/pressure.
    pressure, density, stiffness : Formula
        :math:`P(\rho, e)`, its inverse and :math:`(\partial P/\partial\rho)_e`, from `eos_ref.eos.laws`.
    terms, terms_text : Formula, str
        Sum of the absolute values of the terms that the documented formula adds, and the same as a report prints it.
    roundings : function of the parameter
        Roundings k on the longest path of the documented formula, in any order; see `eos_ref.eos.bounds`.
    reference_eps : float
        Roundings of ``pressure`` as evaluated here, background included, in eps (two roundings each); of a power law
        the factor of :math:`1 + |\gamma\ln(\rho/\rho_0)|`.
    lammps : function of rho, energy and mass of the particle, rho0, cs, parameter
        Pressure with LAMMPS' roundings, from `eos_ref.eos.lammps_rounding`.
    parameter : str, optional
        Name of the argument of the style.
    allows, rule : function of the parameter, str
        Whether a finite parameter is one of the law, and the rule that is printed if it is not.
    exponent : function of the parameter
        Exponent :math:`\gamma` of Tait's law, None for other laws.
    uses_powm1 : bool
        Whether ``pressure`` calls `powm1`, whose compiled form covers ratios from 2**-1000 to 2**1000 only.
    defined, has_pole : functions of the parameter
        Interval of densities with a real, finite value, and whether the density 0 is excluded from it.
    monotone : function of rho0 and the parameter
        Interval around rho0 on which the pressure grows with density.
    textbook : Formula, optional
        The pressure as printed, with numpy's power, where that differs from ``pressure``.
    takes_cs : bool
        Whether the pressure depends on the speed of sound and the equilibrium density of fix rheo.
    energy : EnergyTerms, optional
        Of a law that depends on the energy.
    example : float, optional
        A parameter, for measurements, at which the law does not coincide with another one.
    """

    style: str
    pressure: Formula
    density: Formula
    stiffness: Formula
    terms: Formula
    terms_text: str
    roundings: Callable[[float], float]
    reference_eps: float
    lammps: Callable[[Any, Any, Any, Any, Any, Any], Any]
    parameter: str | None = None
    allows: Callable[[float], bool] = lambda parameter: True
    rule: str = ""
    exponent: Callable[[float], float | None] = lambda parameter: None
    uses_powm1: bool = False
    defined: Callable[[float], Interval] = lambda parameter: EVERYWHERE
    has_pole: Callable[[float], bool] = lambda parameter: False
    monotone: Callable[[float, float], Interval] = lambda rho0, parameter: EVERYWHERE
    textbook: Formula | None = None
    takes_cs: bool = True
    energy: EnergyTerms | None = None
    example: float | None = None

    @property
    def needs_energy(self) -> bool:
        """Return whether the pressure depends on the internal energy."""
        return self.energy is not None
