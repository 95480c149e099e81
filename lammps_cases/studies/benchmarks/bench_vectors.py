"""Vectors in registers (`eos_ref.compiled.vectors`) against the same sums written out component by component.

``python -m lammps_cases.studies.benchmarks.bench_vectors`` prints the ratio of their times, measured in turns.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numba
import numpy as np
from scipy.spatial import cKDTree

from eos_ref.compiled import corrections, loops
from eos_ref.compiled.loops import Pairs
from lammps_cases.studies.benchmarks.bench import Ratio, against

EDGE = {2: 150, 3: 28}  # particles along an edge
CUT = 3.0  # spacings
_plain = numba.njit(error_model="numpy", nogil=True)


@_plain
def _gradients_2d(pairs: Pairs, volume_n: Any, v_nc: Any, out_nf: Any) -> None:
    for i in range(volume_n.size):
        xx = xy = yx = yy = 0.0
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, slope = pairs.j_p[p], pairs.slope_p[p]
            g_x, g_y = slope * pairs.x_pc[p, 0], slope * pairs.x_pc[p, 1]
            u, v = v_nc[j, 0] - v_nc[i, 0], v_nc[j, 1] - v_nc[i, 1]
            volume_i, volume_j = volume_n[i], volume_n[j]
            xx += volume_j * (u * g_x)
            xy += volume_j * (u * g_y)
            yx += volume_j * (v * g_x)
            yy += volume_j * (v * g_y)
            out_nf[j, 0] += volume_i * (u * g_x)
            out_nf[j, 1] += volume_i * (u * g_y)
            out_nf[j, 2] += volume_i * (v * g_x)
            out_nf[j, 3] += volume_i * (v * g_y)
        out_nf[i, 0] += xx
        out_nf[i, 1] += xy
        out_nf[i, 2] += yx
        out_nf[i, 3] += yy


@_plain
def _gradients_3d(pairs: Pairs, volume_n: Any, v_nc: Any, out_nf: Any) -> None:
    for i in range(volume_n.size):
        xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, slope = pairs.j_p[p], pairs.slope_p[p]
            g_x, g_y, g_z = slope * pairs.x_pc[p, 0], slope * pairs.x_pc[p, 1], slope * pairs.x_pc[p, 2]
            u, v, w = v_nc[j, 0] - v_nc[i, 0], v_nc[j, 1] - v_nc[i, 1], v_nc[j, 2] - v_nc[i, 2]
            volume_i, volume_j = volume_n[i], volume_n[j]
            xx += volume_j * (u * g_x)
            xy += volume_j * (u * g_y)
            xz += volume_j * (u * g_z)
            yx += volume_j * (v * g_x)
            yy += volume_j * (v * g_y)
            yz += volume_j * (v * g_z)
            zx += volume_j * (w * g_x)
            zy += volume_j * (w * g_y)
            zz += volume_j * (w * g_z)
            out_nf[j, 0] += volume_i * (u * g_x)
            out_nf[j, 1] += volume_i * (u * g_y)
            out_nf[j, 2] += volume_i * (u * g_z)
            out_nf[j, 3] += volume_i * (v * g_x)
            out_nf[j, 4] += volume_i * (v * g_y)
            out_nf[j, 5] += volume_i * (v * g_z)
            out_nf[j, 6] += volume_i * (w * g_x)
            out_nf[j, 7] += volume_i * (w * g_y)
            out_nf[j, 8] += volume_i * (w * g_z)
        for k, total in enumerate((xx, xy, xz, yx, yy, yz, zx, zy, zz)):
            out_nf[i, k] += total


@_plain
def _moments_2d(pairs: Pairs, volume_n: Any, cut: float, out_nm: Any) -> None:
    """Moments of RK1: monomials up to degree 2."""
    for i in range(volume_n.size):
        one = x = y = xx = xy = yy = 0.0
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j, w = pairs.j_p[p], pairs.w_p[p]
            a, b = 1 / cut * pairs.x_pc[p, 0], 1 / cut * pairs.x_pc[p, 1]
            weight_i, weight_j = volume_n[i] * w, volume_n[j] * w
            one += weight_j
            x += weight_j * a
            y += weight_j * b
            xx += weight_j * (a * a)
            xy += weight_j * (a * b)
            yy += weight_j * (b * b)
            out_nm[j, 0] += weight_i
            out_nm[j, 1] -= weight_i * a
            out_nm[j, 2] -= weight_i * b
            out_nm[j, 3] += weight_i * (a * a)
            out_nm[j, 4] += weight_i * (a * b)
            out_nm[j, 5] += weight_i * (b * b)
        for k, total in enumerate((one, x, y, xx, xy, yy)):
            out_nm[i, k] += total


def pairs_of(dimension: int, edge: int) -> tuple[Pairs, int]:
    """Return the pairs of a disordered lattice, each once, row after row, with some numbers as W and W'/r."""
    random = np.random.default_rng(1)
    x_nc = np.stack(np.meshgrid(*[np.arange(float(edge))] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    x_nc += random.uniform(-0.1, 0.1, x_nc.shape)
    i_p, j_p = cKDTree(x_nc).query_pairs(CUT, output_type="ndarray").T
    order = np.lexsort((j_p, i_p))
    i_p, j_p = i_p[order], j_p[order]
    start_n = np.searchsorted(i_p, np.arange(len(x_nc) + 1))
    w_p, slope_p = random.uniform(0.0, 1.0, (2, len(i_p)))
    # Unsigned, as in the reference: a signed index might count from the end, which costs plain loops a branch.
    start_n, j_p = start_n.astype(np.uint64), j_p.astype(np.uint32)
    return Pairs(start_n, j_p, x_nc[i_p] - x_nc[j_p], w_p, slope_p, None, None), len(x_nc)


Sum = Callable[[np.ndarray[Any, Any]], object]


def sums(dimension: int, edge: int) -> Iterator[tuple[str, Sum, Sum, int]]:
    """Yield name, both ways to add a sum to an array, and the number of its columns."""
    pairs, n = pairs_of(dimension, edge)
    random = np.random.default_rng(2)
    volume_n, v_nc, like = random.uniform(0.9, 1.1, n), random.normal(size=(n, dimension)), (0.0,) * dimension
    ones = (1.0,) * dimension

    def by_vectors(out_nf: Any) -> None:
        loops.gradients(pairs, volume_n, v_nc, None, None, None, None, CUT, ones, like, out_nf)

    plain = _gradients_2d if dimension == 2 else _gradients_3d
    yield f"gradient of v, {dimension}D", by_vectors, partial(plain, pairs, volume_n, v_nc), dimension**2
    if dimension == 2:
        given = pairs, volume_n, CUT
        of_vectors = partial(corrections.moments, *given, like, (0.0,) * 6)
        yield "moments of RK1, 2D", of_vectors, partial(_moments_2d, *given), 6


def ratios(edges: dict[int, int], repeats: int) -> Iterator[Ratio]:
    """Measure every sum both ways; ``ratio`` is the time of vectors over that of plain components."""
    for dimension, edge in edges.items():
        for name, ours, plain, columns in sums(dimension, edge):
            out_nf = np.zeros((edge**dimension, columns))
            per = edge**dimension
            yield against(name, "plain components", partial(ours, out_nf), partial(plain, out_nf), repeats, per)


if __name__ == "__main__":
    for one in ratios(EDGE, 25):
        print(
            f"{one.scene:20} {one.ours_ns.median:6.0f} ns, plain {one.peer_ns.median:6.0f} ns a particle: "
            f"ratio {one.ratio.median:.2f} ({one.ratio.low:.2f} to {one.ratio.high:.2f})"
        )
