"""Distances, kernel values and sums of listed pairs, compiled: the bits of arrays, without an array for each operation.

Once this module is imported `ArrayEvaluator` takes them, as `Rounded` does those of `rounded_loops`.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

import eos_ref.eos.compiled  # noqa: F401  teaches numba the elementary functions
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.jit import cached, inline
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model.parameters import IntArray

_NEAR = "int64(float64[:, ::1], {0}[::1], {0}[::1], float64[:, ::1], float64, int64[::1], int64[::1], float64[:, ::1])"
_READ = "Array(float64, 2, 'A', True)"
_INDICES = "int32", "int64"  # of pairs in blocks that are made again, and of all others


@cached(signature=[_NEAR.format(index) for index in _INDICES])
def _near(x_nc: Any, i_p: Any, j_p: Any, shift_pc: Any, cut: float, near_i: Any, near_j: Any, near_pc: Any) -> Any:
    count, one, flat = 0, len(shift_pc) == 1, x_nc.shape[1] == 2
    for p in range(i_p.size):
        i, j, at = i_p[p], j_p[p], 0 if one else p
        apart = x_nc[i, 0] - (x_nc[j, 0] + shift_pc[at, 0])
        rr = apart * apart
        apart = x_nc[i, 1] - (x_nc[j, 1] + shift_pc[at, 1])
        rr += apart * apart
        if not flat:
            apart = x_nc[i, 2] - (x_nc[j, 2] + shift_pc[at, 2])
            rr += apart * apart
        # No branch: a pair that is too far is overwritten by the next.
        near_i[count], near_j[count] = i, j
        if not one:
            for a in range(x_nc.shape[1]):
                near_pc[count, a] = shift_pc[p, a]
        count += math.sqrt(rr) < cut
    return count


def near(
    x_nc: FloatArray, i_p: IntArray, j_p: IntArray, shift_pc: FloatArray, cut: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return those of some pairs with r < cut; of displacements there may be one row for all."""
    near_2p, near_pc = np.empty((2, len(i_p)), np.int64), np.empty_like(shift_pc)
    count = _near(np.ascontiguousarray(x_nc), i_p, j_p, shift_pc, cut, *near_2p, near_pc)
    i, j = near_2p[:, :count]
    return i, j, np.broadcast_to(shift_pc, (count, x_nc.shape[1])) if len(shift_pc) == 1 else near_pc[:count]


_shape, _slope = inline(QUINTIC.shape), inline(QUINTIC.slope)


@cached(
    *("kernels/kernel.py", "kernels/quintic.py"),
    signature=[
        f"void({_READ}, {index}[:], {index}[:], {_READ}, float64, float64, {', '.join(['float64[:, ::1]'] * 3)})"
        for index in _INDICES
    ],
)
def _kernel_values(
    x_nc: Any, i_p: Any, j_p: Any, shift_pc: Any, h: float, sigma: float, x_cp: Any, gradw_cp: Any, values_kp: Any
) -> None:
    for a in range(len(x_cp)):
        for p in range(i_p.size):
            x_cp[a, p] = x_nc[i_p[p], a] - (x_nc[j_p[p], a] + shift_pc[p, a])
            values_kp[0, p] = x_cp[a, p] * x_cp[a, p] + (values_kp[0, p] if a else 0.0)
    for p in range(i_p.size):
        r = math.sqrt(values_kp[0, p])
        q = r / h
        values_kp[1, p], values_kp[2, p] = r, sigma * _shape(q)
        slope = sigma / h * _slope(q)
        for a in range(len(x_cp)):
            gradw_cp[a, p] = slope * x_cp[a, p] / r


def set_kernel_values(of: ArrayEvaluator, x_nc: FloatArray) -> bool:
    """See `ArrayEvaluator.kernel_values`; return whether there are loops for its kernel and numbers: doubles."""
    model = of.model
    if model.kernel is not QUINTIC or not isinstance(x_nc, np.ndarray) or x_nc.dtype != np.float64:
        return False
    x_cp, gradw_cp = np.empty((2, model.dimension, len(of.i)))
    values_kp = np.empty((3, len(of.i)))
    sigma = model.kernel.normalisation(model.dimension, model.cut)
    _kernel_values(x_nc, of.i, of.j, of.shift_pc, model.h, sigma, x_cp, gradw_cp, values_kp)
    of.x, of.gradw = list(x_cp), list(gradw_cp)
    of.rr, of.r, of.w = values_kp
    return True


@cached(
    signature=[f"void(Array({index}, 1, 'C', True), Array(float64, 1, 'C', True), float64[::1])" for index in _INDICES]
)
def _total(i_p: Any, term_p: Any, sum_n: Any) -> None:
    if i_p.size == 0:
        return
    i, total = i_p[0], 0.0  # in a register as long as the pairs are those of one particle
    for p in range(i_p.size):
        if i_p[p] != i:
            sum_n[i] = total
            i = i_p[p]
            total = sum_n[i]
        total += term_p[p]
    sum_n[i] = total


def total(i_p: IntArray, term_p: FloatArray, n: int) -> FloatArray:
    """Return the sums (n,) of the doubles with each row number, in their order."""
    sum_n = np.zeros(n)
    _total(i_p, np.ascontiguousarray(term_p), sum_n)
    return sum_n


ArrayEvaluator.loops = sys.modules[__name__]
