"""Elementary functions for every number type that a law may be evaluated in.

A law (`eos_ref.eos.laws`) is written once, in plain operators and these functions. They act on numpy arrays and
scalars of any floating type, on Arb balls and on `eos_ref.numbers.rounded` arrays; `eos_ref.eos.compiled` registers
their compiled counterparts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeGuard, TypeVar

import numpy as np

from eos_ref.numbers.number import Number

N = TypeVar("N", bound=Number)
PLAIN = np.ndarray, float, int, np.float64  # tested by type: to look for a method takes as long as small arrays do


def _is_ball(x: Number) -> bool:
    return type(x).__module__.startswith("flint")


def _has(x: Any, name: str) -> TypeGuard[Any]:
    """Return whether a number has a function of its own."""
    return type(x) not in PLAIN and hasattr(x, name)


def _unary(name: str, ufunc: Callable[[Any], Any]) -> Callable[[N], N]:
    def function(x: N) -> N:
        return getattr(x, name)() if _has(x, name) else ufunc(x)  # type: ignore[no-any-return]

    function.__name__ = name
    function.__doc__ = f"Return ``{name}(x)`` of an array, a scalar or an Arb ball."
    return function


asin = _unary("asin", np.arcsin)
asinh = _unary("asinh", np.arcsinh)
exp = _unary("exp", np.exp)
log1p = _unary("log1p", np.log1p)
sin = _unary("sin", np.sin)
sinh = _unary("sinh", np.sinh)
sqrt = _unary("sqrt", np.sqrt)


def maximum(a: N | float, b: N | float) -> N:
    """Return the larger of two numbers, element by element."""
    for x in (a, b):
        if _has(x, "maximum"):
            return x.maximum(b if x is a else a)  # type: ignore[no-any-return]
    return np.maximum(a, b)  # type: ignore[no-any-return, arg-type]


def minimum(a: N | float, b: N | float) -> N:
    """Return the smaller of two numbers, element by element."""
    for x in (a, b):
        if _has(x, "minimum"):
            return x.minimum(b if x is a else a)  # type: ignore[no-any-return]
    return np.minimum(a, b)  # type: ignore[no-any-return, arg-type]


def where(condition: Any, a: N | float, b: N | float) -> N:
    """Return ``a`` where the condition holds, else ``b``; both are evaluated."""
    for x in (condition, a, b):
        if _has(x, "where"):
            return x.where(condition, a, b)  # type: ignore[no-any-return]
    return np.where(condition, a, b)  # type: ignore[return-value, arg-type]


def powm1(rho: Any, rho0: Any, gamma: Any) -> Any:
    r"""Return the power of a ratio, less one: :math:`(\rho/\rho_0)^\gamma - 1`, accurate where the two nearly cancel.

    Evaluated as :math:`\mathrm{expm1}(\gamma \ln(\rho/\rho_0))`, the logarithm taken from the exact
    difference :math:`\rho-\rho_0` near :math:`\rho_0`. A negative ratio has a value only for whole ``gamma``.

    Parameters
    ----------
    rho, rho0, gamma : array, scalar or Arb ball
        Any dimension that cancels in ``rho/rho0``; ``gamma`` is a plain number.

    Returns
    -------
    array, scalar or Arb ball
        Without dimension. NaN where the power is undefined. Relative error in float64 at most
        4 eps (1 + \|gamma ln(rho/rho0)\|) for rho > 0; for rho < 0 relative to \|rho/rho0\|^gamma + 1.
    """
    if _is_ball(rho):
        return (rho / rho0) ** gamma - 1
    rho = np.asarray(rho)
    with np.errstate(all="ignore"):
        a = np.abs(rho)
        d = (a - rho0) / rho0
        x = a / rho0
        # A quotient that is subnormal, 0 or infinite has lost its digits: there subtract the logarithms.
        normal = (x >= np.finfo(x.dtype).tiny) & (x <= np.finfo(x.dtype).max)
        log_x = np.where(normal, np.log(x), np.log(a) - np.log(x.dtype.type(rho0)))
        value = np.expm1(gamma * np.where(np.abs(d) < 0.5, np.log1p(d), log_x))
        if gamma == np.rint(gamma):
            odd = bool(gamma % 2)
            return np.where(rho < 0, -value - 2 if odd else value, value)[()]
        return np.where(rho < 0, np.nan, value)[()]


def root1p(y: N, gamma: Number) -> N:
    r"""Return the inverse power :math:`(1 + y)^{1/\gamma}`, NaN for :math:`y < -1`.

    Parameters
    ----------
    y, gamma : array, scalar or Arb ball
        Plain numbers.
    """
    with np.errstate(all="ignore"):
        return exp(log1p(y) / gamma)
