"""Neighbours are all images within the cutoff, in short and in leaning boxes.

Tolerances are the rounding bounds that `Rounded` runs give, of both sides of a comparison.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.box import Box
from eos_ref.numbers.rounded import error, value
from tests.support.particle_scenes import HOT, RECIPES, assert_same, bounded, recipe, scene

pytestmark = pytest.mark.slow

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])


@DIMENSIONS
@pytest.mark.parametrize("name", RECIPES)
def test_short_box_equals_its_replication(name: str, dimension: int) -> None:
    """Several images in a box shorter than two cutoffs equal the particles of a box twice as long."""
    built = recipe(name, dimension)
    s, box = built.state, built.box
    edge = np.array(box.edge_c)
    assert any(p and e < 2 * built.model.cut for p, e in zip(box.periodic, edge, strict=True))
    copies = np.array(list(itertools.product(*[(0, 1) if p else (0,) for p in box.periodic])))
    arrays = {k: np.concatenate([getattr(s, k)] * len(copies)) for k in ("v_nc", "rho_n", "type_n", "solid_n")}
    x_nc = np.concatenate([s.x_nc + c * edge for c in copies])
    energy_n = None if s.energy_n is None else np.concatenate([s.energy_n] * len(copies))
    high = tuple(float(h + (e if p else 0)) for h, e, p in zip(box.high_c, edge, box.periodic, strict=True))
    large = replace(built.with_state(x_nc=x_nc, energy_n=energy_n, **arrays), box=Box(box.low_c, high, box.periodic))
    expected = {name: tuple(np.concatenate([a] * len(copies)) for a in pair) for name, pair in bounded(built).items()}
    assert_same(bounded(large), expected)


@DIMENSIONS
@pytest.mark.parametrize("name", RECIPES)
def test_edges_leaning_by_whole_edges(name: str, dimension: int) -> None:
    """They make the same lattice of images."""
    built = recipe(name, dimension)
    box = replace(built.box, periodic=(True,) * dimension)
    lx, ly = box.edge_c[:2]
    leaning = replace(box, tilt=(2 * lx,) if dimension == 2 else (-lx, lx, ly))
    x_nc = built.state.x_nc
    inside = built.with_state(x_nc=x_nc - leaning.shift(leaning.images(x_nc)))
    assert_same(bounded(replace(inside, box=leaning)), bounded(replace(built, box=box)))


@DIMENSIONS
def test_particle_and_its_own_images(dimension: int) -> None:
    """One particle in a box of edge 1: every image is a neighbour, no force by symmetry."""
    built = scene(dimension, thermal=HOT)
    s = built.state
    one = built.with_state(**{k: getattr(s, k)[:1] for k in ("x_nc", "v_nc", "rho_n", "type_n", "solid_n", "energy_n")})
    one = replace(one, box=Box((0.0,) * dimension, (1.0,) * dimension, (True,) * dimension))
    one = one.with_state(x_nc=np.full((1, dimension), 0.5))
    sites = [k for k in itertools.product(range(-3, 4), repeat=dimension) if 0 < sum(c * c for c in k) < 2.625**2]
    found = bounded(one)
    assert found["coordination"][0].tolist() == [len(sites)]
    assert (np.abs(found["f"][0]) <= found["f"][1]).all()
    assert not found["grad/v"][0].any()
    assert not found["heatflow"][0].any()


def test_pairs_at_cutoff_are_excluded() -> None:
    """r < cut strictly."""
    built = scene(2, cut=3.0, periodic=(False, False), margin=9.0)
    s = built.state
    near = np.nextafter(3.0, 0.0)
    for apart, expected in ((3.0, [0, 0]), (near, [1, 1])):
        two = {k: getattr(s, k)[:2] for k in ("v_nc", "rho_n", "type_n", "solid_n")}
        simulation = built.with_state(x_nc=np.array([[0.0, 0.0], [apart, 0.0]]), **two).simulate(["coordination"])
        assert simulation.evaluate()["coordination"].tolist() == expected


@DIMENSIONS
def test_distance_is_bounded_for_either_choice_of_image(dimension: int) -> None:
    """In a box of hundreds of cutoffs a position beyond the upper face rounds by more than one beyond the lower."""
    built = recipe("quintic", dimension)
    n, d = built.state.x_nc.shape
    low, high = built.box.low_c[0], built.box.low_c[0] + 284.4
    random = np.random.default_rng(1)
    x_nc = np.array(built.state.x_nc)
    x_nc[:, 0] = np.where(random.random(n) < 0.5, low, high - 0.9) + 0.9 * random.random(n)
    box = replace(built.box, high_c=(high, *built.box.high_c[1:]), periodic=(True,) * d)
    evaluator = replace(built.with_state(x_nc=x_nc), box=box).simulate().rounded().evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    across_p = np.abs(x_nc[evaluator.i, 0] - x_nc[evaluator.j, 0]) > 100
    x_i, x_j = x_nc[evaluator.i, 0], x_nc[evaluator.j, 0]
    beyond_p = np.where(x_i < x_j, high - low, low - high)
    other_p = (x_i + beyond_p) - x_j
    apart = evaluator.x[0]
    assert across_p.sum() > n
    assert (np.abs(value(apart) - other_p) <= error(apart))[across_p].all()
