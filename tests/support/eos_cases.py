"""Laws and densities that cover every regime, and their exact pressures, written from the manual once more.

Nothing here calls a law of `eos_ref`: whole exponents are evaluated in rational numbers, the others in Arb balls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from flint import arb, ctx, fmpz

from eos_ref import EOS

BITS = 400  # (rho/rho0)^gamma - 1 loses at most 52 + 7 bits (gamma = 0.01): more than any float can show remain
EPS = 2.0**-52
RHO0, CS = 997.3, 13.7  # neither is 1, nor a power of two: no product is exact by chance
SCALE = RHO0 * CS**2
BACKGROUNDS = (0.0, 0.31 * SCALE, -0.31 * SCALE)
FloatArray = npt.NDArray[np.float64]

LAWS: dict[str, EOS] = {
    "linear": EOS("linear", RHO0, CS),
    "cubic stiffening": EOS("cubic", RHO0, CS, 2.3e-3),
    "cubic softening": EOS("cubic", RHO0, CS, -2.3e-3),
    "cubic nearly flat": EOS("cubic", RHO0, CS, -1.7e-7),
    "cubic A3 = 0": EOS("cubic", RHO0, CS, 0.0),
    "tait/water": EOS("tait/water", RHO0, CS),
    **{
        f"tait/general {g:g}": EOS("tait/general", RHO0, CS, g)
        for g in (7.0, 2.0, 3.0, 1.0, 150.0, 4.3, 0.5, 0.01, -1.3, -2.0, -3.0)
    },
    "ideal/gas": EOS("ideal/gas", RHO0, CS, 1.4),
}
TAIT = {name: law for name, law in LAWS.items() if law.style.startswith("tait")}


def whole(law: EOS) -> bool:
    """Whether the power of the law is a whole number, or the law has no power."""
    return law.style != "tait/general" or float(law.gamma).is_integer()


def has_value(law: EOS, rho: float) -> bool:
    """Whether the manual's formula has a real, finite value."""
    if not np.isfinite(rho):
        return False
    if law.style != "tait/general":
        return True
    if rho == 0:
        return law.gamma > 0
    return rho > 0 or whole(law)


def ball(x: Fraction) -> arb:
    """A fraction as a ball of the current precision."""
    return arb(fmpz(x.numerator)) / arb(fmpz(x.denominator))


def law_terms(law: EOS, rho: float, e: float | None = None) -> list[arb]:
    """The terms whose sum is the pressure, exactly as the manual writes the formula, without the background."""
    r, r0, c2 = Fraction(rho), Fraction(law.rho0), Fraction(law.cs) ** 2
    match law.style:
        case "linear":
            return [ball(c2 * r), ball(-c2 * r0)]
        case "cubic":
            assert law.parameter is not None
            return [ball(c2 * r), ball(-c2 * r0), ball(c2 * Fraction(law.parameter) * (r - r0) ** 3)]
        case "ideal/gas":
            assert law.parameter is not None and e is not None
            g = Fraction(law.parameter)
            return [ball(g * r * Fraction(e)), ball(-r * Fraction(e))]
    g = Fraction(7) if law.style == "tait/water" else Fraction(law.gamma)
    factor = ball(c2 * r0 / g)
    if g.denominator == 1 and abs(g) < 10:
        power = ball((r / r0) ** g.numerator)
    elif rho == 0:
        power = arb(0)
    else:
        sign = -1 if rho < 0 and g % 2 else 1
        power = sign * (ball(g) * (ball(abs(r)).log() - ball(r0).log())).exp()
    return [factor * power, -factor]


@lru_cache(None)
def exact(law: EOS, rho: float, e: float | None = None) -> arb:
    """Pressure by the manual's formula, in balls of `BITS` bits."""
    before, ctx.prec = ctx.prec, BITS
    try:
        return sum(law_terms(law, rho, e), arb(0)) + arb(law.background)
    finally:
        ctx.prec = before


