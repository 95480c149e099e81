"""Directed pairs within a cutoff against counting all images, and empty stretches of open axes."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from eos_ref.errors import InputError
from eos_ref.evaluation.cutoff import AtCutoff
from eos_ref.evaluation.pairs import SHARED, Candidates, Search, candidates, directed_pairs, sharing
from eos_ref.model.box import Box
from eos_ref.numbers.rounded import error, value
from tests.support.particle_scenes import recipe

# --- directed pairs


def all_pairs(x_nc: Any, box: Box, cut: float) -> set[tuple[Any, ...]]:
    """Every i, j and image of j with r < cut, by trying all images of some periods around."""
    turns = np.array(list(itertools.product(*[range(-3, 4) if periodic else (0,) for periodic in box.periodic])))
    shift_kc = turns @ box.cell_cc
    apart_nnkc = x_nc[:, None, None] - (x_nc[:, None] + shift_kc)
    near = np.sqrt((apart_nnkc**2).sum(axis=3)) < cut
    return {(i, j, *shift_kc[k].tolist()) for i, j, k in np.argwhere(near).tolist() if i != j or turns[k].any()}


def as_set(pairs: tuple[Any, Any, Any]) -> set[tuple[Any, ...]]:
    i, j, shift_pc = pairs
    return {(int(a), int(b), *(s + 0.0).tolist()) for a, b, s in zip(i, j, shift_pc, strict=True)}


@pytest.mark.parametrize("periodic", [(True, True), (True, False), (False, False)])
@pytest.mark.parametrize("cut", [0.5, 1.5, 2.5])
def test_pairs_and_images_equal_those_of_a_full_count(periodic: tuple[bool, bool], cut: float) -> None:
    """The box is shorter than two cutoffs for the largest cutoff: particles interact with their own images."""
    box = Box((-1.0, 0.0), (1.0, 3.0), periodic)
    x_nc = np.random.default_rng(4).uniform([-1.0, 0.0], [1.0, 3.0], (12, 2))
    found = directed_pairs(x_nc, box, cut)
    assert as_set(found) == all_pairs(x_nc, box, cut)
    assert len(found[0]) == len(as_set(found))
    assert any(i == j for i, j in zip(*found[:2], strict=True)) == (periodic[0] and cut > 2)


@pytest.mark.parametrize("tilt", [(0.75, 0.0, 0.0), (-0.5, 0.25, 1.25), (2.25, 0.0, -3.25)])
def test_images_of_a_tilted_box(tilt: tuple[float, float, float]) -> None:
    """Shorter than two cutoffs, with particles outside; the last leans by more than an edge."""
    box = Box((-1.0, 0.0, 0.5), (1.0, 3.0, 4.5), (True, True, True), tilt)
    x_nc = np.random.default_rng(4).uniform([-2.0, 0.0, 0.0], [1.5, 3.0, 4.0], (10, 3))
    found = as_set(directed_pairs(x_nc, box, 1.75))
    assert found and found == all_pairs(x_nc, box, 1.75)
    assert found != as_set(directed_pairs(x_nc, Box(box.low_c, box.high_c, box.periodic), 1.75))
    inside_nc = x_nc - box.shift(box.images(x_nc))
    assert not box.outside(inside_nc).any() and box.outside(x_nc).any()
    assert (box.periods(x_nc - inside_nc) == box.images(x_nc)).all()


@pytest.mark.parametrize(("tilt", "stretch"), [((1.25, 0.0, 0.0), 4), ((), 1)])
def test_open_axis_with_particles_outside_the_box(tilt: tuple[float, ...], stretch: float) -> None:
    box = Box((0.0, 0.0, 0.0), (2.0, 3.0, 4.0), (True, True, False), tilt)
    x_nc = np.random.default_rng(5).uniform([-2.0, 0.0, 0.0], [2.0, 3.0, 4.0], (15, 3)) * [1, 1, stretch]
    found = as_set(directed_pairs(x_nc, box, 1.25))
    assert found and found == all_pairs(x_nc, box, 1.25)


@pytest.mark.parametrize("seed", range(20))
def test_rounding_of_fractions_of_a_tilted_box(seed: int) -> None:
    """Positions as fractions of the edges and back, in doubles: within the bound, and not far below it."""
    random = np.random.default_rng(seed)
    low_c, edge_c = random.uniform(-9, 9, 3), random.uniform(2, 9, 3)
    box = Box(tuple(low_c.tolist()), tuple((low_c + edge_c).tolist()), (True,) * 3, tuple(random.uniform(-9, 9, 3)))
    x_nc = low_c + random.random((5000, 3)) @ box.cell_cc
    back_nc = (x_nc - low_c) @ np.linalg.inv(box.cell_cc) @ box.cell_cc + low_c
    worst_c = (np.abs(back_nc - x_nc) / box.rounding(0.0)).max(axis=0)
    assert (worst_c <= 1).all() and worst_c.max() > 0.02


@pytest.mark.parametrize("size", [2.0**-40, 2.0**-10, 2.0**30])
def test_pairs_are_the_same_at_every_size(size: float) -> None:
    """A search in units of 1 never terminates in a box of 1e-3."""
    box = Box((0.0, 0.0), (5.0 * size, 4.0 * size), (False, True))
    x_nc = np.random.default_rng(8).uniform(0.0, [5.0, 4.0], (20, 2))
    i, j, shift_pc = directed_pairs(x_nc * size, box, 2.5 * size)
    own = directed_pairs(x_nc, Box((0.0, 0.0), (5.0, 4.0), (False, True)), 2.5)
    assert i.tolist() == own[0].tolist() and j.tolist() == own[1].tolist()
    assert (shift_pc == own[2] * size).all()


def test_pairs_are_sorted_and_listed_in_both_directions() -> None:
    box = Box((0.0, 0.0), (4.0, 4.0), (True, True))
    i, j, shift_pc = directed_pairs(np.random.default_rng(6).uniform(0, 4, (20, 2)), box, 1.0)
    keys = [(a, b, *s) for a, b, s in zip(i.tolist(), j.tolist(), shift_pc.tolist(), strict=True)]
    assert keys == sorted(keys)
    assert {(b, a, *(-s + 0.0 for s in shift)) for a, b, *shift in keys} == {
        (a, b, *(s + 0.0 for s in shift)) for a, b, *shift in keys
    }


def test_pair_at_the_cutoff_is_excluded() -> None:
    box = Box((0.0, 0.0), (8.0, 8.0), (False, False))
    x_nc = np.array([[1.0, 1.0], [2.0, 1.0]])
    assert not as_set(directed_pairs(x_nc, box, 1.0))
    assert len(as_set(directed_pairs(x_nc, box, np.nextafter(1.0, 2.0)))) == 2


def test_distant_particle_has_no_neighbours() -> None:
    box = Box((0.0, 0.0), (1e12, 1.0), (False, True))
    x_nc = np.array([[0.0, 0.1], [0.5, 0.1], [1e12, 0.1]])
    assert {pair[:2] for pair in as_set(directed_pairs(x_nc, box, 0.75)) if pair[0] != pair[1]} == {(0, 1), (1, 0)}


# In cutoffs: cell lists of all the space between particles run out of cells, or divide by the number of those left.
HUGE = {
    "sheet": ((500.0, 500.0), ()),
    "tilted sheet": ((500.0, 700.0), (250.0,)),
    "strip": ((1e6, 1.0), ()),
    "slab": ((600.0, 700.0, 1.5), ()),
    "rod": ((1.25, 1e7, 1.0), ()),
    "cube": ((1e12, 1e12, 1e12), ()),
    "tilted cube": ((3e5, 3e5, 3e5), (1e5, -2e5, 1e5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HUGE)
@pytest.mark.parametrize("open_axis", [False, True])
def test_few_particles_in_a_huge_box(name: str, open_axis: bool) -> None:
    """Close together, and across the faces: the library used before terminated the process for most."""
    edge, tilt = HUGE[name]
    periodic = (True,) * (len(edge) - 1) + (not (open_axis and not tilt),)
    box = Box((0.0,) * len(edge), edge, periodic, tilt)
    steps_nc = np.random.default_rng(9).uniform(-0.6, 0.6, (8, len(edge)))
    corners_nc = np.array([[0.0] * len(edge), [1.0] * len(edge), [0.5] * len(edge)])
    x_nc = (corners_nc[:, None] @ box.cell_cc + steps_nc).reshape(-1, len(edge))
    found = as_set(directed_pairs(x_nc, box, 1.0))
    assert len(found) > 20 and found == all_pairs(x_nc, box, 1.0)


def test_order_when_image_counts_overflow_the_key() -> None:
    """Particles billions of edges outside: pairs are sorted by all their indices, as usual."""
    box = Box((0.0, 0.0), (1.0, 1.0), (True, True))
    x_nc = np.array([[0.25, 0.5], [0.5, 0.5], [0.75, 0.25]]) + np.array([[0.0, 0.0], [2.0**34, 0.0], [0.0, 2.0**33]])
    i, j, shift_pc = directed_pairs(x_nc, box, 1.125)
    keys = [(a, b, *s[::-1]) for a, b, s in zip(i.tolist(), j.tolist(), shift_pc.tolist(), strict=True)]
    assert keys == sorted(keys) and len(set(keys)) == len(keys) > 20


@pytest.mark.parametrize("tilt", [(), (0.75, 0.0, 0.0)])
def test_pairs_of_moving_particles_equal_those_of_a_search(tilt: tuple[float, ...]) -> None:
    """No search is needed for small displacements; one is if particles cross a face, or box or cutoff change."""
    box = Box((-1.0, 0.0, 0.5), (1.0, 3.0, 4.5), (True, True, False), tilt)
    random = np.random.default_rng(7)
    x_nc = random.uniform(box.low_c, box.high_c, (40, 3))
    near, held = Candidates(x_nc, box, 1.5), 0
    for k in range(30):
        cut = 1.5 if k % 7 else 2.0
        searched = Search(x_nc, box, cut).rows(0, len(x_nc), cut)
        assert all(map(np.array_equal, directed_pairs(x_nc, box, cut), searched))
        if near.hold(x_nc, box, cut):
            held += 1
            assert all(map(np.array_equal, near.closer(x_nc, cut), searched))
        else:
            near = Candidates(x_nc, box, cut)
        x_nc = x_nc + random.normal(scale=0.01, size=x_nc.shape)
        if k % 5 == 4:
            x_nc = x_nc - box.shift(box.images(x_nc))
        if k == 20:
            box = Box((-1.0, 0.0, 0.5), (1.125, 3.0, 4.5), (True, True, False), tilt)
    assert 5 < held < 25


def test_candidates_are_shared_within_a_block_and_nowhere_else() -> None:
    box, x_nc = Box((0.0, 0.0), (4.0, 4.0), (True, True)), np.random.default_rng(8).uniform(0.0, 4.0, (40, 2))
    with sharing([]):
        first = candidates(x_nc, box, 1.0)
        second = candidates(x_nc + 1.0, box, 1.0)
        assert second is not first, "too far away"
        assert candidates(x_nc + 1e-3, box, 1.0) is first
        assert candidates(x_nc + 1.0, box, 1.0) is second
        for k in range(SHARED):
            last = candidates(x_nc + 2.0 + k, box, 1.0)
        assert candidates(x_nc + 1.0 + SHARED, box, 1.0) is last
        assert candidates(x_nc + 1.0, box, 1.0) is not second, "replaced by one requested later"
    assert candidates(x_nc + 1.0 + SHARED, box, 1.0) is not last


def test_particles_too_distant_to_resolve_have_no_pairs() -> None:
    """A diverged run requested as many images as there are edges between its particles and the box."""
    box = Box((0.0, 0.0), (4.0, 4.0), (True, False))
    x_nc = np.array([[1.0, 1.0], [1e18, 2.0]])
    with pytest.raises(InputError, match="positions: must be known to less than an edge"):
        directed_pairs(x_nc, box, 1.0)
    assert not as_set(directed_pairs(x_nc[:, ::-1], box, 0.5)), "along an open axis"


# --- at the cutoff


# Two particles exactly a cutoff apart, one that has a neighbour well within, which is the second's too, and one alone.
PLACES = np.array([[1.0, 1.0], [4.0, 1.0], [3.0, 1.0], [1.0, 9.0]])


def test_pair_at_the_cutoff_leaves_only_its_particles_open() -> None:
    model, open_box = recipe("walls", 2).model, Box((0.0, 0.0), (20.0, 20.0), (False, False))
    evaluator = AtCutoff(model, open_box, np.ones(4, int), np.zeros(4, bool))
    far = PLACES * model.cut / 3.0
    evaluator.move(far)
    assert error(evaluator.counted()).tolist() == [1.0, 1.0, 0.0, 0.0]
    chi_n = evaluator.same_phase()
    assert value(chi_n).tolist() == [1.0, 1.0, 1.0, 0.0], "the particle alone has none, whatever others have"
    assert np.isfinite(error(chi_n)).all()
