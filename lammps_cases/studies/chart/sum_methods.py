r"""Ways to add up a particle sum over given pairs.

The terms are given: of a pair p of particles i and j both get the same number :math:`t_p` (a kernel value; or
:math:`V(f_j-f_i)\,\partial W/\partial x`, in which both factors change their sign). What a method may choose is the
list (each pair once, added to both; or every particle's pairs in a row of its own), the order, the precision, and
whether rounding errors are carried along.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numba
import numpy as np

import eos_ref.jit  # noqa: F401  chooses the registers before anything is compiled
from eos_ref.eos.table import FloatArray

Sum = Callable[[], FloatArray]
LEAVES = 8  # terms that a pairwise sum adds in a row
_jit = numba.njit(error_model="numpy", cache=True, nogil=True)


@dataclass(frozen=True)
class Half:
    """Pairs of particles, each once.

    Attributes
    ----------
    start_n : (n + 1,) int64, where the rows begin
    j_p : (pairs,) uint32, partner of a row's particle
    """

    start_n: Any
    j_p: Any

    def __len__(self) -> int:
        return len(self.start_n) - 1

    @property
    def i_p(self) -> Any:
        """(pairs,) int64, the row of every pair."""
        return np.repeat(np.arange(len(self)), np.diff(self.start_n))


@dataclass(frozen=True)
class SumMethod:
    """One way to add up.

    Attributes
    ----------
    reason : what it is and why one would take it, in a line
    prepare : function of a list and its terms (pairs,); returns a function without arguments that returns the sums (n,)
    bound : function of the number of terms of a particle; bound of the error, relative to the sum of absolute terms
    """

    name: str
    reason: str
    prepare: Callable[[Half, FloatArray], Sum]
    bound: Callable[[Any], Any]


def rows(pairs: Half, term_p: FloatArray) -> tuple[Any, FloatArray]:
    """Return the full list: starts of its rows (n + 1,), and its terms, in every row in the order of `Half`."""
    n, i_p = len(pairs), pairs.i_p
    of_q = np.concatenate([i_p, pairs.j_p]).astype(np.int64)
    pair_q = np.tile(np.arange(len(i_p)), 2)
    order_q = np.lexsort((pair_q, of_q))
    start_n = np.concatenate([[0], np.cumsum(np.bincount(of_q, minlength=n))])
    return start_n, term_p[pair_q[order_q]]


def exact(pairs: Half, term_p: FloatArray) -> FloatArray:
    """Return the exactly rounded sums (n,)."""
    return _fsum(pairs, term_p)()


def error(sum_n: FloatArray, exact_n: FloatArray, absolute_n: FloatArray) -> float:
    """Return the worst error of sums, relative to the (exact) sums of absolute terms.

    The exact sums are rounded once: an error below 2**-52 may be theirs.
    """
    return float(np.max(np.abs(sum_n - exact_n) / absolute_n))


# --- loops


@_jit
def _scatter(start_n: Any, j_p: Any, term_p: Any, sum_n: Any) -> None:
    for i in range(start_n.size - 1):
        total = sum_n[i] - sum_n[i]  # 0 in the precision of the sums
        for p in range(start_n[i], start_n[i + 1]):
            total += term_p[p]
            sum_n[j_p[p]] += term_p[p]
        sum_n[i] += total


@_jit
def _gather(start_n: Any, term_q: Any, sum_n: Any) -> None:
    for i in range(start_n.size - 1):
        total = sum_n[i]
        for q in range(start_n[i], start_n[i + 1]):
            total += term_q[q]
        sum_n[i] = total


@_jit
def _add(total: float, carry: float, term: float) -> tuple[float, float]:
    """Return a sum and its carry with one more term, by Neumaier's method: the carry takes the rounding errors."""
    new = total + term
    if abs(total) >= abs(term):
        return new, carry + ((total - new) + term)
    return new, carry + ((term - new) + total)


@_jit
def _scatter_compensated(start_n: Any, j_p: Any, term_p: Any, sum_n: Any) -> None:
    carry_n = np.zeros(sum_n.size)
    for i in range(start_n.size - 1):
        total, carry = 0.0, 0.0
        for p in range(start_n[i], start_n[i + 1]):
            j, term = j_p[p], term_p[p]
            total, carry = _add(total, carry, term)
            sum_n[j], carry_n[j] = _add(sum_n[j], carry_n[j], term)
        sum_n[i], carry = _add(sum_n[i], carry, total)
        carry_n[i] += carry
    for i in range(sum_n.size):
        sum_n[i] += carry_n[i]


@_jit
def _gather_compensated(start_n: Any, term_q: Any, sum_n: Any) -> None:
    for i in range(start_n.size - 1):
        total, carry = 0.0, 0.0
        for q in range(start_n[i], start_n[i + 1]):
            total, carry = _add(total, carry, term_q[q])
        sum_n[i] = total + carry


@_jit
def _gather_four(start_n: Any, term_q: Any, sum_n: Any) -> None:
    """Add in four sums at a time, so that an addition need not wait for the one before it."""
    for i in range(start_n.size - 1):
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        rest = start_n[i] + (start_n[i + 1] - start_n[i]) // 4 * 4
        for q in range(start_n[i], rest, 4):
            a += term_q[q]
            b += term_q[q + 1]
            c += term_q[q + 2]
            d += term_q[q + 3]
        for q in range(rest, start_n[i + 1]):
            a += term_q[q]
        sum_n[i] = (a + b) + (c + d)


