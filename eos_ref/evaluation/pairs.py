"""Pairs of particles in a box, found by a tree: any box, however large, tilted or shorter than the cutoff.

A cell list asks for cells in all the space between particles; a tree only follows the particles. Copies of those near
periodic faces stand beyond the opposite faces, so that the tree needs to know nothing of the box.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import IntArray
from eos_ref.numbers.rounded import ROUNDING, Rounded, error, value

ROWS = 4096  # particles whose pairs are found at a time: what these take stays in the cache
ROOM = 1 + 1e-9  # of the reach: what rounding moves must not lose a pair
SKIN = 0.1  # of the cutoff, by which candidates may lie farther
SHARED = 8  # candidates that are kept for other evaluators


class Search:
    """Positions (n, d), any image of each, among which pairs closer than a reach can be found.

    Raises
    ------
    InputError
        Particles so far outside a periodic box that rounding moves them by more than an edge.
    """

    def __init__(self, x_nc: FloatArray, box: Box, reach: float) -> None:
        from scipy.spatial import cKDTree

        self.x_nc, self.box, self.make = x_nc, box, cKDTree
        self.outside_nc = box.images(x_nc)
        self.inside_nc = x_nc - box.shift(self.outside_nc)
        around_c = np.array(box.periodic)
        places = float(np.abs(x_nc[:, around_c]).max(initial=0.0) + np.abs(box.cell_cc).sum())
        if around_c.any() and EPS * places > np.array(box.edge_c)[around_c].min():  # all edges on the way are searched
            rule = "must be known to less than an edge of the box; the time step may be too long"
            raise InputError("positions", rule, f"{places:g} away")
        self.wide = reach * ROOM + 8 * EPS * places
        self.of_g, self.image_gc = _copies(self.inside_nc, box, self.wide)

    def half(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return every pair and image once, some a little farther: i, j (p,), edges to be added to j's place (p, d).

        A box shorter than two reaches gives every image of its own, a particle's own images among them.
        """
        tree, up_g = self.make(self.inside_nc), _points_up(self.image_gc)
        pair_p = tree.query_pairs(self.wide, output_type="ndarray")
        of_g, image_gc = self.of_g[up_g], self.image_gc[up_g]
        copies = self.make(self.inside_nc[of_g] + self.box.shift(image_gc))
        beyond = tree.sparse_distance_matrix(copies, self.wide, output_type="ndarray")
        i, j = (np.concatenate([a, b]) for a, b in ((pair_p[:, 0], beyond["i"]), (pair_p[:, 1], of_g[beyond["j"]])))
        outside_nc = self.outside_nc.astype(np.int32)
        image_pc = outside_nc[i]
        image_pc -= outside_nc[j]
        image_pc[len(pair_p) :] += image_gc[beyond["j"]].astype(np.int32)
        return i, j, image_pc

    def rows(self, first: int, last: int, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs with r < cut that some particles collect; see `directed_pairs`."""
        own = self.make(self.inside_nc[first:last])
        distances = own.sparse_distance_matrix(self._tree, self.wide, output_type="ndarray")
        i, g = distances["i"] + first, distances["j"]
        j = self.of_g[g]
        image_pc = self.image_gc[g] + (self.outside_nc[i] - self.outside_nc[j])
        shift_pc = self.box.shift(image_pc)
        x_nc = self.x_nc
        r = separations(x_nc, i, j, shift_pc)
        near = (r < cut) & (i != g)  # the first n copies are the particles themselves
        i, j, shift_pc = i[near], j[near], shift_pc[near]
        order = _order(i - first, j, image_pc[near].astype(np.int64))
        return i[order], j[order], shift_pc[order]

    @cached_property
    def _tree(self) -> Any:
        return self.make(self.inside_nc[self.of_g] + self.box.shift(self.image_gc))


def separations(x_nc: FloatArray, i_p: IntArray, j_p: IntArray, shift_pc: FloatArray) -> FloatArray:
    """Return the distances of pairs from i to the images of j, (p,): axis by axis, which takes half of the memory."""
    rr = np.zeros(len(i_p))
    for x_n, shift_p in zip(x_nc.T, shift_pc.T, strict=True):
        x_n = np.ascontiguousarray(x_n)
        rr += (x_n[i_p] - (x_n[j_p] + shift_p)) ** 2
    return np.sqrt(rr)


def apart(x_n: Any, i_p: IntArray, j_p: IntArray, shift_p: FloatArray) -> Any:
    """Return the distances along an axis from j, or its image, to i, (p,); of equal coordinates 0 without error.

    The other side may take the image of i instead, whose place rounds by its own size: that of the box.
    """
    apart_p = x_n[i_p] - (x_n[j_p] + shift_p)
    if not isinstance(apart_p, Rounded):
        return apart_p
    image_p = np.where(shift_p != 0, ROUNDING * np.abs(value(x_n)[i_p] - shift_p), 0.0)
    apart_p.error = apart_p.error + image_p
    same = (value(apart_p) == 0) & (error(x_n)[i_p] == 0) & (error(x_n)[j_p] == 0) & (shift_p == 0)
    return Rounded(apart_p.value, np.where(same, 0.0, apart_p.error))


def _copies(x_nc: FloatArray, box: Box, wide: float) -> tuple[IntArray, FloatArray]:
    """Return the particles, and copies of them beyond the faces: of whom (g,), and edges moved by (g, d)."""
    d = x_nc.shape[1]
    of_g, image_gc = np.arange(len(x_nc)), np.zeros((len(x_nc), d))
    fraction_gc = box.upright(x_nc - np.array(box.low_c)) / box.edge_c
    # Distances between opposite faces: the edges leave one of them at an angle.
    room_c = wide * np.sqrt(np.square(np.linalg.inv(box.cell_cc)).sum(axis=0))
    for a in (a for a in range(d) if box.periodic[a]):
        most = math.ceil(room_c[a])
        parts = []
        for k in range(-most, most + 1):
            moved_g = fraction_gc[:, a] + k
            near_g = (moved_g >= -room_c[a]) & (moved_g <= 1 + room_c[a])
            image_gc[:, a], moved_gc = k, fraction_gc.copy()
            moved_gc[:, a] = moved_g
            parts.append((of_g[near_g], image_gc[near_g], moved_gc[near_g]))
        of_g, image_gc, fraction_gc = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    first = np.argsort(image_gc.any(axis=1), kind="stable")
    return of_g[first], image_gc[first]


def _points_up(image_gc: FloatArray) -> BoolArray:
    """Return which images lie in the upper half space: of two opposite ones, one."""
    up_g = np.zeros(len(image_gc), bool)
    for a in reversed(range(image_gc.shape[1])):
        up_g = (image_gc[:, a] > 0) | ((image_gc[:, a] == 0) & up_g)
    return up_g


def directed_pairs(x_nc: FloatArray, box: Box, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all ordered pairs and images with r < cut: indices i, j (p,) and displacements of j's image (p, d).

    Each pair stands twice, once for each particle that collects.
    """
    search, n = Search(x_nc, box, cut), len(x_nc)
    rows = [search.rows(first, min(first + ROWS, n), cut) for first in range(0, max(n, 1), ROWS)]
    return rows[0] if len(rows) == 1 else tuple(map(np.concatenate, zip(*rows, strict=True)))  # type: ignore[return-value]


class Candidates:
    """Pairs somewhat farther than a cutoff, which hold those within it until particles have moved as far (Verlet).

    An evaluator asks twice at every step, once for those that rounding may put within the cutoff.
    """

    def __init__(self, x_nc: FloatArray, box: Box, cut: float) -> None:
        self.x_nc, self.box = x_nc.copy(), box
        reach = (1 + SKIN) * cut
        self.i, self.j, self.shift_pc = directed_pairs(x_nc, box, reach)
        self.room = reach / ROOM - 8 * EPS * float(np.abs(x_nc).max(initial=0.0) + np.abs(box.cell_cc).sum())

    def hold(self, x_nc: FloatArray, box: Box, cut: float) -> bool:
        """Return whether the pairs within a cutoff are among them."""
        if self.x_nc.shape != x_nc.shape or self.box != box:
            return False
        moved = np.sqrt(((x_nc - self.x_nc) ** 2).sum(axis=1).max(initial=0.0))
        return bool(cut + 2 * moved <= self.room)

    def closer(self, x_nc: FloatArray, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return those closer than a cutoff, in their order."""
        i, j, shift_pc = self.i, self.j, self.shift_pc
        r = separations(x_nc, i, j, shift_pc)
        near = np.flatnonzero(r < cut)
        return i[near], j[near], shift_pc[near]


_found: ContextVar[list[Candidates] | None] = ContextVar("found", default=None)


@contextmanager
def sharing(found: list[Candidates]) -> Iterator[None]:
    """Have all evaluators within a block begin with the candidates of one another, which ``found`` keeps."""
    before = _found.set(found)
    try:
        yield
    finally:
        _found.reset(before)


def candidates(x_nc: FloatArray, box: Box, cut: float) -> Candidates:
    """Return candidates for the pairs within a cutoff: shared ones found before, or new ones."""
    found = _found.get()
    made = next((each for each in found or () if each.hold(x_nc, box, cut)), None) or Candidates(x_nc, box, cut)
    if found is not None:
        found[:] = [made, *(each for each in found if each is not made)][:SHARED]
    return made


def _order(i: IntArray, j: IntArray, image_pc: IntArray) -> IntArray:
    """Return the order of pairs by i, j, and the image along the last axis first."""
    return np.argsort(keys((i, j, *image_pc.T[::-1])))


def keys(columns: Sequence[IntArray]) -> IntArray:
    """Return a number for each row of columns of whole numbers, (p,), in the order of rows, by the first column first.

    Sorting one number takes a tenth of the time that sorting rows does.
    """
    low = [int(column.min(initial=0)) for column in columns]
    sizes = [int(column.max(initial=0)) - least + 1 for least, column in zip(low, columns, strict=True)]
    if math.prod(sizes) >= 2**63:
        return np.unique(np.stack(columns), axis=1, return_inverse=True)[1].ravel()
    key_p = np.zeros(len(columns[0]), np.int64)
    for size, least, column in zip(sizes, low, columns, strict=True):
        key_p = key_p * size + (column - least)
    return key_p
