"""Values with a proven error: the laws evaluated in Arb ball arithmetic (python-flint)."""

from __future__ import annotations

from flint import arb, ctx

from eos_ref.eos.table import EOS
from eos_ref.errors import InputError


def pressure(eos: EOS, rho: float, e: float | None = None, bits: int = 100) -> arb:
    """Return the pressure of one particle as a ball whose relative radius is below 2**-bits.

    The same body of the law as everywhere else, evaluated with balls; the working precision is doubled until
    the radius is small enough, so cancellation costs time and never digits.

    Parameters
    ----------
    eos : EOS
        The law.
    rho, e : float
        Density and internal energy per unit mass, taken as exact.
    bits : int
        Relative accuracy required.

    Returns
    -------
    flint.arb

    Raises
    ------
    InputError
        The law is not defined at this density.
    """
    if not eos.is_defined(rho):
        raise InputError(f"density for {eos.style}", f"must lie within {tuple(eos.defined)}", rho)
    before = ctx.prec
    try:
        ctx.prec = 2 * bits
        while True:
            p = eos.evaluate(arb(rho), None if e is None else arb(e), arb)
            if p.rel_accuracy_bits() >= bits or (p.contains(0) and ctx.prec > 16 * bits):
                return p
            ctx.prec *= 2
    finally:
        ctx.prec = before


def error(value: float, exact: arb) -> float:
    """Return the absolute error of a float against a ball, rounded up to a float."""
    if value != value:  # NaN: infinitely wrong, never close
        return float("inf")
    return float(abs(arb(value) - exact).upper())
