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
    """How the bound of a law comes about; `engine` evaluates it."""
    match eos.style:
        case "linear":  # rho - rho0; c*c; product
            bound = RoundingBound(3, "c^2 (|rho| + rho0)")
        case "cubic":  # d three times, two products, A3, sum, c*c, product
            bound = RoundingBound(9, "c^2 (|rho| + rho0) + c^2 |A3 (rho - rho0)^3|")
        case "tait/water":
            # as below, but the power may be a chain of 6 products
            bound = RoundingBound(2 * 7 + 12, "c^2 rho0/7 ((rho/rho0)^7 + 1)")
        case "tait/general":
            # base: reciprocal and product, both to the power gamma; pow 2; less one 1; c*c, rho0, product;
            # 1/gamma 2
            bound = RoundingBound(2 * abs(eos.gamma) + 8, "c^2 rho0/|gamma| ((rho/rho0)^gamma + 1)")
        case _:  # gamma - 1, rho, energy, mass
            bound = RoundingBound(4, "(gamma + 1) |rho e|")
    if eos.background:
        bound = RoundingBound(bound.operations + 1, bound.terms + " + |P_b|")
    return bound


def absolute_terms(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Sum of the absolute values of the terms that the documented formula adds (pressure)."""
    c2 = eos.cs * eos.cs
    d = rho - eos.rho0
    with np.errstate(all="ignore"):
        match eos.style:
            case "linear":
                terms = c2 * (np.abs(rho) + eos.rho0)
            case "cubic":
                terms = c2 * (np.abs(rho) + eos.rho0) + c2 * np.abs(eos.gamma * d * d * d)
            case "tait/water" | "tait/general":
                power = np.abs(powm1(rho, eos.rho0, eos.gamma) + 1)
                terms = c2 * eos.rho0 / abs(eos.gamma) * (power + 1)
            case _:
                terms = (eos.gamma + 1) * np.abs(rho * np.asarray(e))
        return np.asarray(terms + abs(eos.background))


def power_condition(eos: EOS, rho: FloatArray) -> FloatArray:
    r"""1 + \|gamma ln(rho/rho0)\| for the power laws, 1 for the others."""
    if not eos.style.startswith("tait"):
        return np.ones_like(rho)
    with np.errstate(all="ignore"):
        # a difference of logarithms: the quotient itself may overflow or underflow
        return np.asarray(1 + np.abs(eos.gamma * (np.log(np.abs(rho)) - np.log(eos.rho0))))


def underflow(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Error of one operation below 2**-1022, where rounding is no longer relative (pressure).

    One spacing of the subnormal numbers; in the product of the ideal gas the other factors may magnify it.
    """
    if e is None or not eos.needs_energy:
        return np.full_like(rho, 2.0**-1074, dtype=float)
    return np.asarray(2.0**-1074 + (eos.gamma + 1) * (2.0**-1074 * np.abs(rho) + 2.0**-1074 * np.abs(e)))


def engine(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Bound on the rounding error of the documented formula in any order (powers by `pow` or products; pressure)."""
    k = derivation(eos).operations
    gamma_k = k * UNIT_ROUNDOFF / (1 - k * UNIT_ROUNDOFF)
    bound = gamma_k * absolute_terms(eos, rho, e) + k * underflow(eos, rho, e)
    if eos.style.startswith("tait"):
        # A quotient rho/rho0 below 2**-1022 may have lost all its digits, and its power with them.
        with np.errstate(all="ignore"):
            power = eos.cs * eos.cs * eos.rho0 / eos.gamma * np.abs(powm1(rho, eos.rho0, eos.gamma) + 1)
            lost = power if eos.gamma > 0 else np.inf
            bound = bound + np.where((rho != 0) & (np.abs(rho) / eos.rho0 < 2.0**-1022), lost, 0)
    return bound


# Roundings of the reference's own body, background included, in eps (two roundings each): 4 for linear and ideal/gas,
# 10 for cubic; the power laws' factor multiplies 1 + |gamma ln(rho/rho0)| and is what tests hold against Arb.
_REFERENCE_EPS = {"linear": 2, "cubic": 5, "tait/water": 4, "tait/general": 4, "ideal/gas": 2}


def reference(eos: EOS, rho: FloatArray, e: FloatArray | None = None) -> FloatArray:
    """Bound on the error of `EOS.pressure` itself; tests hold it against Arb over the whole domain."""
    terms = absolute_terms(eos, rho, e)
    condition = power_condition(eos, rho)
    factor = _REFERENCE_EPS[eos.style]
    # At rho = 0 the logarithm is infinite and the power exact; eps first, so that no finite bound overflows.
    relative = factor * EPS * terms * np.where(np.isfinite(condition), condition, 1)
    return relative + factor * underflow(eos, rho, e)


def comparison_derivation(eos: EOS) -> str:
    """In words, what `comparison` adds up for a law: the engine's roundings and the reference's own error."""
    own = f"{_REFERENCE_EPS[eos.style]:g} eps of the same terms"
    if eos.style.startswith("tait"):
        own += " x (1 + |gamma ln(rho/rho0)|)"
    return f"LAMMPS {derivation(eos)} + reference {own}"


def comparison(
    table: EOSTable, rho_n: FloatArray, type_n: npt.NDArray[np.integer], e_n: FloatArray | None = None
) -> FloatArray:
    """Largest difference that rounding alone makes between engine and reference, per particle (pressure)."""
    bound_n = np.full(rho_n.shape, np.nan)  # a type without a law is never close
    for t, law in enumerate(table.laws, 1):
        of_type = type_n == t
        rho = rho_n[of_type]
        e = None if e_n is None else e_n[of_type]
        bound_n[of_type] = engine(law, rho, e) + reference(law, rho, e)
    return bound_n
