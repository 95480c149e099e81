"""Neighbour searches: every pair once, in boxes of any kind; and what is wrong is counted."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eos_ref.model.box import Box
from lammps_cases.studies.chart.search_methods import METHODS, PairList, SearchMethod, keys, truth, wrong
from lammps_cases.studies.chart.searches import CUT, at_the_cutoff

pytestmark = pytest.mark.slow

DOUBLE = [method for method in METHODS if "float32" not in method.name]


NEAREST = "cKDTree"  # of nearest images: needs periodic edges of at least two cutoffs


def fits(method: SearchMethod, box: Box, cut: float) -> bool:
    edges = zip(box.edge_c, box.periodic, strict=True)
    return method.name != NEAREST or all(edge >= 2 * cut or not periodic for edge, periodic in edges)


def distances(x_nc: Any, box: Box, cut: float) -> Any:
    """Distances of all images within reach, pair by pair."""
    reach = [
        range(-int(cut / e) - 2, int(cut / e) + 3) if p else (0,) for e, p in zip(box.edge_c, box.periodic, strict=True)
    ]
    images = np.array(list(itertools.product(*reach))) * np.array(box.edge_c)
    return np.sqrt(np.square(x_nc[:, None, None] - x_nc[None, :, None] - images).sum(axis=-1))


@st.composite
def boxes(draw: Any) -> tuple[Any, Box, float]:
    """Particles in a box of two or three axes, periodic or not, shorter or longer than the cutoff."""
    d, n = draw(st.integers(2, 3)), draw(st.integers(0, 25))
    cut = draw(st.floats(0.3, 2.0))
    edge_c = [draw(st.floats(0.4, 7.0)) for _ in range(d)]
    low_c = [draw(st.floats(-5.0, 5.0)) for _ in range(d)]
    periodic = tuple(draw(st.booleans()) for _ in range(d))
    box = Box(tuple(low_c), tuple(low + edge for low, edge in zip(low_c, edge_c, strict=True)), periodic)
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    return np.array(low_c) + random.uniform(0, 1, (n, d)) * np.array(box.edge_c), box, cut


@settings(max_examples=80, deadline=None)
@given(boxes())
def test_every_search_finds_exactly_the_pairs(made: tuple[Any, Box, float]) -> None:
    x_nc, box, cut = made
    assume(len(x_nc) > 0)
    r_nno = distances(x_nc, box, cut)
    assume(np.abs(r_nno - cut).min() > 1e-9)  # what is at the cutoff is rounding's to decide
    true = truth(x_nc, box, cut)
    assert 2 * len(true.i_p) == int((r_nno < cut).sum()) - len(x_nc)  # both directions, without each itself
    assert len(keys(true)) == len(true.i_p)
    for method in DOUBLE:
        if fits(method, box, cut):
            assert wrong(method.pairs(x_nc, box, cut), true) == 0, method.name


@settings(max_examples=30, deadline=None)
@given(boxes())
def test_single_precision_finds_what_is_not_near_the_cutoff(made: tuple[Any, Box, float]) -> None:
    x_nc, box, cut = made
    assume(len(x_nc) > 0)
    # Coordinates below 16 are rounded by 1e-6, so a distance by less than ten times that.
    assume(np.abs(distances(x_nc, box, cut) - cut).min() > 1e-5)
    method = next(m for m in METHODS if m.name == "cell list, float32")
    assert wrong(method.pairs(x_nc, box, cut), truth(x_nc, box, cut)) == 0


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_no_particles_no_pairs_and_one_particle_meets_its_images(method: SearchMethod) -> None:
    box = Box((0.0, 0.0), (1.0, 8.0), (True, True))
    one = np.array([[0.5, 0.5]])
    open_box = Box((0.0, 0.0), (8.0, 8.0), (False, False))
    assert len(method.pairs(one, open_box, 1.5).i_p) == 0
    if fits(method, box, 1.5):
        found = method.pairs(one, box, 1.5)
        assert keys(found) == {(0, 0, 1, 0)} and len(found.i_p) == 1


def test_truth_is_exact_at_the_cutoff() -> None:
    box = Box((0.0, 0.0), (64.0, 64.0), (True, True))
    x_nc = np.array([[1.0, 1.0], [4.0, 5.0]])  # 3, 4, 5
    assert len(truth(x_nc, box, 5.0).i_p) == 0
    assert len(truth(x_nc, box, float(np.nextafter(5.0, 6.0))).i_p) == 1
    x_nc = np.array([[0.0, 0.0], [0.1, 0.0]])
    assert Fraction(0.1) ** 2 < Fraction(float(np.nextafter(0.1, 1.0))) ** 2
    assert len(truth(x_nc, box, 0.1).i_p) == 0


def test_single_precision_is_wrong_at_the_cutoff_more_often_than_double() -> None:
    x_nc, box = at_the_cutoff(100.0, 400)
    true = truth(x_nc, box, CUT)
    off = {method.name: wrong(method.pairs(x_nc, box, CUT), true) for method in METHODS}
    assert off["cell list, float32"] > 10 * max(count for name, count in off.items() if name != "cell list, float32")


def test_what_is_missed_invented_or_found_twice_is_counted() -> None:
    x_nc, box = at_the_cutoff(32.0, 100)
    true = truth(x_nc, box, CUT)
    assert wrong(true, true) == 0
    assert wrong(PairList(*(part[1:] for part in true)), true) == 1
    assert wrong(PairList(*(np.concatenate([part, part[:1]]) for part in true)), true) == 1
    moved_pc = true.image_pc.copy()
    moved_pc[0, 0] += 1
    assert wrong(PairList(true.i_p, true.j_p, moved_pc), true) == 2
    turned = PairList(true.j_p, true.i_p, -true.image_pc)
    assert wrong(turned, true) == 0
