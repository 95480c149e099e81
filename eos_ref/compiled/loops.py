"""Compiled sums over pairs: the formulas of `eos_ref.model`, each pair taken once.

A pair adds to a sum of particle i, kept in registers, and to the row of its partner j in memory. A dimension, or the
number of fields, is the length of a tuple (`eos_ref.compiled.vectors`), so that every loop is compiled once for 2D
and once for 3D. All arrays are in the internal order of `eos_ref.compiled.neighbours`. `eos_ref.compiled.corrections`
holds the sums of reproducing kernels, `eos_ref.compiled.forces` those of pair_style rheo.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

import eos_ref.eos.compiled  # noqa: F401  for the compiled forms of `eos_ref.numbers.elementary`, which it registers
from eos_ref.compiled.vectors import add_to, dot, outer, put, row, vector, zero
from eos_ref.jit import cached, inline
from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model import interactions

BLOCK = 64  # rows whose pairs stay in the first-level cache between the two passes of `geometry`
SOURCES = (
    "compiled/registers.py",
    "compiled/vectors.py",
    "compiled/loops.py",
    "kernels/kernel.py",
    "kernels/quintic.py",
    "model/interactions.py",
)
_jit = cached(*SOURCES)

register_jitable(interactions.interface_distance)  # which the next one calls by its name
_no_slip_ratio, _shift_weight = inline(interactions.no_slip_ratio), inline(interactions.shift_weight)


class Pairs(NamedTuple):
    """Pairs closer than the cutoff, row after row: displacement, W, W'/r; corrected gradients or None.

    ``gi_pc`` is the gradient that particle i uses, ``gj_pc`` that of j for the same pair.
    """

    start_n: Any
    j_p: Any
    x_pc: Any
    w_p: Any
    slope_p: Any
    gi_pc: Any
    gj_pc: Any


def _values(kernel: Kernel) -> Any:
    """Return the loop that turns squared distances into W, and ``slope_p`` into W'/r."""
    shape, slope = inline(kernel.shape), inline(kernel.slope)

    def values(w_p: Any, slope_p: Any, h: float, sigma: float) -> None:
        for p in range(w_p.size):
            r = math.sqrt(w_p[p])
            q = r / h
            w_p[p] = sigma * shape(q)
            slope_p[p] = sigma / h * slope(q) / r

    return inline(values)


def _geometry(kernel: Kernel) -> Callable[..., None]:
    values = _values(kernel)

    def geometry(
        near: Pairs, x_nc: Any, j_p: Any, image_pc: Any, edge: Any, reach: float, h: float, sigma: float, count_n: Any
    ) -> None:
        start_n = near.start_n
        k = start_n[0]  # unsigned: a signed number might count from the end
        for first in range(0, count_n.size, BLOCK):
            begin = k
            for i in range(first, min(first + BLOCK, count_n.size)):
                first_of_row, first_listed, end = k, start_n[i], start_n[i + 1]
                start_n[i] = k
                x_i = row(x_nc, i, edge)
                for p in range(first_listed, end):
                    j = j_p[p]
                    x = x_i - (row(x_nc, j, edge) + row(image_pc, p, edge) * vector(edge))
                    rr = dot(x, x)
                    # No branch: a pair that is too far is overwritten by the next.
                    near.j_p[k] = j
                    put(near.x_pc, k, x)
                    near.w_p[k] = rr
                    close = np.uint64(rr < reach)
                    count_n[j] += close
                    k += close
                count_n[i] += k - first_of_row
            values(near.w_p[begin:k], near.slope_p[begin:k], h, sigma)
        start_n[count_n.size] = k

    return geometry


_geometry_of_quintic = inline(_geometry(QUINTIC))


@_jit
def quintic_geometry(
    near: Pairs, x_nc: Any, j_p: Any, image_pc: Any, edge: Any, reach: float, h: float, sigma: float, count_n: Any
) -> None:
    """Keep the pairs of a list with their values of the quintic spline; see `geometry`."""
    _geometry_of_quintic(near, x_nc, j_p, image_pc, edge, reach, h, sigma, count_n)


