"""The neighbour list against all pairs and images by hand, and against scipy's tree; reuse, images, order."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from eos_ref.compiled.neighbours import WINDOW, Neighbours
from eos_ref.errors import InputError
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.box import Box

pytestmark = pytest.mark.slow

CUT = 1.0
# Edges: longer than two cutoffs, between one and two, shorter than one and than a half.
EDGES = {
    "long": (3.25, 2.5, 4.0),
    "below two cutoffs": (1.75, 2.5, 1.25),
    "below one cutoff": (0.75, 2.25, 0.625),
    "tiny": (0.37, 0.26, 0.49),
}
PERIODIC = [flags for d in (2, 3) for flags in itertools.product((True, False), repeat=d)]


def positions(edge: tuple[float, ...], n: int, seed: int = 1) -> Any:
    """Points over the box and a little beyond each face."""
    return np.random.default_rng(seed).uniform(-0.2, 1.2, (n, len(edge))) * edge


def by_hand(x_nc: Any, box: Box, cut: float) -> Counter[tuple[int, int, tuple[int, ...]]]:
    """Every ordered pair and image within a cutoff."""
    found: Counter[tuple[int, int, tuple[int, ...]]] = Counter()
    spans = [math.ceil((cut + float(np.ptp(x_nc[:, a]))) / e) + 1 for a, e in enumerate(box.edge_c)]
    images = itertools.product(*(range(-s, s + 1) if p else (0,) for s, p in zip(spans, box.periodic, strict=True)))
    for image in images:
        other_nc = x_nc + np.array(image) * box.edge_c
        r_nn = np.sqrt(np.square(x_nc[:, None] - other_nc).sum(axis=2))
        for i, j in zip(*np.nonzero(r_nn < cut), strict=True):
            if i != j or any(image):
                found[int(i), int(j), image] += 1
    return found


def listed(near: Neighbours, x_nc: Any, box: Box, cut: float) -> Counter[tuple[int, int, tuple[int, ...]]]:
    """The same from a list: each of its pairs counts in both directions."""
    found: Counter[tuple[int, int, tuple[int, ...]]] = Counter()
    order_n = np.arange(len(x_nc)) if near.order_n is None else near.order_n
    for k in range(len(x_nc)):
        for p in range(near.start_n[k], near.start_n[k + 1]):
            i, j, image = order_n[k], order_n[near.j_p[p]], near.image_pc[p]
            apart = x_nc[i] - (x_nc[j] + np.where(box.periodic, image * np.array(box.edge_c), 0.0))
            if math.sqrt(float((apart**2).sum())) < cut:
                found[int(i), int(j), tuple(int(c) for c in image)] += 1
                found[int(j), int(i), tuple(-int(c) for c in image)] += 1
    return found


@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("periodic", PERIODIC)
@pytest.mark.parametrize("n", [1, 2, 25])
def test_every_image_of_every_pair(edges: str, periodic: tuple[bool, ...], n: int) -> None:
    """Particles beyond a face, and a particle's own images, which count as a neighbour on either side."""
    edge = EDGES[edges][: len(periodic)]
    box = Box((0.0,) * len(edge), edge, periodic)
    x_nc = positions(edge, n)
    near = Neighbours(box, CUT, 0.1)
    near.build(x_nc)
    assert listed(near, x_nc, box, CUT) == by_hand(x_nc, box, CUT)


@pytest.mark.parametrize("dimension", [2, 3])
def test_own_images_in_a_tiny_box(dimension: int) -> None:
    """One particle in a box of edge 0.4: 18 sites of the square lattice, 56 of the cubic one, lie within 1."""
    box = Box((-1.0,) * dimension, (-0.6,) * dimension, (True,) * dimension)
    x_nc = np.full((1, dimension), -0.75)
    near = Neighbours(box, CUT, 0.0)
    near.build(x_nc)
    sites = itertools.product(range(-3, 4), repeat=dimension)
    expected = sum(0 < sum(c * c for c in site) * 0.16 < 1 for site in sites)
    assert sum(listed(near, x_nc, box, CUT).values()) == expected == (20 if dimension == 2 else 80)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("shuffled", [False, True])