@_jit
def _gather_pairwise(start_n: Any, term_q: Any, sum_n: Any) -> None:
    """Add blocks of `LEAVES` terms and join them two by two, as the digits of a binary counter are."""
    level_k = np.empty(64)
    for i in range(start_n.size - 1):
        blocks = 0
        for first in range(start_n[i], start_n[i + 1], LEAVES):
            total = 0.0
            for q in range(first, min(first + LEAVES, start_n[i + 1])):
                total += term_q[q]
            level, digits = 0, blocks
            while digits & 1:
                total += level_k[level]
                level += 1
                digits >>= 1
            level_k[level] = total
            blocks += 1
        total, level = 0.0, 0
        while blocks:
            if blocks & 1:
                total += level_k[level]
            level += 1
            blocks >>= 1
        sum_n[i] = total


# --- methods


def _looped(loop: Any, full: bool, dtype: Any = np.float64, sum_dtype: Any = np.float64) -> Any:
    """Return `SumMethod.prepare` of a loop over a half or a full list, for the precisions of terms and of sums."""

    def prepare(pairs: Half, term_p: FloatArray) -> Sum:
        start_n, terms = rows(pairs, term_p) if full else (pairs.start_n, term_p)
        indices = (start_n,) if full else (start_n, pairs.j_p)
        kept = terms.astype(dtype)

        def add() -> FloatArray:
            sum_n = np.zeros(len(pairs), sum_dtype)
            loop(*indices, kept, sum_n)
            return sum_n

        return add

    return prepare


def _bincount(pairs: Half, term_p: FloatArray) -> Sum:
    i_p, j_p, n = pairs.i_p, pairs.j_p.astype(np.int64), len(pairs)  # what bincount would turn them into each time
    return lambda: np.asarray(np.bincount(i_p, term_p, n) + np.bincount(j_p, term_p, n), float)


def _reduceat(pairs: Half, term_p: FloatArray) -> Sum:
    start_n, term_q = rows(pairs, term_p)
    filled_n = np.diff(start_n) > 0  # reduceat gives an empty row its successor's first term

    def add() -> FloatArray:
        sum_n = np.zeros(len(pairs))
        sum_n[filled_n] = np.add.reduceat(term_q, start_n[:-1][filled_n])
        return sum_n

    return add


def _fsum(pairs: Half, term_p: FloatArray) -> Sum:
    start_n, term_q = rows(pairs, term_p)

    def add() -> FloatArray:
        terms, starts = term_q.tolist(), start_n.tolist()
        return np.array([math.fsum(terms[a:b]) for a, b in pairwise(starts)])

    return add


# --- bounds; Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., sections 4.2 and 4.3

_32 = np.float32
_U, _U32 = 2.0**-53, 2.0**-24


def _bound(k: Any, u: float = _U) -> Any:
    """Return the bound of k additions one after the other."""
    return k * u / (1 - k * u)


def _four_bound(k: Any) -> Any:
    return _bound(k // 4 + 5)  # a quarter of them, up to three that are left over, two joints


def _pairwise_bound(k: Any) -> Any:
    # Of the terms of a block LEAVES are added, and blocks meet on log2 levels twice: as digits, and at the end.
    return _bound(LEAVES + 2 * np.ceil(np.log2(np.maximum(k / LEAVES, 1) + 1)))


def _compensated_bound(k: Any) -> Any:
    return 2 * _U + 2 * (k * _U) ** 2


def _single_terms_bound(k: Any, u: float = _U) -> Any:
    return _U32 + (1 + _U32) * _bound(k, u)


_single_bound = partial(_single_terms_bound, u=_U32)
_half, _full = partial(_looped, full=False), partial(_looped, full=True)
_half_compensated, _full_compensated = _half(_scatter_compensated), _full(_gather_compensated)
METHODS: tuple[SumMethod, ...] = (
    SumMethod(
        "half list", "each pair read once and added to both particles, as the reference does", _half(_scatter), _bound
    ),
    SumMethod("full list", "each pair read twice, every particle's sum kept in a register", _full(_gather), _bound),
    SumMethod(
        "full list, four sums",
        "the same in four sums: no addition waits for the one before",
        _full(_gather_four),
        _four_bound,
    ),
    SumMethod("bincount", "numpy's bincount on the half list: two calls, nothing to compile", _bincount, _bound),
    SumMethod("reduceat", "numpy's add.reduceat on the full list", _reduceat, _bound),
    SumMethod(
        "full list, pairwise",
        "every row added by halves: the error grows with log2 of the terms",
        _full(_gather_pairwise),
        _pairwise_bound,
    ),
    SumMethod(
        "half list, compensated",
        "Neumaier's compensated sum, a carry per particle",
        _half_compensated,
        _compensated_bound,
    ),
    SumMethod(
        "full list, compensated", "Neumaier's compensated sum, in registers", _full_compensated, _compensated_bound
    ),
    SumMethod(
        "half list, float32 terms",
        "terms stored in single precision, half the memory; sums in double",
        _half(_scatter, dtype=_32),
        _single_terms_bound,
    ),
    SumMethod("full list, float32 terms", "the same on the full list", _full(_gather, dtype=_32), _single_terms_bound),
    SumMethod(
        "half list, float32",
        "single precision throughout, on the half list",
        _half(_scatter, dtype=_32, sum_dtype=_32),
        _single_bound,
    ),
    SumMethod(
        "full list, float32",
        "single precision throughout, on the full list",
        _full(_gather, dtype=_32, sum_dtype=_32),
        _single_bound,
    ),
    SumMethod("fsum", "Python's math.fsum row by row: exactly rounded", _fsum, lambda k: _U + 0.0 * k),
)