@cache
def geometry(kernel: Kernel) -> Any:
    """Return the loop that keeps in ``near`` the pairs of a list with r*r < reach, with their values of a kernel.

    It adds to the count of neighbours as well. ``near.start_n`` holds where the rows of the list begin, and afterwards
    those of the pairs kept. Each kernel has a loop of its own, in which it is inlined. That of the quintic spline is
    kept on disk; another one is compiled once in a process.
    """
    return quintic_geometry if kernel is QUINTIC else numba.njit(error_model="numpy", nogil=True)(_geometry(kernel))


@inline
def both_gradients(pairs: Pairs, p: int, like: Any) -> Any:
    """Return the gradient that i uses, and that of j with its sign turned: what the one gains by it the other loses."""
    return _choose_gradients(pairs.slope_p, pairs.x_pc, pairs.gi_pc, pairs.gj_pc, p, like)


@inline
def _choose_gradients(slope_p: Any, x_pc: Any, gi_pc: Any, gj_pc: Any, p: int, like: Any) -> Any:
    if gi_pc is None:  # decided when compiled, as it is an argument
        g = slope_p[p] * row(x_pc, p, like)
        return g, g
    return row(gi_pc, p, like), -1.0 * row(gj_pc, p, like)


@_jit
def kernel_sum(pairs: Pairs, weight_n: Any, out_n: Any) -> None:
    """Add sum_j weight_j W_ij."""
    for i in range(out_n.size):
        total = 0.0
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, w = pairs.j_p[p], pairs.w_p[p]
            total += weight_n[j] * w
            out_n[j] += weight_n[i] * w
        out_n[i] += total


# --- walls


@_jit
def wall_sums(
    pairs: Pairs, solid_n: Any, pressure_n: Any, rho_n: Any, a_nc: Any, like: Any, all_n: Any, same_n: Any, wall_nf: Any
) -> None:
    """Add sums of W over all neighbours and those of the same phase; over a solid's fluid: W, W [P + rho (g - a).x]."""
    for i in range(solid_n.size):
        total, same = 0.0, 0.0
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, w = pairs.j_p[p], pairs.w_p[p]
            total += w
            all_n[j] += w
            if solid_n[i] == solid_n[j]:
                same += w
                same_n[j] += w
            else:
                s, f = (i, np.int64(j)) if solid_n[i] else (np.int64(j), i)
                # (g_f - a_s).x_sf is the same product with both factors' signs turned if i is the fluid.
                reach = dot(row(a_nc, j, like) - row(a_nc, i, like), row(pairs.x_pc, p, like))
                wall_nf[s, 0] += w
                wall_nf[s, 1] += w * (pressure_n[f] + rho_n[f] * reach)
        all_n[i] += total
        same_n[i] += same


# --- gradients


@_jit
def gradients(
    pairs: Pairs,
    volume_n: Any,
    field_nf: Any,
    rest_volume_n: Any,
    rest_field_nf: Any,
    solid_n: Any,
    chi_n: Any,
    cut: float,
    slips: Any,
    like: Any,
    out_nf: Any,
) -> None:
    """Add sum_j V_j (f_j - f_i) grad W_ij of several fields; ``slips`` is 1 for components of velocity, else 0.

    ``chi_n`` is None without interface/reconstruct. Two solids have the volumes and fields named ``rest``.
    """
    for i in range(volume_n.size):
        f_i = row(field_nf, i, slips)
        total = outer(zero(slips), zero(like))
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j = pairs.j_p[p]
            g_i, g_j = both_gradients(pairs, p, like)
            volume_i, volume_j = volume_n[i], volume_n[j]
            difference = row(field_nf, j, slips) - f_i
            if chi_n is not None:
                if solid_n[i] & solid_n[j]:
                    volume_i, volume_j = rest_volume_n[i], rest_volume_n[j]
                    difference = row(rest_field_nf, j, slips) - row(rest_field_nf, i, slips)
                elif solid_n[i] | solid_n[j]:
                    extra = slip(chi_n[i], chi_n[j], solid_n[i], cut) * vector(slips)
                    difference = difference + extra * difference
            total = total + volume_j * outer(difference, g_i)
            add_to(out_nf, j, volume_i * outer(difference, g_j))
        add_to(out_nf, i, total)


