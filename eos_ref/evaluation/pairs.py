"""Directed pairs of particles in a box: each pair stands twice, once for each particle that collects."""

from __future__ import annotations

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.model.parameters import Box, IntArray


def compacted(x_n: FloatArray, reach: float) -> FloatArray:
    """Return the coordinates along an open axis from 0 on, empty stretches cut down to two reaches; both (n,).

    Who is whose neighbour within a reach does not change. A cell list covers all the space between particles, and one
    particle far away from the others would ask for more cells than there can be.
    """
    order_n = np.argsort(x_n, kind="stable")
    sorted_n = x_n[order_n]
    begins_n = np.flatnonzero(np.concatenate([[True], np.diff(sorted_n) > 2 * reach]))
    ends_n = np.append(begins_n[1:], len(x_n))
    spans = sorted_n[ends_n - 1] - sorted_n[begins_n]
    origins = np.concatenate([[0.0], np.cumsum(spans[:-1] + 2 * reach)])
    compact_n = np.empty(len(x_n))
    sizes = ends_n - begins_n
    compact_n[order_n] = (sorted_n - np.repeat(sorted_n[begins_n], sizes)) + np.repeat(origins, sizes)
    return compact_n


def search_unit(reach: float) -> float:
    """Return the unit of length for vesin, a power of two near the reach: in a box of 1e-3 its search does not end."""
    return float(2.0 ** np.round(np.log2(reach)))


def directed_pairs(x_nc: FloatArray, box: Box, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all ordered pairs and images with r < cut: indices i, j (p,) and displacements of j's image (p, d).

    A box shorter than two cutoffs gives every image of its own, a particle's own images among them.
    """
    import vesin

    n, d = x_nc.shape
    # Periodic images are counted from inside the box; vesin needs a third axis and some extent along open ones.
    image_nc = box.images(x_nc)
    points, extent = np.zeros((n, 3)), np.full(3, 4.0 * cut)
    points[:, :d] = x_nc - box.shift(image_nc)
    for a in (a for a in range(d) if not box.periodic[a] and n):
        points[:, a] = compacted(points[:, a], cut)
    span = points[:, :d].max(axis=0, initial=0.0) + 4 * cut  # from 0 on along open axes
    extent[:d] = np.where(box.periodic, box.edge_c, span)
    cell = np.diag(extent)
    cell[:d, :d] += np.tril(box.cell_cc, -1)
    periodic = [*box.periodic, *([False] * (3 - d))]
    unit = search_unit(cut)
    wide = vesin.NeighborList(cutoff=cut / unit * (1 + 1e-9), full_list=True, sorted=True, n_threads=1)
    i, j, s_pc = wide.compute(points / unit, cell / unit, periodic, "ijS")
    i, j = i.astype(np.int64), j.astype(np.int64)
    shift_pc = box.shift(s_pc[:, :d] + (image_nc[i] - image_nc[j]))
    r = np.sqrt(((x_nc[i] - (x_nc[j] + shift_pc)) ** 2).sum(axis=1))
    near = r < cut
    i, j, shift_pc = i[near], j[near], shift_pc[near]
    order = np.lexsort((*shift_pc.T, j, i))
    return i[order], j[order], shift_pc[order]
