r"""Ways to find the pairs of particles closer than a cutoff.

A pair is two particles and the box lengths to be added to the second one's position; each is found once.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np

import eos_ref.jit  # noqa: F401  chooses the registers before anything is compiled
from eos_ref.compiled.neighbours import Neighbours
from eos_ref.eos.table import FloatArray
from eos_ref.model.box import Box

WIDER = 1 + 1e-9  # of the cutoff: cells, and lists that are filtered, must not lose a pair by a rounding error
_jit = numba.njit(error_model="numpy", cache=True, nogil=True)


class PairList(NamedTuple):
    """Pairs: indices (pairs,) of either particle, and box lengths (pairs, d) to be added to the second's position."""

    i_p: Any
    j_p: Any
    image_pc: Any


@dataclass(frozen=True)
class SearchMethod:
    """One way to search: a function of positions (n, d) inside a box, the box, and a cutoff."""

    name: str
    reason: str
    pairs: Callable[[FloatArray, Box, float], PairList]
    most: int = 10_000_000  # particles for which it ends within seconds


# --- the exact pairs


def truth(x_nc: FloatArray, box: Box, cut: float) -> PairList:
    """Return all pairs whose distance in exact arithmetic is below the cutoff, out of all n squared.

    Doubles decide, and fractions where rounding might change the answer.
    """
    edge_c = np.array(box.edge_c)
    reach_c = np.where(box.periodic, np.ceil(cut * WIDER / edge_c), 0).astype(int)
    doubt = 64 * np.finfo(float).eps * cut * float(np.abs(x_nc).max() + (edge_c * (reach_c + 1)).max())
    parts = []
    for image_c in itertools.product(*(range(-r, r + 1) for r in reach_c)):
        if image_c < (0,) * len(image_c):
            continue  # the opposite image gives the same pairs
        rr_nn = np.zeros((len(x_nc), len(x_nc)))
        for a, edge in enumerate(edge_c):
            rr_nn += np.square(x_nc[:, a, None] - x_nc[None, :, a] - image_c[a] * edge)
        i_p, j_p = np.nonzero(rr_nn < cut * cut + doubt)
        once_p = i_p < j_p if not any(image_c) else np.full(len(i_p), True)
        i_p, j_p = i_p[once_p], j_p[once_p]
        close_p = rr_nn[i_p, j_p] < cut * cut
        for p in np.flatnonzero(np.abs(rr_nn[i_p, j_p] - cut * cut) <= doubt):
            close_p[p] = _exactly_close(x_nc, box, cut, i_p[p], j_p[p], image_c)
        images_pc = np.tile(image_c, (int(close_p.sum()), 1))
        parts.append(PairList(i_p[close_p], j_p[close_p], images_pc))
    return PairList(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _exactly_close(x_nc: FloatArray, box: Box, cut: float, i: int, j: int, image_c: Any) -> bool:
    rr = Fraction(0)
    for a, edge in enumerate(box.edge_c):
        rr += (Fraction(x_nc[i, a]) - Fraction(x_nc[j, a]) - int(image_c[a]) * Fraction(edge)) ** 2
    return rr < Fraction(cut) ** 2


def keys(pairs: PairList) -> set[tuple[int, ...]]:
    """Return every pair as a tuple that does not depend on which particle came first."""
    unordered = set()
    for i, j, image in zip(pairs.i_p.tolist(), pairs.j_p.tolist(), pairs.image_pc.tolist(), strict=True):
        unordered.add(max((j, i, *(-a for a in image)), (i, j, *image)))
    return unordered


def wrong(pairs: PairList, true: PairList) -> int:
    """Count the pairs that are missed, invented or listed twice."""
    ours = keys(pairs)
    return len(ours ^ keys(true)) + len(pairs.i_p) - len(ours)


@_jit
def _filter(x_nc: Any, edge_c: Any, limit: Any, i_p: Any, j_p: Any, image_pc: Any, close_p: Any) -> None:
    for p in range(i_p.size):
        rr = 0.0
        for a in range(edge_c.size):
            step = x_nc[i_p[p], a] - (x_nc[j_p[p], a] + image_pc[p, a] * edge_c[a])
            rr += step * step
        close_p[p] = rr < limit


# --- cells


@_jit
def _walk(
    x_nc: Any, start_m: Any, of_k: Any, cells_c: Any, edge_c: Any, around_c: Any, offset_oc: Any, limit: Any, out: Any
) -> int:
    """Pair the particles of every cell with those of cells at some offsets, row after row, as long as there is room.

    Return the number of all pairs.
    """
    d, count = edge_c.size, 0
    image_oc, move_oc = np.empty(offset_oc.shape, np.int64), np.empty(offset_oc.shape, edge_c.dtype)
    other_o, cell_c = np.empty(offset_oc.shape[0], np.int64), np.empty(d, np.int64)
    for m in range(start_m.size - 1):
        rest = m
        for a in range(d - 1, -1, -1):
            cell_c[a] = rest % cells_c[a]
            rest //= cells_c[a]
        for o in range(other_o.size):
            other = 0
            for a in range(d):
                place = cell_c[a] + offset_oc[o, a]
                image_oc[o, a] = place // cells_c[a]
                move_oc[o, a] = image_oc[o, a] * edge_c[a]
                outside = other < 0 or (image_oc[o, a] != 0 and not around_c[a])
                other = -1 if outside else other * cells_c[a] + place - image_oc[o, a] * cells_c[a]
            other_o[o] = other
        for k in range(start_m[m], start_m[m + 1]):
            i = of_k[k]
            for o in range(other_o.size):
                if other_o[o] < 0:
                    continue
                for q in range(k + 1 if o == 0 else start_m[other_o[o]], start_m[other_o[o] + 1]):
                    j = of_k[q]
                    rr = limit - limit
                    for a in range(d):
                        step = x_nc[i, a] - (x_nc[j, a] + move_oc[o, a])
                        rr += step * step
                    if rr < limit:
                        if count < out[0].size:
                            out[0][count], out[1][count] = i, j
                            for a in range(d):
                                out[2][count, a] = image_oc[o, a]
                        count += 1
    return count


def cell_list(x_nc: Any, box: Box, cut: float, most_cells: int = 2**40) -> PairList:
    """Search cells no smaller than the cutoff, each with half of those around it, in the precision of the positions.

    A periodic edge shorter than the cutoff is one cell, which meets several images of itself.
    """
    n, d = x_nc.shape
    edge_c, periodic_c = np.array(box.edge_c), np.array(box.periodic)
    cells_c = np.clip(edge_c // (cut * WIDER), 1, most_cells).astype(np.int64)
    while np.prod(cells_c) > 2 * n + 8:  # a box that is mostly empty
        cells_c = np.maximum(cells_c // 2, 1)
    reach_c = np.ceil(cut * WIDER / (edge_c / cells_c)).astype(np.int64)
    place_nc = np.clip(((x_nc - np.array(box.low_c)) / edge_c * cells_c).astype(np.int64), 0, cells_c - 1)
    cell_n = np.ravel_multi_index(tuple(place_nc.T), tuple(cells_c))
    of_k = np.argsort(cell_n, kind="stable")
    start_m = np.concatenate([[0], np.cumsum(np.bincount(cell_n, minlength=int(np.prod(cells_c))))])
    axes = np.meshgrid(*(np.arange(-r, r + 1) for r in reach_c), indexing="ij")
    offset_oc = np.stack([axis.ravel() for axis in axes], axis=1)
    offset_oc = offset_oc[len(offset_oc) // 2 :]  # itself, and of two opposite offsets one
    kind = x_nc.dtype.type
    edges, limit = edge_c.astype(kind), kind(cut) ** 2
    room = int(2.2 * n * n * cut**d / np.prod(edge_c)) + 64  # half the pairs of an even density, and some more
    while True:
        out = np.empty(room, np.int64), np.empty(room, np.int64), np.empty((room, d), np.int64)
        count = _walk(x_nc, start_m, of_k, cells_c, edges, periodic_c, offset_oc, limit, out)
        if count <= room:
            return PairList(*(part[:count] for part in out))
        room = count


# --- libraries


def _reference(x_nc: FloatArray, box: Box, cut: float) -> PairList:
    near = Neighbours(box, cut, 0.0)
    near.build(x_nc)
    order_n = np.arange(len(x_nc)) if near.order_n is None else near.order_n
    i_p = np.repeat(order_n, np.diff(near.start_n))
    j_p, close_p = order_n[near.j_p], np.empty(len(i_p), bool)
    _filter(x_nc, np.array(box.edge_c), cut * cut, i_p, j_p, near.image_pc, close_p)
    return PairList(i_p[close_p], j_p[close_p], near.image_pc[close_p])


def _vesin(x_nc: FloatArray, box: Box, cut: float) -> PairList:
    import vesin

    n, d = x_nc.shape
    points, extent = np.zeros((n, 3)), np.full(3, 1.0)
    points[:, :d] = x_nc - np.array(box.low_c)
    extent[:d] = box.edge_c
    periodic = [*box.periodic, *[False] * (3 - d)]
    finder = vesin.NeighborList(cutoff=cut, full_list=False, n_threads=1)
    pair_p, shift_p = finder.compute(points, np.diag(extent), periodic, "PS")
    pair_p = pair_p.astype(np.int64)
    return PairList(pair_p[:, 0], pair_p[:, 1], shift_p[:, :d])


def _tree(x_nc: FloatArray, box: Box, cut: float) -> PairList:
    """Search scipy's own periodic box, which knows the nearest image alone."""
    from scipy.spatial import cKDTree

    edge_c, low_c = np.array(box.edge_c), np.array(box.low_c)
    size_c = np.where(box.periodic, edge_c, 0.0)
    points = np.where(box.periodic, np.mod(x_nc - low_c, edge_c), x_nc)
    points = np.where(np.array(box.periodic) & (points >= edge_c), 0.0, points)  # mod may round up to the edge
    pair_p = cKDTree(points, boxsize=size_c).query_pairs(cut, output_type="ndarray")
    image_pc = np.where(box.periodic, np.rint((x_nc[pair_p[:, 0]] - x_nc[pair_p[:, 1]]) / edge_c), 0.0)
    return PairList(pair_p[:, 0], pair_p[:, 1], image_pc.astype(np.int64))


def _tree_of_images(x_nc: FloatArray, box: Box, cut: float) -> PairList:
    """Search copies of the particles beyond periodic faces, as LAMMPS does; any box, any number of images."""
    from scipy.spatial import cKDTree

    n, d = x_nc.shape
    of_g, image_gc, x_gc = np.arange(n), np.zeros((n, d), np.int64), x_nc
    for a in range(d):
        if not box.periodic[a]:
            continue
        edge, low, high = box.edge_c[a], box.low_c[a], box.high_c[a]
        parts = [(of_g, image_gc, x_gc)]
        for k in range(1, math.ceil(cut * WIDER / edge) + 1):
            for image in (k, -k):
                moved_g = x_gc[:, a] + image * edge
                near_g = (moved_g < high + cut * WIDER) & (moved_g >= low - cut * WIDER)
                images, copies = image_gc[near_g].copy(), x_gc[near_g].copy()
                images[:, a], copies[:, a] = image, moved_g[near_g]
                parts.append((of_g[near_g], images, copies))
        of_g, image_gc, x_gc = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    pair_p = cKDTree(x_gc).query_pairs(cut, output_type="ndarray")
    pair_p = pair_p[pair_p[:, 0] < n]  # the first of a pair is the lower index: a particle of the box
    i_p, image_pc = pair_p[:, 0], image_gc[pair_p[:, 1]]
    j_p = of_g[pair_p[:, 1]]
    # A particle meets the other's copy, and the other its copy: one of both is kept.
    first = np.argmax(image_pc != 0, axis=1)
    upward_p = np.take_along_axis(image_pc, first[:, None], 1)[:, 0] >= 0
    return PairList(i_p[upward_p], j_p[upward_p], image_pc[upward_p])


METHODS: tuple[SearchMethod, ...] = (
    SearchMethod(
        "tree, rows", "as the reference: scipy's tree with a wider cutoff, rows sorted, distances filtered", _reference
    ),
    SearchMethod("vesin", "the list that the library vesin returns", _vesin),
    SearchMethod("cell list", "cells as wide as the cutoff, compiled", cell_list),
    SearchMethod(
        "cell list, float32",
        "the same, positions in single precision",
        lambda x_nc, box, cut: cell_list(x_nc.astype(np.float32), box, cut),
    ),
    SearchMethod("cKDTree", "scipy's tree of a periodic box, nearest images", _tree),
    SearchMethod("cKDTree, images", "scipy's tree, with copies of particles across periodic faces", _tree_of_images),
    SearchMethod(
        "brute force", "the distances of all pairs; nothing to build", partial(cell_list, most_cells=1), most=2_000
    ),
)
