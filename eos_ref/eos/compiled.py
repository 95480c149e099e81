"""Compiled loops over particles: the laws of `eos_ref.eos.laws` at the speed of memory.

Nothing is written twice: numba compiles the bodies in `laws`, and the elementary functions they call are
registered here for compiled code. `powm1` is branch-free (one division, two polynomials, explicit fused
multiply-adds), so that the loop over particles runs in vector registers and gives the same bits on every
machine; the few ratios outside its range are counted and left to the caller.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, register_jitable

from eos_ref.eos import laws
from eos_ref.eos.law import Law
from eos_ref.eos.registry import LAWS, STYLES
from eos_ref.jit import cached, inline
from eos_ref.numbers import elementary

_jit = cached()
BLOCK = 2048  # particles handled at a time: all arrays of a block fit the first-level cache


@intrinsic
def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a*b + c with one rounding, on every machine."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), code


@intrinsic
def _bits(typing_context: Any, x: Any) -> Any:
    """Return the 64 bits of a double."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.IntType(64))

    return types.uint64(types.float64), code


@intrinsic
def _from_bits(typing_context: Any, x: Any) -> Any:
    """Return the double with these 64 bits."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.uint64), code


# ln 2 in two doubles; the first has 11 trailing zero bits, so that k*ln2 is exact for |k| < 2**11.
_LN2_HIGH = float.fromhex("0x1.62e42fefa3800p-1")
_LN2_LOW = float.fromhex("0x1.ef35793c76730p-45")
_INVERSE_LN2 = 1 / math.log(2)
_ROUND = 1.5 * 2.0**52  # adding it rounds a double to a whole number, held in the lowest bits
_BIAS = 1023
_MANTISSA = np.uint64(52)
_TWO_52 = np.uint64(0x4330000000000000)  # bits of 2**52
_SQRT_HALF = np.uint64(0x3FF0000000000000 - 0x3FE6A09E667F3BCD)  # bits of 1 less those of sqrt(1/2)
_FLIP = np.uint64(2 * _BIAS)
_HALF = np.uint64(_BIAS - 1)
_L1, _L2, _L3, _L4, _L5, _L6, _L7, _L8, _L9, _L10 = (1 / (2 * k + 1) for k in range(1, 11))
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (1 / math.factorial(k) for k in range(2, 14))


@inline
def _log_ratio(a: float, b: float) -> float:
    """Return ln(a/b) for ratios within 2**-1000 to 2**1000, relative error below 2 eps.

    a is scaled by a power of two to within sqrt(2) of b, where a - b is exact; then
    ln(a/b) = 2 atanh(s), s = (a-b)/(a+b), by its series (s**2 < 0.0295, remainder below 2**-58).
    """
    exponent = (_bits(a * (1 / b)) + _SQRT_HALF) >> _MANTISSA
    k = _from_bits(exponent | _TWO_52) - (2.0**52 + _BIAS)
    a = a * _from_bits((_FLIP - exponent) << _MANTISSA)
    s = (a - b) / (a + b)
    z = s * s
    zz = z * z
    low = _fma(_fma(_L6, z, _L5), zz, _fma(_L4, z, _L3))
    high = _fma(_fma(_L10, z, _L9), zz, _fma(_L8, z, _L7))
    series = _fma(_fma(high, zz * zz, low), zz, _fma(_L2, z, _L1))
    t = s + s
    return _fma(k, _LN2_HIGH, t + _fma(t * z, series, k * _LN2_LOW))  # type: ignore[no-any-return]


@inline
def _expm1(y: float) -> float:
    """Return exp(y) - 1, relative error below 2 eps; infinite above 709.8, NaN stays NaN."""
    y = 710.0 if y > 710.0 else y
    y = -700.0 if y < -700.0 else y
    shifted = _fma(y, _INVERSE_LN2, _ROUND)
    n = shifted - _ROUND
    r = _fma(n, -_LN2_LOW, _fma(n, -_LN2_HIGH, y))
    rr = r * r
    low = _fma(_fma(_E5, r, _E4), rr, _fma(_E3, r, _E2))
    high = _fma(_fma(_E13, r, _E12), rr, _fma(_E11, r, _E10))
    middle = _fma(_fma(_E9, r, _E8), rr, _fma(_E7, r, _E6))
    series = _fma(_fma(high, rr * rr, middle), rr * rr, low)
    q = _fma(rr, series, r)
    # 2**(n-1), so that n = 1024 does not overflow
    half_scale = _from_bits((_bits(shifted) + _HALF) << _MANTISSA)
    return 2.0 * _fma(half_scale, q, half_scale - 0.5)  # type: ignore[no-any-return]


# The outer function tells numba's typing which body serves; both must have the same arguments.
overload(elementary.powm1)(
    lambda rho, rho0, gamma: lambda rho, rho0, gamma: _expm1(gamma * _log_ratio(float(rho), float(rho0)))
)
# As in numpy, either's NaN is the result.
overload(elementary.maximum)(lambda a, b: lambda a, b: a if (a >= b) | (a != a) else b)
overload(elementary.minimum)(lambda a, b: lambda a, b: a if (a <= b) | (a != a) else b)
overload(elementary.where)(lambda condition, a, b: lambda condition, a, b: a if condition else b)
overload(elementary.root1p)(lambda y, gamma: lambda y, gamma: math.exp(math.log1p(y) / gamma))


def _register(name: str) -> None:
    compiled = getattr(math, name)
    overload(getattr(elementary, name))(lambda x: lambda x: compiled(x))


for _name in ("asin", "asinh", "exp", "log1p", "sin", "sinh", "sqrt"):
    _register(_name)

# The records of the laws call the formulas by name; a loop stays vectorised only where they are inlined.
for _formula in vars(laws).values():
    if getattr(_formula, "__module__", None) == laws.__name__:
        register_jitable(error_model="numpy", forceinline=True)(_formula)


def power_range(rho0: float) -> tuple[float, float]:
    """Return the least and greatest density for which the compiled powm1 holds; an empty interval for extreme rho0."""
    if not 2.0**-1000 <= rho0 <= 2.0**1000:  # 1/rho0 would not be a normal number
        return math.inf, -math.inf
    # Neither end may be rounded to 0 or to infinity, where the ratio has no exponent.
    return max(rho0 * 2.0**-1000, 2.0**-1074), min(rho0 * 2.0**1000, 2.0**1023)


_power_range = inline(power_range)


_BODIES = {law.style: inline(law.pressure) for law in LAWS.values()}


def _loop(law: Law) -> Any:
    """Return the loop over particles of one law; it returns how many ratios lie outside the range of powm1."""
    body, needs_energy, uses_powm1 = _BODIES[law.style], law.needs_energy, law.uses_powm1

    def loop(rho_n: Any, e_n: Any, rho0: float, cs: float, parameter: float, background: float, out_n: Any) -> int:
        for i in range(rho_n.size):
            e = e_n[i] if needs_energy else 0.0
            out_n[i] = body(rho_n[i], e, rho0, cs, parameter) + background
        outside = 0
        if uses_powm1:
            low, high = _power_range(rho0)
            for i in range(rho_n.size):
                outside += not (rho_n[i] >= low and rho_n[i] <= high)
        return outside

    return inline(loop)


@inline
def _no_law(
    style: int, rho_n: Any, e_n: Any, rho0: float, cs: float, parameter: float, background: float, out_n: Any
) -> int:
    out_n[:] = math.nan
    return 0


def _choice(styles: tuple[str, ...]) -> Any:
    """Return the loops of the last of `STYLES`, behind a chain of comparisons with their places there."""
    if not styles:
        return _no_law
    place, loop, others = STYLES.index(styles[0]), _loop(LAWS[styles[0]]), _choice(styles[1:])

    def chosen(
        style: int, rho_n: Any, e_n: Any, rho0: float, cs: float, parameter: float, background: float, out_n: Any
    ) -> int:
        if style == place:
            return loop(rho_n, e_n, rho0, cs, parameter, background, out_n)  # type: ignore[no-any-return]
        return others(style, rho_n, e_n, rho0, cs, parameter, background, out_n)  # type: ignore[no-any-return]

    return inline(chosen)


_chosen = _choice(STYLES)


@_jit
def _one_type(
    style: int, rho_n: Any, e_n: Any, rho0: float, cs: float, parameter: float, background: float, out_n: Any
) -> int:
    """Evaluate the pressure of particles that share one type; return how many ratios lie outside the range of powm1."""
    return _chosen(style, rho_n, e_n, rho0, cs, parameter, background, out_n)  # type: ignore[no-any-return]


@numba.njit(error_model="numpy")
def _extremes(type_b: Any) -> tuple[int, int]:
    """Return the lowest and highest type of a block."""
    low = high = type_b[0]
    for i in range(type_b.size):
        low = type_b[i] if type_b[i] < low else low
        high = type_b[i] if type_b[i] > high else high
    return low, high


@numba.njit(error_model="numpy")
def _pick(value_b: Any, type_b: Any, t: int, out_b: Any) -> None:
    """Take the values of one type's particles; by bit masks, as a branch on shuffled types is mispredicted."""
    for i in range(value_b.size):
        keep = np.uint64(type_b[i] == t) - np.uint64(1)
        out_b[i] = _from_bits((_bits(out_b[i]) & keep) | (_bits(value_b[i]) & ~keep))


