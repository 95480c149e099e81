"""Neighbour list of particles in a box: half of all pairs, with a skin, in an order that depends on nothing but them.

`eos_ref.evaluation.pairs` finds the pairs; this module arranges them. Particles get an internal order in which
neighbours lie close in memory; a row holds the partners j > i of a particle i in rising order, and of several images of
one partner in rising order of the image. A particle's own images stand once for both directions, as all pairs do.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.pairs import Search
from eos_ref.jit import cached, inline
from eos_ref.model.box import Box
from eos_ref.model.parameters import IntArray

WINDOW = 4096  # particles whose data fit the second-level cache
MOST_IMAGES = 2**13  # box lengths by which a position may lie outside
_jit = cached("compiled/neighbours.py")

VALID, REWRAPPED, INVALID = range(3)


class Neighbours:
    """Pairs of particles that may lie within a cutoff, valid until one has moved by half the skin.

    Parameters
    ----------
    box : Box
    cut, skin : float
        Pairs closer than their sum are listed.

    Attributes
    ----------
    order_n : (n,) internal order: row k is the caller's particle ``order_n[k]``; None: as the caller has them
    start_n : (n + 1,) where the rows begin
    j_p : (pairs,) uint32, internal index of the partner
    image_pc : (pairs, d) int16, box lengths to be added to the partner's position
    built : int
        How often the list was built.
    """

    def __init__(self, box: Box, cut: float, skin: float) -> None:
        self.box, self.reach, self.skin = box, cut + skin, skin
        self.edge_c = np.array([edge if p else np.inf for edge, p in zip(box.edge_c, box.periodic, strict=True)])
        self.order_n: IntArray | None = None
        self.start_n: IntArray = np.empty(0, np.int64)
        self.j_p: npt.NDArray[np.uint32] = np.empty(0, np.uint32)
        self.image_pc: npt.NDArray[np.int16] = np.empty((0, len(box.low_c)), np.int16)
        self.built = 0
        self._x_nc: FloatArray | None = None

    def holds(self, x_nc: FloatArray) -> bool:
        """Return whether the list holds all pairs of new positions (n, d), which may have been wrapped into the box."""
        if self._x_nc is None:
            return False
        moved_nc = np.empty(x_nc.shape, np.int16)
        state = _compare(x_nc, self._x_nc, self.edge_c, (self.skin / 2) ** 2, moved_nc)
        if state == REWRAPPED:
            order_n = np.arange(len(x_nc)) if self.order_n is None else self.order_n
            _follow(moved_nc, order_n, self.start_n, self.j_p, self.image_pc, self._x_nc, self.edge_c)
        return bool(state != INVALID)

    def build(self, x_nc: FloatArray) -> None:
        """List the pairs of positions (n, d), any periodic image of each.

        Raises
        ------
        InputError
            A position that is not finite, or thousands of box lengths outside.
        """
        low_c = np.array(self.box.low_c)
        image_nc = np.where(self.box.periodic, -np.floor((x_nc - low_c) / self.edge_c), 0.0)
        near_n = (np.isfinite(x_nc) & (np.abs(image_nc) < MOST_IMAGES)).all(axis=1)
        if not near_n.all():
            k = int(np.argmin(near_n))
            raise InputError("position", f"of particle {k + 1} must be finite, near the box", tuple(x_nc[k].tolist()))
        inside_nc = x_nc + image_nc * np.where(self.box.periodic, self.edge_c, 0.0)
        inside_nc -= np.where(self.box.periodic, low_c, inside_nc.min(axis=0, initial=np.inf))
        # Chosen once: sums would have other rounding errors in another order.
        if not self.built and not _coherent(inside_nc, self.edge_c, self.reach):
            self.order_n = _along_curve(inside_nc, self.reach)
        self._arrange(x_nc if self.order_n is None else x_nc[self.order_n])
        self._x_nc = x_nc.copy()
        self.built += 1

    def _arrange(self, x_nc: FloatArray) -> None:
        n, d = x_nc.shape
        self.j_p, self.image_pc = np.empty(0, np.uint32), np.empty((0, d), np.int16)  # freed before the new ones come
        one_p, other_p, image_pc = Search(x_nc, self.box, self.reach).half()
        self.start_n = np.empty(n + 1, np.int64)
        self.j_p, self.image_pc = np.empty(len(one_p), np.uint32), np.empty((len(one_p), d), np.int16)
        _sorted_rows(one_p, other_p, image_pc, self.start_n, self.j_p, self.image_pc)


def _coherent(points: FloatArray, extent: FloatArray, reach: float) -> bool:
    """Return whether consecutive particles mostly lie close to each other, as in a lattice or in LAMMPS' order."""
    step_nc = np.abs(np.diff(points, axis=0))
    step_nc = np.minimum(step_nc, np.abs(extent - step_nc))
    return len(points) <= WINDOW or bool((np.square(step_nc).sum(axis=1) < (2 * reach) ** 2).mean() > 0.9)


