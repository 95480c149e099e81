"""Vectors and matrices of many particles as lists of columns, one array per Cartesian axis: any number type serves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Rounded, error, value

Axes = list[Array]  # one array per Cartesian axis


def axes(array_nc: Array) -> Axes:
    """Split an (n, d) array into its d columns, each (n,)."""
    return [array_nc[..., a] for a in range(array_nc.shape[-1])]


def matrix(array_ncc: Array) -> list[Axes]:
    """Split an (n, d, d) array into rows of components, each (n,)."""
    d = array_ncc.shape[-1]
    return [[array_ncc[..., a, b] for b in range(d)] for a in range(d)]


def joined(columns: Sequence[Array] | Sequence[Axes]) -> Array:
    """Put columns together again to (n, d), or rows of columns to (n, d, d)."""
    rows: Any = columns if isinstance(columns[0], list) else [columns]
    parts = [part for row in rows for part in row]
    shape = len(parts[0]), *([len(rows)] if rows is columns else []), len(rows[0])
    if any(isinstance(part, Rounded) for part in parts):
        return Rounded(_side_by_side([value(p) for p in parts], shape), _side_by_side([error(p) for p in parts], shape))
    return _side_by_side([value(p) for p in parts], shape)


def _side_by_side(parts: Sequence[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    array = np.empty((len(parts[0]), len(parts)), np.result_type(*parts))  # np.stack takes twice as long
    for k, part in enumerate(parts):
        array[:, k] = part
    return array.reshape(shape)


def symmetric(rows: Sequence[Axes]) -> list[Axes]:
    """Return rows of components with those above the diagonal below it, too."""
    d = range(len(rows))
    return [[rows[min(a, b)][max(a, b)] for b in d] for a in d]


def summed(array_n: Array) -> Array:
    """Return the sum of all elements, in every element, (n,)."""
    n = len(array_n)
    if isinstance(array_n, Rounded):
        total = array_n.sum_by(np.zeros(n, int), 1)
        return Rounded(np.full(n, total.value[0]), total.error[0])
    return np.full(n, value(array_n).sum())


def dot(a: Axes, b: Axes) -> Array:
    """Return the scalar product of two vectors, shape (n,)."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total = total + x * y
    return total
