"""Operations on `Rounded` arrays, compiled: one pass over memory where arrays take a dozen.

Every loop rounds as the operations in arrays do and in their order, so that the bits are the same. Once this module is
imported `Rounded` takes them: loading them costs as much as the bounds of some thousand particles.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

from eos_ref.jit import cached, inline
from eos_ref.numbers.rounded import ROUNDING, TINY, Array, Rounded

_READ, _OUT = "Array(float64, 1, 'C', True, aligned=True)", "float64[::1]"
_ROWS = [f"Array({index}, 1, 'C', True, aligned=True)" for index in ("int32", "int64")]  # int32: of blocks made again
_operation = cached("numbers/rounded.py", signature=f"void({', '.join([_READ] * 4 + [_OUT] * 2)})")


@inline
def _known(error: float) -> float:
    """Return an error, infinite if nothing is known of it."""
    return math.inf if math.isnan(error) else error


@_operation
def _add(a: Any, da: Any, b: Any, db: Any, x: Any, dx: Any) -> None:
    for k in range(x.size):
        x[k] = a[k] + b[k]
        dx[k] = _known(da[k] + db[k] + ROUNDING * abs(x[k]))


@_operation
def _subtract(a: Any, da: Any, b: Any, db: Any, x: Any, dx: Any) -> None:
    for k in range(x.size):
        x[k] = a[k] - b[k]
        dx[k] = _known(da[k] + db[k] + ROUNDING * abs(x[k]))


@_operation
def _multiply(a: Any, da: Any, b: Any, db: Any, x: Any, dx: Any) -> None:
    for k in range(x.size):
        x[k] = a[k] * b[k]
        error = _known(abs(a[k]) * db[k] + abs(b[k]) * da[k] + da[k] * db[k] + ROUNDING * abs(x[k]) + TINY)
        none = (a[k] == 0 and da[k] == 0 and db[k] < math.inf) or (b[k] == 0 and db[k] == 0 and da[k] < math.inf)
        dx[k] = 0.0 if none else error


@_operation
def _divide(a: Any, da: Any, b: Any, db: Any, x: Any, dx: Any) -> None:
    for k in range(x.size):
        x[k] = a[k] / b[k]
        room = abs(b[k]) - db[k]
        error = (da[k] + abs(x[k]) * db[k]) / room if room > 0 else math.inf
        none = a[k] == 0 and da[k] == 0 and room > 0
        dx[k] = 0.0 if none else _known(error + ROUNDING * abs(x[k]) + TINY)


@cached("numbers/rounded.py", signature=[f"void({', '.join([rows, *[_READ] * 2, *[_OUT] * 4])})" for rows in _ROWS])
def _sum_by(row_p: Any, x: Any, dx: Any, count_n: Any, absolute_n: Any, error_n: Any, sum_n: Any) -> None:
    for p in range(row_p.size):
        n = row_p[p]
        count_n[n] += 1
        absolute_n[n] += abs(x[p])
        error_n[n] += dx[p]
        sum_n[n] += x[p]


OPERATIONS = {"add": _add, "subtract": _subtract, "multiply": _multiply, "divide": _divide}


def operation(name: str, a: Any, b: Any) -> Rounded | None:
    """Return the sum, difference, product or quotient of two, one of which is `Rounded`; None: of different shapes."""
    shape = a.shape if isinstance(a, Rounded) else b.shape
    one, other = _flat(a, shape), _flat(b, shape)
    if one is None or other is None:
        return None
    x, dx = np.empty(shape), np.empty(shape)
    OPERATIONS[name](*one, *other, x.ravel(), dx.ravel())
    return Rounded.known(x, dx)


def _flat(side: Any, shape: tuple[int, ...]) -> tuple[Array, Array] | None:
    """Return values and errors of one side of an operation as arrays of one axis; None: it has another shape."""
    if isinstance(side, Rounded):
        return (side.value.ravel(), side.error.ravel()) if side.shape == shape else None
    values, size = np.asarray(side, float), math.prod(shape)
    if values.shape == shape:
        return values.ravel(), np.zeros(size)
    return None if values.shape else (np.full(size, values), np.zeros(size))


def sum_by(x: Rounded, row_p: Array, n: int) -> Rounded | None:
    """See `Rounded.sum_by`; None: the array is not one of one axis."""
    if x.value.ndim != 1:
        return None
    count_n, absolute_n, error_n, sum_n = np.zeros((4, n))
    _sum_by(row_p.ravel(), x.value.ravel(), x.error.ravel(), count_n, absolute_n, error_n, sum_n)
    return Rounded(sum_n, error_n + count_n * (ROUNDING * absolute_n))


Rounded.loops = sys.modules[__name__]
