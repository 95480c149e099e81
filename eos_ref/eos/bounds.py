r"""Rounding bounds of the laws, derived and with their derivation in words.

A correct implementation may evaluate the documented formula in any order. Each operation rounds once (unit
roundoff :math:`u = 2^{-53}`), so the result differs from the exact one by at most
:math:`\gamma_k \sum|\mathrm{terms}|` with :math:`\gamma_k = k u/(1 - k u)` and k the number of roundings on
the longest path (Higham, Accuracy and Stability of Numerical Algorithms, section 3.1). A rounding of the base
of a power counts gamma times. The power itself counts two: ``pow`` of a mathematical library is within one
unit of the last place; a power put together as exp(gamma log(x)) is not covered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from eos_ref.eos.registry import SUBNORMAL
from eos_ref.eos.table import EOS, EOSTable, FloatArray
from eos_ref.numbers.elementary import powm1

UNIT_ROUNDOFF = 2.0**-53
EPS = 2.0**-52


@dataclass(frozen=True)
class RoundingBound:
    """Roundings on the longest path and what they multiply.

    Attributes
    ----------
    operations : float
        Number of roundings k.
    terms : str
        The absolute terms, as printed in a report.
    """

    operations: float
    terms: str

    def __str__(self) -> str:
        return f"{self.operations:g} roundings x 2^-53 x ({self.terms})"


def derivation(eos: EOS) -> RoundingBound:
    """Return the derivation of a law's bound; `engine` evaluates it."""
    bound = RoundingBound(eos.law.roundings(eos.parameter or 0.0), eos.law.terms_text)
    if eos.background:
        bound = RoundingBound(bound.operations + 1, bound.terms + " + |P_b|")
    return bound


def absolute_terms(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Sum of the absolute values of the terms that the documented formula adds (pressure)."""
    with np.errstate(all="ignore"):
        terms = eos.law.terms(rho, None if e is None else np.asarray(e), eos.rho0, eos.cs, eos.parameter)
        return np.asarray(terms + abs(eos.background))


def power_condition(eos: EOS, rho: FloatArray) -> FloatArray:
    r"""Return 1 + \|gamma ln(rho/rho0)\| for the power laws, 1 for the others."""
    if eos.exponent is None:
        return np.ones_like(rho)
    with np.errstate(all="ignore"):
        # a difference of logarithms: the quotient itself may overflow or underflow
        return np.asarray(1 + np.abs(eos.exponent * (np.log(np.abs(rho)) - np.log(eos.rho0))))


def underflow(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Return the error of one operation below 2**-1022, where rounding is no longer relative (pressure).

    One spacing of the subnormal numbers; in a product with the energy the other factors may magnify it.
    """
    if e is None or eos.law.energy is None:
        return np.full_like(rho, SUBNORMAL, dtype=float)
    return np.asarray(SUBNORMAL + eos.law.energy.underflow(rho, e, eos.rho0, eos.cs, eos.parameter))


def engine(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Return the bound on rounding of the documented formula in any order (powers by `pow` or products; pressure)."""
    k = derivation(eos).operations
    gamma_k = k * UNIT_ROUNDOFF / (1 - k * UNIT_ROUNDOFF)
    bound = gamma_k * absolute_terms(eos, rho, e) + k * underflow(eos, rho, e)
    if (gamma := eos.exponent) is not None:
        # A quotient rho/rho0 below 2**-1022 may have lost all its digits, and its power with them.
        with np.errstate(all="ignore"):
            power = eos.cs * eos.cs * eos.rho0 / gamma * np.abs(powm1(rho, eos.rho0, gamma) + 1)
            lost = power if gamma > 0 else np.inf
            bound = bound + np.where((rho != 0) & (np.abs(rho) / eos.rho0 < 2.0**-1022), lost, 0)
    return bound


def reference(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Return the bound on the error of `EOS.pressure` itself; tests compare it with Arb over the whole domain."""
    terms = absolute_terms(eos, rho, e)
    condition = power_condition(eos, rho)
    factor = eos.law.reference_eps
    # At rho = 0 the logarithm is infinite and the power exact; eps first, so that no finite bound overflows.
    relative = factor * EPS * terms * np.where(np.isfinite(condition), condition, 1)
    return relative + factor * underflow(eos, rho, e)


def comparison_derivation(eos: EOS) -> str:
    """Describe what `comparison` adds up for a law: the engine's roundings and the reference's own error."""
    own = f"{eos.law.reference_eps:g} eps of the same terms"
    if eos.exponent is not None:
        own += " x (1 + |gamma ln(rho/rho0)|)"
    return f"LAMMPS {derivation(eos)} + reference {own}"


def comparison(
    table: EOSTable, rho_n: FloatArray, type_n: npt.NDArray[np.integer], e_n: FloatArray | None = None
) -> FloatArray:
    """Return the largest difference that rounding alone makes between engine and reference, per particle (pressure)."""
    bound_n = np.full(rho_n.shape, np.nan)  # no value of a type without a law is within its bound
    for t, law in enumerate(table.laws, 1):
        of_type = type_n == t
        rho = rho_n[of_type]
        e = None if e_n is None else e_n[of_type]
        bound_n[of_type] = engine(law, rho, e) + reference(law, rho, e)
    return bound_n