@_jit
def pressure(
    rho_n: Any,
    e_n: Any,
    type_n: Any,
    style_t: Any,
    rho0_t: Any,
    cs_t: Any,
    parameter_t: Any,
    background_t: Any,
    out_n: Any,
) -> int:
    """Evaluate the pressure of every particle from the law of its type, in blocks that stay in the first-level cache.

    Per-type arrays are indexed by type - 1. A block of one type is evaluated in place; in a mixed block each
    law runs over the whole block and its type's particles are picked, which keeps every loop vectorised.
    Returns the number of particles outside the range of `powm1`, whose pressure is for the caller to set.
    """
    scratch = np.empty(BLOCK)
    outside = 0
    for start in range(0, rho_n.size, BLOCK):
        stop = min(start + BLOCK, rho_n.size)
        e_b = e_n[start:stop] if e_n.size else e_n
        low, high = _extremes(type_n[start:stop])
        for t in range(low - 1, high):
            target = out_n[start:stop] if low == high else scratch[: stop - start]
            law = rho0_t[t], cs_t[t], parameter_t[t], background_t[t]
            outside += _one_type(style_t[t], rho_n[start:stop], e_b, *law, target)
            if low != high:
                _pick(target, type_n[start:stop], t + 1, out_n[start:stop])
    return outside


@_jit
def pressure_of_one_type(
    rho_n: Any, e_n: Any, style: int, rho0: float, cs: float, parameter: float, background: float, out_n: Any
) -> int:
    """Evaluate the pressure of particles that all have the same law; see `pressure`."""
    outside = 0
    for start in range(0, rho_n.size, BLOCK):
        stop = min(start + BLOCK, rho_n.size)
        e_b = e_n[start:stop] if e_n.size else e_n
        outside += _one_type(style, rho_n[start:stop], e_b, rho0, cs, parameter, background, out_n[start:stop])
    return outside
