"""Vectors and matrices of many particles as lists of columns, one array per Cartesian axis: any number type serves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eos_ref.numbers.rounded import Rounded, error, value

Number = Any  # numpy float64 or longdouble array, or Rounded
Axes = list[Number]  # one array per Cartesian axis


def axes(array_nc: Number) -> Axes:
    """Columns of an (n, d) array."""
    return [array_nc[..., a] for a in range(array_nc.shape[-1])]


def matrix(array_ncc: Number) -> list[Axes]:
    """Components of an (n, d, d) array."""
    d = array_ncc.shape[-1]
    return [[array_ncc[..., a, b] for b in range(d)] for a in range(d)]


def joined(columns: Sequence[Number]) -> Number:
    """Columns put together again to (n, d), or rows of columns to (n, d, d)."""
    if isinstance(columns[0], list):
        parts = [joined(row) for row in columns]
        axis = -2
    else:
        parts, axis = list(columns), -1
    if any(isinstance(part, Rounded) for part in parts):
        return Rounded(np.stack([value(p) for p in parts], axis), np.stack([error(p) for p in parts], axis))
    return np.stack(parts, axis)


def dot(a: Axes, b: Axes) -> Number:
    """Scalar product."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total = total + x * y
    return total