@inline
def slip(chi_i: float, chi_j: float, solid_i: bool, cut: float) -> float:
    return _no_slip_ratio(chi_i, chi_j, cut) if solid_i else _no_slip_ratio(chi_j, chi_i, cut)  # type: ignore[no-any-return]


# --- shifting, surfaces


@_jit
def shift_sums(pairs: Pairs, volume_n: Any, w_h: float, like: Any, out_nc: Any) -> None:
    """Add sum_j V_j [1 + (W/W(h))^4/5] grad W."""
    for i in range(volume_n.size):
        total = zero(like)
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j = pairs.j_p[p]
            g = _shift_weight(pairs.w_p[p], w_h) * pairs.slope_p[p] * row(pairs.x_pc, p, like)
            total = total + volume_n[j] * g
            add_to(out_nc, j, -volume_n[i] * g)
        add_to(out_nc, i, total)


@_jit
def color_sums(
    pairs: Pairs, volume_n: Any, type_n: Any, distance: bool, like: Any, gradient_nc: Any, color_n: Any, same_n: Any
) -> None:
    """Add sum_j V_j grad W and sum_j V_j W over other types, sum_j W (sum_j r W with ``distance``) over the same."""
    for i in range(volume_n.size):
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, w = pairs.j_p[p], pairs.w_p[p]
            if type_n[i] == type_n[j]:
                if distance:
                    x = row(pairs.x_pc, p, like)
                    w *= math.sqrt(dot(x, x))
                same_n[i] += w
                same_n[j] += w
            else:
                g = pairs.slope_p[p] * row(pairs.x_pc, p, like)
                color_n[i] += volume_n[j] * w
                color_n[j] += volume_n[i] * w
                add_to(gradient_nc, i, volume_n[j] * g)
                add_to(gradient_nc, j, -volume_n[i] * g)


@_jit
def surface_sums(
    pairs: Pairs, volume_n: Any, rest_volume_n: Any, solid_n: Any, like: Any, gradient_nc: Any, divr_n: Any
) -> None:
    """Add sum_j V_j grad W and -sum_j V_j x.grad W; a solid has its volume named ``rest`` for a solid."""
    for i in range(volume_n.size):
        total, divr = zero(like), 0.0
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j = pairs.j_p[p]
            x = row(pairs.x_pc, p, like)
            g = pairs.slope_p[p] * x
            xg = dot(x, g)
            volume_i, volume_j = volume_n[i], volume_n[j]
            if solid_n[i] & solid_n[j]:
                volume_i, volume_j = rest_volume_n[i], rest_volume_n[j]
            total = total + volume_j * g
            add_to(gradient_nc, j, -volume_i * g)
            divr -= volume_j * xg
            divr_n[j] -= volume_i * xg
        add_to(gradient_nc, i, total)
        divr_n[i] += divr


@_jit
def nearest(pairs: Pairs, target_n: Any, like: Any, out_n: Any) -> None:
    """Lower ``out_n`` to the distance of the nearest neighbour that is a target."""
    for i in range(target_n.size):
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j = pairs.j_p[p]
            if target_n[i] | target_n[j]:
                x = row(pairs.x_pc, p, like)
                r = math.sqrt(dot(x, x))
                if target_n[j]:
                    out_n[i] = min(out_n[i], r)
                if target_n[i]:
                    out_n[j] = min(out_n[j], r)
