"""Small symmetric matrices, one per particle, for any number type: Cholesky factors and solutions."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.numbers.elementary import sqrt, where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Decision, Rounded, exact_zero, value


def cholesky(m: list[list[Array]]) -> tuple[list[list[Any]], Any]:
    """Factorise many symmetric matrices at once, given by rows of their lower triangles, entries of shape (n,).

    Returns their lower factors, likewise, and the flags (n,) of those that have one: the positive definite. Where
    rounding decides whether a matrix has one, nothing is known of the factor.
    """
    size = len(m)
    factor: list[list[Any]] = [[0.0] * size for _ in range(size)]
    definite_n: Any = np.ones(np.shape(value(m[0][0])), bool)  # a Decision for numbers that carry errors
    for a in range(size):
        for b in range(a + 1):
            rest: Any = m[a][b]
            for k in range(b):
                rest = rest - factor[a][k] * factor[b][k]
            if a == b:
                positive = rest > 0
                definite_n = definite_n & positive
                factor[a][a] = sqrt(where(value(rest) > 0, rest, 1.0))
                if isinstance(positive, Decision):
                    diagonal = factor[a][a]
                    factor[a][a] = Rounded(diagonal.value, np.where(positive.open, np.inf, diagonal.error))
            else:
                factor[a][b] = where(exact_zero(rest), 0.0, rest / factor[b][b])  # whatever the diagonal is
    return factor, definite_n


def solve_unit(factor: list[list[Any]], row: int) -> list[Any]:
    """Solve for the unit vector of one row, given the lower factors; one array (n,) for every component."""
    size = len(factor)
    y: list[Any] = []
    for a in range(size):
        rest: Any = 1.0 if a == row else 0.0
        for k in range(a):
            rest = rest - factor[a][k] * y[k]
        y.append(rest / factor[a][a])
    x: list[Any] = [0.0] * size
    for a in reversed(range(size)):
        rest = y[a]
        for k in range(a + 1, size):
            rest = rest - factor[k][a] * x[k]
        x[a] = rest / factor[a][a]
    return x