@lru_cache(None)
def allowed(law: EOS, rho: float, e: float | None = None, eps: float = EPS, subnormal: float = 2.0**-1074) -> float:
    """Error that the documentation of `EOS.pressure` allows, with the terms taken from the exact formula.

    4 eps: at most 8 roundings (u = eps/2) stand between the terms and the result, those within a logarithm or a
    power counted in the factor 1 + |gamma ln(rho/rho0)|. 2 eps for
    linear and ideal/gas: three roundings and the background. 5 eps for cubic: (rho - rho0) three times, three
    products, the sum, c*c, the last product and the background make ten.
    Below the normal numbers each of the operations may add half a spacing of the subnormal ones, which the other
    factors of the ideal gas' product magnify.
    """
    before, ctx.prec = ctx.prec, 200
    try:
        total = sum((abs(term) for term in law_terms(law, rho, e)), arb(0)) + abs(arb(law.background))
        if law.style.startswith("tait") and rho != 0:
            total *= 1 + abs(arb(law.gamma) * (abs(arb(rho)).log() - arb(law.rho0).log()))
        magnified = subnormal if e is None else subnormal * (1 + abs(rho) + abs(e))
        return (
            float(({"cubic": 5, "linear": 2, "ideal/gas": 2}.get(law.style, 4) * arb(eps) * total).upper())
            + 5 * magnified
        )
    finally:
        ctx.prec = before


def near(rho0: float = RHO0) -> FloatArray:
    """Densities within 1e-12 to 1e-1 of equilibrium, on both sides."""
    change = 10.0 ** np.linspace(-12, -1, 45)
    return np.concatenate([rho0 * (1 + change), rho0 * (1 - change)])


def densities(law: EOS) -> FloatArray:
    """Every regime in which the law has a value: equilibrium, compression, tension, vacuum, negative, extreme."""
    random = np.random.default_rng(7)
    r0 = law.rho0
    edges = [r0, np.nextafter(r0, 0), np.nextafter(r0, np.inf), 0.5 * r0, 1.5 * r0, 2.0 * r0, 3.0 * r0]
    positive = np.concatenate(
        [
            near(r0),
            edges,
            r0 * random.uniform(1, 3, 20),
            r0 * random.uniform(0, 1, 20),
            r0 * 10.0 ** random.uniform(-300, 0, 30),
            r0 * 10.0 ** random.uniform(0, 40, 20),
            10.0 ** random.uniform(-308, 308, 20),
            # both sides of the range of the compiled power, and the ends of the floats
            r0 * 2.0 ** np.array([-1000.0, -1001.0, -999.0, 999.0, 1000.0]),
            [1e-300, 2.0**-1074, 2.0**-1022, 1.7e308, 0.0],
        ]
    )
    rho_n = np.concatenate([positive, -positive])
    return rho_n[[has_value(law, float(rho)) for rho in rho_n]]


def energies(law: EOS, rho_n: FloatArray) -> FloatArray | None:
    """Energies per unit mass for the ideal gas, different for every particle."""
    if law.style != "ideal/gas":
        return None
    return 10.0 ** np.random.default_rng(8).uniform(-3, 3, rho_n.size)


def with_backgrounds(laws: dict[str, EOS] = LAWS) -> list[Any]:
    """Every law with no, a positive and a negative background, as named parameters of a test."""
    return [
        pytest.param(replace(law, background=b), id=f"{name}, P_b {b:+.0f}")
        for name, law in laws.items()
        for b in BACKGROUNDS
    ]


def violations(
    law: EOS,
    pressure: Callable[..., Any],
    rho_n: npt.ArrayLike | None = None,
    e_n: Any = None,
    eps: float = EPS,
    subnormal: float = 2.0**-1074,
    largest: float = np.finfo(float).max,
) -> list[str]:
    """Compare ``pressure(rho, e)`` with the exact pressure of ``law``; one line for each density outside the bound.

    A value beyond the largest float must be infinite with the right sign, or within its bound.
    """
    rho = densities(law) if rho_n is None else np.asarray(rho_n)
    e = energies(law, np.asarray(rho, float)) if e_n is None else np.asarray(e_n)
    with np.errstate(all="ignore"):
        p_n = np.asarray(pressure(rho) if e is None else pressure(rho, e))
    lines = []
    for i, value in enumerate(p_n):
        arguments = float(rho[i]), None if e is None else float(e[i])
        p = exact(law, *arguments)
        bound = allowed(law, *arguments, eps=eps, subnormal=subnormal)
        if np.isinf(value):
            close = abs(p) + bound >= largest and (p > 0) == (value > 0)
        else:
            close = bool(abs(arb(float(value)) - p) <= bound)
        if not close:
            distance = float(abs(arb(float(value)) - p)) / bound
            lines.append(
                f"rho={arguments[0]!r} e={arguments[1]!r}: {value!r}, exact {p.str(20)}, {distance:.3g} bounds"
            )
    return lines
