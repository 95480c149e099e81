"""Compiled gradients of the reproducing kernels RK1 and RK2 for `eos_ref.compiled.evaluator`.

A moment matrix has few different entries: the moments of all monomials up to twice the order are summed instead, and
each matrix is put together from them.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.compiled import loops
from eos_ref.compiled.loops import Pairs
from eos_ref.compiled.vectors import add_to, columns_times, graded, mirrored, monomials, put, roots, row, vector, zero
from eos_ref.jit import cached, inline
from eos_ref.kernels import reproducing

_jit = cached(*loops.SOURCES, "compiled/corrections.py", "kernels/reproducing.py")


class Basis:
    """The basis of a reproducing kernel, read off `reproducing.basis`: which monomials, and with which factors.

    Attributes
    ----------
    factor_b : (b,) basis function b is ``factor_b[b]`` times a monomial
    place_b : (b,) which one, in the order of `eos_ref.compiled.vectors.graded`
    index_bb : (b, b) the monomial that is the product of two
    moments : int
        Number of monomials up to twice the order.
    """

    def __init__(self, order: int, dimension: int) -> None:
        coordinates: list[Any] = [_Monomial(1.0, (a,)) for a in range(dimension)]
        functions = reproducing.basis(order, coordinates)
        place = {axes: k for k, axes in enumerate(graded(dimension, 2 * order))}
        self.factor_b = np.array([f.factor for f in functions])
        self.place_b = np.array([place[f.axes] for f in functions])
        self.index_bb = np.array([[place[(f * g).axes] for g in functions] for f in functions])
        self.moments = len(place)


class _Monomial:
    """A number times a product of coordinates."""

    def __init__(self, factor: float, axes: tuple[int, ...]) -> None:
        self.factor, self.axes = factor, axes

    def __mul__(self, other: Any) -> _Monomial:
        if isinstance(other, _Monomial):
            return _Monomial(self.factor * other.factor, tuple(sorted(self.axes + other.axes)))
        return _Monomial(self.factor * other, self.axes)

    __rmul__ = __mul__

    def __radd__(self, number: float) -> _Monomial:
        assert self.factor == 0, "a basis function is one monomial"
        return _Monomial(number, ())


@_jit
def moments(pairs: Pairs, volume_n: Any, cut: float, like: Any, like_m: Any, out_nm: Any) -> None:
    """Add sum_j V_j W_ij times the monomials of x_ij/cut."""
    for i in range(volume_n.size):
        total = zero(like_m)
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, w = pairs.j_p[p], pairs.w_p[p]
            u = 1 / cut * row(pairs.x_pc, p, like)
            m = monomials(u, like_m)
            total = total + volume_n[j] * w * m
            add_to(out_nm, j, volume_n[i] * w * mirrored(m, u))
        add_to(out_nm, i, total)


@_jit
def coefficients(
    moment_nm: Any, index_bb: Any, place_b: Any, factor_b: Any, scale: float, corrected_n: Any, one: Any, out_nf: Any
) -> None:
    """Solve for columns 1 to d of the inverse moment matrices, as coefficients of monomials, into ``out_nf``.

    Particles without a factor are taken out of ``corrected_n``. Entry a, b of a matrix is factor_a factor_b times
    moment index_bb[a, b]; basis function b is factor_b times monomial place_b[b]. The matrices of as many particles as
    ``one`` has ones are taken together, one in each lane (l) of a register; lanes without a particle, or without a
    factor, hold numbers that are never read."""
    size, lanes = factor_b.size, len(one)
    d = out_nf.shape[1] // size
    moment_ml, lower_l = np.zeros((moment_nm.shape[1], lanes)), np.zeros((size * size, lanes))
    pivot_l, y_bl = np.zeros((size, lanes)), np.zeros((size, lanes))
    for first in range(0, corrected_n.size, lanes):
        together = min(lanes, corrected_n.size - first)
        for lane in range(together):
            for m in range(moment_nm.shape[1]):
                moment_ml[m, lane] = moment_nm[first + lane, m]
        for a in range(size):
            for b in range(a + 1):
                put(lower_l, a * size + b, factor_b[a] * factor_b[b] * row(moment_ml, index_bb[a, b], one))
        _factorise(lower_l, pivot_l, one)
        for lane in range(together):
            for a in range(size):
                corrected_n[first + lane] &= pivot_l[a, lane] > 0
        for axis in range(d):
            _solve_unit(lower_l, 1 + axis, y_bl, one)
            for lane in range(together):
                if corrected_n[first + lane]:
                    for b in range(size):
                        out_nf[first + lane, place_b[b] * d + axis] = scale * factor_b[b] * y_bl[b, lane]


@inline
def _factorise(lower_l: Any, pivot_l: Any, one: Any) -> None:
    """Put Cholesky's factor in place, row after row; none where the square of a pivot is not positive."""
    size = pivot_l.shape[0]
    for a in range(size):
        for b in range(a + 1):
            rest = row(lower_l, a * size + b, one)
            for k in range(b):
                rest = rest - row(lower_l, a * size + k, one) * row(lower_l, b * size + k, one)
            if a != b:
                rest = rest / row(lower_l, b * size + b, one)
            else:
                put(pivot_l, a, rest)
                rest = roots(rest)
            put(lower_l, a * size + b, rest)


@inline
def _solve_unit(lower_l: Any, unit: int, y_bl: Any, one: Any) -> None:
    """Solve for the unit vector of one row; its forward substitution begins at that row."""
    size = y_bl.shape[0]
    for a in range(size):
        rest = vector(one) if a == unit else zero(one)
        for k in range(unit, a):
            rest = rest - row(lower_l, a * size + k, one) * row(y_bl, k, one)
        put(y_bl, a, rest / row(lower_l, a * size + a, one))
    for a in range(size - 1, -1, -1):
        rest = row(y_bl, a, one)
        for k in range(a + 1, size):
            rest = rest - row(lower_l, k * size + a, one) * row(y_bl, k, one)
        put(y_bl, a, rest / row(lower_l, a * size + a, one))


@_jit
def corrected_gradients(
    pairs: Pairs,
    coefficient_nf: Any,
    corrected_n: Any,
    cut: float,
    like: Any,
    like_b: Any,
    like_f: Any,
    gi_pc: Any,
    gj_pc: Any,
) -> None:
    """Evaluate the corrected gradients of both sides of every pair; a side without coefficients has the plain one."""
    for i in range(corrected_n.size):
        c_i = row(coefficient_nf, i, like_f)
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, w = pairs.j_p[p], pairs.w_p[p]
            x = row(pairs.x_pc, p, like)
            u = 1 / cut * x
            m = monomials(u, like_b)
            g_i = pairs.slope_p[p] * x
            g_j = -1.0 * g_i
            if corrected_n[i]:
                g_i = w * columns_times(c_i, m)
            if corrected_n[j]:
                g_j = w * columns_times(row(coefficient_nf, j, like_f), mirrored(m, u))
            put(gi_pc, p, g_i)
            put(gj_pc, p, g_j)