def test_against_a_tree(dimension: int, shuffled: bool) -> None:
    """Many particles in an internal order, with one open axis; coordination numbers one by one."""
    side = 90 if dimension == 2 else 18
    random = np.random.default_rng(2)
    x_nc = np.stack(np.meshgrid(*[np.arange(side)] * dimension, indexing="ij"), -1).reshape(-1, dimension) + 0.5
    x_nc = x_nc + random.uniform(-0.3, 0.3, x_nc.shape)
    if shuffled:
        x_nc = random.permutation(x_nc)
    assert len(x_nc) > WINDOW
    periodic = (True, False, True)[:dimension]
    box = Box((0.0,) * dimension, (float(side),) * dimension, periodic)
    near = Neighbours(box, 2.5, 0.3)
    near.build(x_nc)
    assert (near.order_n is not None) == shuffled
    tree_box = np.where(periodic, float(side), 0.0)  # 0: not periodic
    tree = cKDTree(np.where(periodic, x_nc % side, x_nc), boxsize=tree_box)
    count_n = tree.query_ball_point(tree.data, near.reach, return_length=True) - 1
    found_n = np.diff(near.start_n) + np.bincount(near.j_p, minlength=len(x_nc))
    order_n = np.arange(len(x_nc)) if near.order_n is None else near.order_n
    assert np.array_equal(found_n, count_n[order_n])
    row_p = np.repeat(np.arange(len(x_nc)), np.diff(near.start_n))
    assert (np.abs(near.j_p.astype(int) - row_p) < WINDOW).mean() > 0.8


def test_rows_are_in_one_order() -> None:
    """Rising partners, then rising images, j >= i, and an own image that points up: the list has nothing else."""
    edge = EDGES["tiny"][:2]
    near = Neighbours(Box((0.0, 0.0), edge, (True, True)), CUT, 0.1)
    near.build(positions(edge, 12))
    for k in range(12):
        rows = slice(near.start_n[k], near.start_n[k + 1])
        pairs = zip(near.j_p[rows].tolist(), near.image_pc[rows].tolist(), strict=True)
        entries = [(j, sx, sy) for j, (sx, sy) in pairs]
        assert entries == sorted(set(entries))
        assert all(j > k or (j == k and (sx, sy) > (0, 0)) for j, sx, sy in entries)


@pytest.mark.parametrize("edges", EDGES)
def test_list_is_valid_up_to_half_the_skin(edges: str) -> None:
    edge = EDGES[edges]
    box = Box((0.0,) * 3, edge, (True, False, True))
    x_nc = positions(edge, 30)
    near = Neighbours(box, CUT, 0.2)
    assert not near.holds(x_nc)
    near.build(x_nc)
    step_nc = np.random.default_rng(3).normal(size=x_nc.shape)
    step_nc /= np.sqrt(np.square(step_nc).sum(axis=1))[:, None]
    moved_nc = x_nc + 0.0999 * step_nc
    assert near.holds(moved_nc)
    assert listed(near, moved_nc, box, CUT) == by_hand(moved_nc, box, CUT)
    moved_nc[7] = x_nc[7] + 0.1001 * step_nc[7]
    assert not near.holds(moved_nc)


@pytest.mark.parametrize("edges", EDGES)
def test_wrapping_between_moves_needs_no_new_list(edges: str) -> None:
    """LAMMPS wraps positions now and then; a caller may also never wrap them. Either way images are counted again."""
    edge = EDGES[edges][:2]
    box = Box((0.25, -0.5), (0.25 + edge[0], -0.5 + edge[1]), (True, True))
    x_nc = positions(edge, 20) + np.array(box.low_c)
    near = Neighbours(box, CUT, 0.2)
    near.build(x_nc)
    random = np.random.default_rng(4)
    for _ in range(3):
        x_nc = x_nc + random.integers(-3, 4, x_nc.shape) * np.array(edge) + random.uniform(-0.01, 0.01, x_nc.shape)
        assert near.holds(x_nc)
        assert listed(near, x_nc, box, CUT) == by_hand(x_nc, box, CUT)
    assert near.built == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e9])
def test_invalid_positions_are_refused(bad: float) -> None:
    box = Box((0.0, 0.0), (2.0, 2.0), (True, True))
    x_nc = positions((2.0, 2.0), 5)
    near = Neighbours(box, CUT, 0.2)
    near.build(x_nc)
    x_nc[3, 1] = bad
    assert not near.holds(x_nc)
    with pytest.raises(InputError, match="particle 4"):
        near.build(x_nc)


@pytest.mark.parametrize("far", [1e3, 1e6, 1e12, 1e30, -1e18])
def test_distant_particle_along_an_open_axis_needs_no_cells(far: float) -> None:
    """A drop that lost a particle: the others' pairs stay, and the lost one's group keeps its own."""
    x_nc = np.array([[0.0, 0.0], [0.5, 0.2], [far, 0.1], [far * (1 + 2.0**-52) if abs(far) > 1e15 else far + 0.5, 0.1]])
    box = Box((0.0, 0.0), (3.0, 2.0), (False, True))
    near = Neighbours(box, CUT, 0.0)
    near.build(x_nc)
    i, j, _ = directed_pairs(x_nc, box, CUT)
    together = abs(far) < 1e15
    assert {(int(a), int(b)) for a, b in zip(i, j, strict=True)} == {(0, 1), (1, 0)} | (
        {(2, 3), (3, 2)} if together else set()
    )
    rows = [near.j_p[near.start_n[k] : near.start_n[k + 1]].tolist() for k in range(4)]
    assert 1 in rows[0]
    assert (3 in rows[2]) or not together
