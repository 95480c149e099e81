"""Pairs of particles in a box, found by a tree: any box, however large, tilted or shorter than the cutoff.

A cell list asks for cells in all the space between particles; a tree only follows the particles. Copies of those near
periodic faces stand beyond the opposite faces, so that the tree needs to know nothing of the box.
"""

from __future__ import annotations

import math

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.model.parameters import Box, IntArray

ROOM = 1 + 1e-9  # of the reach: what rounding moves must not lose a pair


def half_pairs(x_nc: FloatArray, box: Box, reach: float) -> tuple[IntArray, IntArray, IntArray]:
    """Return every pair and image once that may lie within a reach: i, j (p,), edges to be added to j's place (p, d).

    A box shorter than two reaches gives every image of its own, a particle's own images among them.
    """
    from scipy.spatial import cKDTree

    outside_nc = box.images(x_nc)
    inside_nc = x_nc - box.shift(outside_nc)
    around_c = np.array(box.periodic)
    wide = reach * ROOM + 8 * EPS * float(np.abs(x_nc[:, around_c]).max(initial=0.0) + np.abs(box.cell_cc).sum())
    of_g, image_gc, copy_gc = _copies(inside_nc, box, wide)
    tree = cKDTree(inside_nc)
    pair_p = tree.query_pairs(wide, output_type="ndarray")
    beyond = tree.sparse_distance_matrix(cKDTree(copy_gc), wide, output_type="ndarray")
    i, j = (np.concatenate([a, b]) for a, b in ((pair_p[:, 0], beyond["i"]), (pair_p[:, 1], of_g[beyond["j"]])))
    image_pc = outside_nc[i] - outside_nc[j]
    image_pc[len(pair_p) :] += image_gc[beyond["j"]]
    return i, j, image_pc.astype(np.int64)


def _copies(x_nc: FloatArray, box: Box, wide: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return copies beyond the faces: of whom (g,), edges moved by and places, both (g, d); of opposite images one."""
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
    up_g = np.zeros(len(of_g), bool)
    for a in reversed(range(d)):
        up_g = (image_gc[:, a] > 0) | ((image_gc[:, a] == 0) & up_g)
    of_g, image_gc = of_g[up_g], image_gc[up_g]
    return of_g, image_gc, x_nc[of_g] + box.shift(image_gc)


def directed_pairs(x_nc: FloatArray, box: Box, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all ordered pairs and images with r < cut: indices i, j (p,) and displacements of j's image (p, d).

    Each pair stands twice, once for each particle that collects.
    """
    one, other, image_pc = half_pairs(x_nc, box, cut)
    i, j, image_pc = np.concatenate([one, other]), np.concatenate([other, one]), np.concatenate([image_pc, -image_pc])
    shift_pc = box.shift(image_pc.astype(float))
    r = np.sqrt(((x_nc[i] - (x_nc[j] + shift_pc)) ** 2).sum(axis=1))
    near = r < cut
    i, j, shift_pc = i[near], j[near], shift_pc[near]
    order = _order(i, j, image_pc[near], len(x_nc))
    return i[order], j[order], shift_pc[order]


def _order(i: IntArray, j: IntArray, image_pc: IntArray, n: int) -> IntArray:
    """Return the order of pairs by i, j, and the image along the last axis first."""
    low_c, high_c = image_pc.min(axis=0, initial=0), image_pc.max(axis=0, initial=0)
    sizes = [n, n, *(high_c - low_c + 1).tolist()[::-1]]
    if math.prod(sizes) >= 2**63:
        return np.lexsort((*image_pc.T, j, i))
    key_p = np.zeros(len(i), np.int64)  # sorting one number takes a tenth of the time
    for size, place_p in zip(sizes, (i, j, *(image_pc - low_c).T[::-1]), strict=True):
        key_p = key_p * size + place_p
    return np.argsort(key_p)
