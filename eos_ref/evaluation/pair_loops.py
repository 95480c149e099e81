"""Distances of listed pairs, compiled: the same bits as in arrays, without an array for each operation."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.jit import cached
from eos_ref.model.parameters import IntArray

_PAIRS = "float64[:, ::1], int32[::1], int32[::1], float64[:, ::1]"


@cached(signature=f"int64({_PAIRS}, float64, int64[::1], int64[::1], int64[::1])")
def _near(x_nc: Any, i_p: Any, j_p: Any, shift_pc: Any, cut: float, near_i: Any, near_j: Any, near_p: Any) -> Any:
    count, one = 0, len(shift_pc) == 1
    for p in range(i_p.size):
        i, j, at = i_p[p], j_p[p], 0 if one else p
        rr = 0.0
        for a in range(x_nc.shape[1]):
            apart = x_nc[i, a] - (x_nc[j, a] + shift_pc[at, a])
            rr += apart * apart
        if math.sqrt(rr) < cut:
            near_i[count], near_j[count], near_p[count] = i, j, p
            count += 1
    return count


def near(
    x_nc: FloatArray, i_p: IntArray, j_p: IntArray, shift_pc: FloatArray, cut: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return those of some pairs with r < cut; of displacements there may be one row for all."""
    found = np.empty((3, len(i_p)), np.int64)
    count = _near(np.ascontiguousarray(x_nc), i_p, j_p, shift_pc, cut, *found)
    i, j, p = found[:, :count]
    return i, j, np.broadcast_to(shift_pc, (count, x_nc.shape[1])) if len(shift_pc) == 1 else shift_pc[p]