def _along_curve(points: FloatArray, size: float) -> IntArray:
    """Return an order of points by cells of a size, along Morton's curve: near in space is near in memory."""
    key_n = np.zeros(len(points), np.uint64)
    for a in range(points.shape[1]):
        cell_n = np.minimum(points[:, a] / size, 2.0**21 - 1).astype(np.uint64)
        for bit, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F)):
            cell_n = (cell_n | cell_n << np.uint64(bit)) & np.uint64(mask)
        for bit, mask in ((4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):
            cell_n = (cell_n | cell_n << np.uint64(bit)) & np.uint64(mask)
        key_n |= cell_n << np.uint64(a)
    return np.argsort(key_n, kind="stable")


@_jit
def _compare(x_nc: Any, old_nc: Any, edge_c: Any, limit: float, moved_nc: Any) -> int:
    """Return whether all are within a distance of where they were, perhaps in another image (to ``moved_nc``)."""
    state = VALID
    for i in range(x_nc.shape[0]):
        rr = 0.0
        for a in range(x_nc.shape[1]):
            step = x_nc[i, a] - old_nc[i, a]
            edges = np.rint(step / edge_c[a])
            if edges != 0:
                if not abs(edges) < MOST_IMAGES:
                    return INVALID
                state = REWRAPPED
                step -= edges * edge_c[a]
            moved_nc[i, a] = int(edges)
            rr += step * step
        if not rr <= limit:
            return INVALID
    return state


@_jit
def _follow(moved_nc: Any, order_n: Any, start_n: Any, j_p: Any, image_pc: Any, x_nc: Any, edge_c: Any) -> None:
    """Recount the images of particles that were wrapped into the box: x_i - (x_j + image) stays what it was."""
    for k in range(order_n.size):
        i = order_n[k]
        for a in range(edge_c.size):
            for p in range(start_n[k], start_n[k + 1]):
                image_pc[p, a] += moved_nc[i, a] - moved_nc[order_n[j_p[p]], a]
    for i in range(order_n.size):
        for a in range(edge_c.size):
            if moved_nc[i, a] != 0:
                x_nc[i, a] += moved_nc[i, a] * edge_c[a]


@_jit
def _sorted_rows(one_p: Any, other_p: Any, shift_pc: Any, start_n: Any, j_p: Any, image_pc: Any) -> None:
    """Turn every pair so that i < j, or its own image lies in the upper half space, and sort by i, j and image."""
    n, (pairs, d) = start_n.size - 1, shift_pc.shape
    place_n, start_n[:] = np.zeros(n + 1, np.int64), 0
    for p in range(pairs):
        start_n[min(one_p[p], other_p[p]) + 1] += 1
        place_n[max(one_p[p], other_p[p]) + 1] += 1
    for k in range(n):
        start_n[k + 1] += start_n[k]
        place_n[k + 1] += place_n[k]
    # By the second index first: each row is then filled in its order.
    by_j = np.empty(pairs, np.uint32)
    for p in range(pairs):
        high = max(one_p[p], other_p[p])
        by_j[place_n[high]] = p
        place_n[high] += 1
    place_n[:] = start_n
    image_c = np.empty(d, np.int16)
    for p in by_j:
        i, j = min(one_p[p], other_p[p]), max(one_p[p], other_p[p])
        sign = -1 if i != one_p[p] or (i == j and _points_down(shift_pc[p])) else 1
        for a in range(d):
            image_c[a] = sign * shift_pc[p, a]
        q = place_n[i]
        while q > start_n[i] and j_p[q - 1] == j and _before(image_c, image_pc, q - 1):
            j_p[q] = j_p[q - 1]
            for a in range(d):
                image_pc[q, a] = image_pc[q - 1, a]
            q -= 1
        j_p[q] = j
        for a in range(d):
            image_pc[q, a] = image_c[a]
        place_n[i] += 1


@inline
def _points_down(shift_c: Any) -> bool:
    for a in range(shift_c.size):
        if shift_c[a] != 0:
            return bool(shift_c[a] < 0)
    return False


@inline
def _before(image_c: Any, image_pc: Any, q: int) -> bool:
    for a in range(image_c.size):
        if image_c[a] != image_pc[q, a]:
            return bool(image_c[a] < image_pc[q, a])
    return False
