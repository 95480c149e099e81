"""Invariance under changes of frame, numbering and scale.

Tolerances are the rounding bounds that `Rounded` runs give, of both sides of a comparison.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.model.box import Box
from eos_ref.model.parameters import Force
from eos_ref.model.quantities import QUANTITIES
from eos_ref.syntax.fixes import Shift
from tests.support.particle_scenes import EPS, RECIPES, Scene, assert_same, bounded, recipe, scene

pytestmark = pytest.mark.slow

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])
Field = dict[str, tuple[Any, Any]]


def changed(found: Field, **maps: Any) -> Field:
    """Fields, each mapped; those without a map unchanged."""
    return {name: tuple(maps.get(name, lambda a: a)(a) for a in pair) for name, pair in found.items()}


@DIMENSIONS
@pytest.mark.parametrize("name", [name for name in RECIPES if "shift" not in RECIPES[name]])
def test_galilean_invariance(name: str, dimension: int) -> None:
    """v + U: nothing changes. Velocities are multiples of 2**-20, so v + U is exact."""
    built = recipe(name, dimension)
    U = np.array([4.0, -3.0, 2.5])[:dimension]
    assert_same(bounded(built.with_state(v_nc=built.state.v_nc + U)), bounded(built))


@DIMENSIONS
def test_shifting_depends_on_the_frame(dimension: int) -> None:
    """By design: it is proportional to the speed of the particle."""
    built = scene(dimension, shift=Shift())
    fast = built.with_state(v_nc=2 * built.state.v_nc)
    shift, error_ = bounded(built)["shift/v"]
    twice, error_twice = bounded(fast)["shift/v"]
    assert (np.abs(twice - 2 * shift) <= 2 * error_ + error_twice).all()
    at_rest = bounded(built.with_state(v_nc=0 * built.state.v_nc))["shift/v"][0]
    assert not at_rest.any()
    U = np.array([4.0, -3.0, 2.5])[:dimension]
    moved = bounded(built.with_state(v_nc=built.state.v_nc + U))["shift/v"][0]
    assert np.abs(moved - shift).max() > 0.1 * np.abs(shift).max()


@DIMENSIONS
@pytest.mark.parametrize("name", RECIPES)
def test_relabelling(name: str, dimension: int) -> None:
    built = recipe(name, dimension)
    order = np.random.default_rng(9).permutation(len(built.state.x_nc))
    s = built.state
    arrays = {k: getattr(s, k)[order] for k in ("x_nc", "v_nc", "rho_n", "type_n", "solid_n")}
    energy_n = None if s.energy_n is None else s.energy_n[order]
    mixed = bounded(built.with_state(**arrays, energy_n=energy_n))
    assert_same(mixed, {name: (a[order], b[order]) for name, (a, b) in bounded(built).items()})


@DIMENSIONS
@pytest.mark.parametrize("name", RECIPES)
def test_translation(name: str, dimension: int) -> None:
    """Of the box with all particles, and of the periodic box alone: particles that leave come back as images."""
    built = recipe(name, dimension)
    box, s = built.box, built.state
    by = np.array([5.5, -3.25, 7.125])[:dimension]
    far = Box(tuple(box.low_c + by), tuple(box.high_c + by), box.periodic)
    expected = bounded(built)
    assert_same(bounded(replace(built.with_state(x_nc=s.x_nc + by), box=far)), expected)
    by = np.where(box.periodic, [1.5, 2.25, 0.625][:dimension], 0.0)
    edge = np.array(box.edge_c)
    x_nc = s.x_nc + by
    x_nc = x_nc - np.where(x_nc > box.high_c, edge, 0.0)
    assert np.abs(x_nc - s.x_nc - by).max() > 1
    assert_same(bounded(built.with_state(x_nc=x_nc)), expected)


@DIMENSIONS
@pytest.mark.parametrize("name", RECIPES)
@pytest.mark.parametrize("turn", ["quarter turn", "mirror"])
def test_quarter_turn_and_mirror(turn: str, name: str, dimension: int) -> None:
    """x -> -y, y -> x about the z axis; and x -> -x. Vectors follow as R v, velocity gradients as R G R^T."""
    built = recipe(name, dimension)
    R = np.eye(dimension)
    R[:2, :2] = [[0, -1], [1, 0]] if turn == "quarter turn" else [[-1, 0], [0, 1]]
    s, box, forces = built.state, built.box, []
    corners = np.array([box.low_c, box.high_c]) @ R.T
    moved = tuple(bool(p) for p in (np.abs(R) @ np.array(box.periodic, float)) > 0)
    new_box = Box(tuple(corners.min(axis=0)), tuple(corners.max(axis=0)), moved)
    for force in built.model.forces:
        numbers = R @ np.array([0.0 if c is None else c for c in force.vector])
        free_c = np.abs(R) @ np.array([c is None for c in force.vector], float) > 0
        vector = tuple(None if none else float(c) for none, c in zip(free_c, numbers, strict=True))
        forces.append(Force(force.style, vector, force.types))
    turned = replace(built.with_model(forces=tuple(forces)), box=new_box)
    found = bounded(turned.with_state(x_nc=s.x_nc @ R.T, v_nc=s.v_nc @ R.T))

    def vector_map(a: Any) -> Any:
        return a @ R.T

    def tensor_map(a: Any) -> Any:
        return np.einsum("ac,ncd,bd->nab", R, a, R)

    before = bounded(built)
    by_rank = {1: vector_map, 2: tensor_map}
    expected = changed(before, **{q: by_rank[rank] for q in before if (rank := QUANTITIES[q].rank)})
    if turn == "quarter turn":  # W_xy is the sum of x f_y and pair forces are not central: turned it is that of y f_x
        kept = np.ones((dimension, dimension))
        kept[0, 1] = kept[1, 0] = 0.0
        found, expected = (changed(fields, **{"stress/atom": lambda a: kept * a}) for fields in (found, expected))
    assert_same(found, {name: (a, np.abs(b)) for name, (a, b) in expected.items()})


def rescaled(built: Scene, size: float) -> Scene:
    """Lengths times ``size``, mass times size**d, viscosity times size; density, velocity, pressure as they are."""
    model, d = built.model, built.model.dimension
    fix = replace(model.fix, cut=size * model.fix.cut)
    made = built.with_model(
        fix=fix,
        mass_t=tuple(size**d * m for m in model.mass_t),
        pair=replace(model.pair, cut=fix.cut, rho_damp=size * model.pair.rho_damp),
        viscosity=tuple(replace(v, eta=size * v.eta, K=size**v.n * v.K, gd0=v.gd0 / size) for v in model.viscosity),
        thermal=model.thermal
        and tuple(replace(p, conductivity=size * p.conductivity) for p in model.thermal),  # Q as m e/t
        forces=tuple(
            replace(
                f,
                vector=tuple(
                    None if c is None else c * size ** (-1 if f.style == "gravity" else d - 1) for c in f.vector
                ),
            )
            for f in model.forces
        ),
    )
    box = Box(tuple(size * c for c in built.box.low_c), tuple(size * c for c in built.box.high_c), built.box.periodic)
    s = built.state
    energy_n = None if s.energy_n is None else size**d * s.energy_n
    return replace(made.with_state(x_nc=size * s.x_nc, energy_n=energy_n), box=box)


# Left out: scale_cross_type (wmin has the dimension of W, rmin that of r W), the repulsion of walls in 2D (its formula
# is one of 3D), surfaces (1e-10 in the normal is absolute).
NOT_SCALING = ("cross", "cross, by distance", "droplet", "coordination", "divergence")
SCALING = [name for name in RECIPES if name not in NOT_SCALING]


def power_of(name: str, dimension: int) -> int:
    """The power of ``size`` by which `rescaled` scales an output: lengths and times take one, masses and volumes d."""
    length, mass, time, volume = QUANTITIES[name].dimension
    return length + time + dimension * (mass + volume)


@pytest.mark.parametrize(("name", "dimension"), [*itertools.product(SCALING, (2, 3)), ("droplet", 3)])
def test_rescaling(name: str, dimension: int) -> None:
    """Lengths times 3: rounding apart the same physics (the power law's exponents included, gd0 being a rate)."""
    built, size = recipe(name, dimension), 3.0
    scale = {name: size ** power_of(name, dimension) for name in bounded(built)}
    expected = {name: (scale[name] * a, scale[name] * b * (1 + 1e-9)) for name, (a, b) in bounded(built).items()}
    # parameters that do not scale exactly (size**n K, gd0/size) bring a few roundings of their own: one more bound
    assert_same(bounded(rescaled(built, size)), expected, slack=2.0)


@DIMENSIONS
@pytest.mark.parametrize("name", ["quintic", "RK1", "walls", "walls, thermal", "forces"])
def test_rescaling_over_steps(name: str, dimension: int) -> None:
    """Five steps in longdouble, where roundings are 2**11 times smaller: within one evaluation's float64 bound."""
    built, size, dt = recipe(name, dimension), 3.0, 2.0**-8
    pair = []
    for one, step in ((built, dt), (rescaled(built, size), size * dt)):
        simulation = one.longdouble().simulate()
        simulation.run(5, step)
        pair.append(simulation)
    a, b = pair
    allowed = bounded(built)
    scale = size ** power_of("f", dimension)
    assert (np.abs(scale * a.fields["f"] - b.fields["f"]) <= scale * 4 * allowed["f"][1].max()).all()
    for x, y, largest in (
        (size * a.state.x_nc, b.state.x_nc, 3),
        (a.state.v_nc, b.state.v_nc, 1),
        (a.state.rho_n, b.state.rho_n, 1),
    ):
        assert np.abs(x - y).max() <= dt * 40 * allowed["f"][1].max() + 64 * EPS * largest * np.abs(x).max()
