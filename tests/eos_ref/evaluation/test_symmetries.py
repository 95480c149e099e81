"""Invariance under changes of frame, numbering, scale and images; what is conserved, and what kernels reproduce.

Tolerances are the rounding bounds that `Rounded` runs give, of both sides of a comparison.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels.styles import KERNELS
from eos_ref.model.box import Box
from eos_ref.model.parameters import Force
from eos_ref.model.quantities import QUANTITIES
from eos_ref.numbers.rounded import Rounded, error, value
from eos_ref.syntax.fixes import Shift
from tests.support.particle_scenes import EPS, HOT, RECIPES, Scene, assert_same, bounded, dyadic, recipe, results, scene

pytestmark = pytest.mark.slow


# --- symmetries

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])
ARRAYS = ("x_nc", "v_nc", "rho_n", "type_n", "solid_n", "energy_n")
FRAME = [4.0, -3.0, 2.5]  # a velocity; like all numbers of these scenes a multiple of 2**-20, so that sums are exact


@dataclass(frozen=True)
class Symmetry:
    """A scene that must give the same as another one, field by field."""

    other: Scene
    of: Callable[[str, Any], Any] = lambda field, a: a  # its value (or error), by that of the first scene
    seen: Callable[[str, Any], Any] = lambda field, a: a  # what is compared of either
    slack: float = 1.0  # bounds by which they may differ
    base: Scene | None = None  # the first scene, if it is not a recipe itself


def arrays(built: Scene, change: Callable[[Any], Any]) -> dict[str, Any]:
    return {k: change(a) for k in ARRAYS if (a := getattr(built.state, k)) is not None}


def galilean(built: Scene) -> Symmetry:
    return Symmetry(built.with_state(v_nc=built.state.v_nc + FRAME[: built.model.dimension]))


def relabelled(built: Scene) -> Symmetry:
    order = np.random.default_rng(9).permutation(len(built.state.x_nc))
    return Symmetry(built.with_state(**arrays(built, lambda a: a[order])), lambda field, a: a[order])


def translated(built: Scene) -> Symmetry:
    """Move the box with all particles."""
    box, by = built.box, np.array([5.5, -3.25, 7.125])[: built.model.dimension]
    far = Box(tuple(box.low_c + by), tuple(box.high_c + by), box.periodic)
    return Symmetry(replace(built.with_state(x_nc=built.state.x_nc + by), box=far))


def wrapped(built: Scene) -> Symmetry:
    """Move the particles alone: those that leave come back as images."""
    box, s = built.box, built.state
    by = np.where(box.periodic, [1.5, 2.25, 0.625][: built.model.dimension], 0.0)
    x_nc = s.x_nc + by
    x_nc = x_nc - np.where(x_nc > box.high_c, np.array(box.edge_c), 0.0)
    assert np.abs(x_nc - s.x_nc - by).max() > 1
    return Symmetry(built.with_state(x_nc=x_nc))


def turned(built: Scene, R_xy: list[list[int]]) -> Symmetry:
    """Turn about the z axis, or mirror: vectors follow as R v, tensors as R G R^T."""
    dimension, s, box = built.model.dimension, built.state, built.box
    R = np.eye(dimension)
    R[:2, :2] = R_xy
    corners = np.array([box.low_c, box.high_c]) @ R.T
    periodic = tuple(bool(p) for p in (np.abs(R) @ np.array(box.periodic, float)) > 0)
    forces = []
    for force in built.model.forces:
        numbers = R @ np.array([0.0 if c is None else c for c in force.vector])
        free_c = np.abs(R) @ np.array([c is None for c in force.vector], float) > 0
        vector = tuple(None if none else float(c) for none, c in zip(free_c, numbers, strict=True))
        forces.append(Force(force.style, vector, force.types))
    box = Box(tuple(corners.min(axis=0)), tuple(corners.max(axis=0)), periodic)
    other = replace(built.with_model(forces=tuple(forces)), box=box).with_state(x_nc=s.x_nc @ R.T, v_nc=s.v_nc @ R.T)

    def of(field: str, a: Any) -> Any:
        rank = QUANTITIES[field].rank
        return a if not rank else a @ R.T if rank == 1 else np.einsum("ac,ncd,bd->nab", R, a, R)

    kept = np.ones((dimension, dimension))
    if R[0, 1]:  # W_xy is the sum of x f_y and pair forces are not central: turned it is that of y f_x
        kept[0, 1] = kept[1, 0] = 0.0
    return Symmetry(other, of, lambda field, a: kept * a if field == "stress/atom" else a)


def replicated(built: Scene) -> Symmetry:
    """Several images in a box shorter than two cutoffs equal the particles of a box twice as long."""
    box, edge = built.box, np.array(built.box.edge_c)
    assert any(p and e < 2 * built.model.cut for p, e in zip(box.periodic, edge, strict=True))
    copies = np.array(list(itertools.product(*[(0, 1) if p else (0,) for p in box.periodic])))
    many = arrays(built, lambda a: np.concatenate([a] * len(copies)))
    many["x_nc"] = np.concatenate([built.state.x_nc + c * edge for c in copies])
    high = tuple(float(h + (e if p else 0)) for h, e, p in zip(box.high_c, edge, box.periodic, strict=True))
    large = replace(built.with_state(**many), box=Box(box.low_c, high, box.periodic))
    return Symmetry(large, lambda field, a: np.concatenate([a] * len(copies)))


def leaning(built: Scene) -> Symmetry:
    """Edges that lean by whole edges make the same lattice of images."""
    box, x_nc = replace(built.box, periodic=(True,) * built.model.dimension), built.state.x_nc
    lx, ly = box.edge_c[:2]
    leans = replace(box, tilt=(2 * lx,) if built.model.dimension == 2 else (-lx, lx, ly))
    inside = built.with_state(x_nc=x_nc - leans.shift(leans.images(x_nc)))
    return Symmetry(replace(inside, box=leans), base=replace(built, box=box))


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


def enlarged(built: Scene) -> Symmetry:
    """Lengths times 3: rounding apart the same physics (the power law's exponents included, gd0 being a rate).

    Parameters that do not scale exactly (size**n K, gd0/size) bring a few roundings of their own: one more bound.
    """
    scale = {field: 3.0 ** power_of(field, built.model.dimension) for field in bounded(built)}
    return Symmetry(rescaled(built, 3.0), lambda field, a: scale[field] * a, slack=2.0 * (1 + 1e-9))


SYMMETRIES: dict[str, Callable[[Scene], Symmetry]] = {
    "velocity of the frame": galilean,
    "labels": relabelled,
    "translation": translated,
    "translation of particles": wrapped,
    "quarter turn": lambda built: turned(built, [[0, -1], [1, 0]]),
    "mirror": lambda built: turned(built, [[-1, 0], [0, 1]]),
    "replication": replicated,
    "leaning edges": leaning,
    "size": enlarged,
}
# Left out of sizes: scale_cross_type (wmin has the dimension of W, rmin that of r W), the repulsion of walls in 2D (its
# formula is one of 3D), surfaces (1e-10 in the normal is absolute). Shifts depend on the frame, see below.
NOT_SCALING = ("cross", "cross, by distance", "coordination", "divergence")


def applies(symmetry: str, name: str, dimension: int) -> bool:
    if symmetry == "size":
        return name not in NOT_SCALING and (name, dimension) != ("droplet", 2)
    return symmetry != "velocity of the frame" or "shift" not in RECIPES[name]


CASES = [case for case in itertools.product(SYMMETRIES, RECIPES, (2, 3)) if applies(*case)]


@functools.cache
def of_recipe(name: str, dimension: int) -> dict[str, tuple[Any, Any]]:
    return bounded(recipe(name, dimension))


@pytest.mark.parametrize(("symmetry", "name", "dimension"), CASES)
def test_symmetry(symmetry: str, name: str, dimension: int) -> None:
    made = SYMMETRIES[symmetry](recipe(name, dimension))
    first = bounded(made.base) if made.base else of_recipe(name, dimension)
    found, expected = bounded(made.other), {q: (made.of(q, a), np.abs(made.of(q, b))) for q, (a, b) in first.items()}
    seen = [{q: (made.seen(q, a), made.seen(q, b)) for q, (a, b) in fields.items()} for fields in (found, expected)]
    assert_same(*seen, slack=made.slack)


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
    U = np.array(FRAME[:dimension])
    moved = bounded(built.with_state(v_nc=built.state.v_nc + U))["shift/v"][0]
    assert np.abs(moved - shift).max() > 0.1 * np.abs(shift).max()


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


# --- conservation

CONSERVING = ["quintic", "RK0", "gas", "rho/sum", "self/mass quintic", "droplet"]


def conserving(name: str, dimension: int) -> Scene:
    if name == "self/mass quintic":
        return recipe("self/mass", dimension, kernel="quintic")
    return recipe(name, dimension)


@DIMENSIONS
@pytest.mark.parametrize("name", CONSERVING)
def test_forces_and_heat_add_up_to_zero(name: str, dimension: int) -> None:
    """Quintic spline, no force from outside: also with walls that move, where all that acts is mutual."""
    built = conserving(name, dimension)
    found, compiled = bounded(built), built.simulate(evaluator=CompiledEvaluator)
    compiled.evaluate()
    for field in {"f", "heatflow"} & found.keys():
        for values in (found[field][0], results(compiled)[field]):
            total = np.abs(values.sum(axis=0))
            allowed = found[field][1].sum(axis=0) + len(values) * EPS * np.abs(values).sum(axis=0)
            assert (total <= allowed).all()
            assert (allowed < 1e-9 * np.abs(values).sum(axis=0)).all()


@DIMENSIONS
def test_corrected_kernels_do_not_conserve(dimension: int) -> None:
    """The tolerance above is sensitive."""
    values = bounded(recipe("RK1", dimension))["f"][0]
    assert np.abs(values.sum(axis=0)).max() > 1e-6 * np.abs(values).sum()


@DIMENSIONS
def test_density_diffusion_conserves_volume_weighted_mass(dimension: int) -> None:
    """Order 0: V_i drho_i sums to zero, as the pair term is antisymmetric once weighted."""
    built = recipe("quintic", dimension)
    values, errors = bounded(built)["drho"]
    volume_n = built.model.mass[built.state.type_n - 1] / built.state.rho_n
    allowed = (volume_n * errors).sum() + (len(values) + 3) * EPS * np.abs(volume_n * values).sum()
    assert abs((volume_n * values).sum()) <= allowed < 1e-9 * np.abs(volume_n * values).sum()


@DIMENSIONS
@pytest.mark.parametrize("name", ["quintic", "gas"])
def test_momentum_and_energy_over_steps(name: str, dimension: int) -> None:
    """Twenty steps: momentum and heat stay within the roundings of twenty times two additions of an impulse.

    The impulse of a step has the forces' own bound (taken of the first evaluation, four times it for later ones).
    """
    built = recipe(name, dimension)
    dt, steps = 2.0**-9, 20
    errors = bounded(built)
    simulation = built.simulate([])
    mass = simulation.mass_n[:, None]
    before = (mass * simulation.state.v_nc).sum(axis=0)
    energy = None if simulation.state.energy_n is None else simulation.state.energy_n.sum()
    simulation.run(steps, dt)
    s = simulation.state
    allowed = 4 * steps * (dt * errors["f"][1].sum(axis=0) + 4 * EPS * np.abs(mass * s.v_nc).sum(axis=0))
    assert (np.abs((mass * s.v_nc).sum(axis=0) - before) <= allowed).all()
    assert (allowed < 1e-9).all()
    assert np.abs(s.v_nc - built.state.v_nc).max() > 1e-3, "something has happened"
    if energy is not None:
        allowed = 4 * steps * (dt * errors["heatflow"][1].sum() + 4 * EPS * np.abs(s.energy_n).sum())
        assert abs(s.energy_n.sum() - energy) <= allowed < 1e-9
        assert np.abs(s.energy_n - built.state.energy_n).max() > 1e-3


# --- consistency of kernels

CORRECTING = [style for style, kernel in KERNELS.items() if kernel.corrects_gradients]
OPEN = {2: ((False, True), 3.0), 3: ((False, True, False), 3.0)}


def free(dimension: int, kernel: str, zmin: int = 0, cut: float = 3.25) -> Scene:
    """A disordered block with free surfaces."""
    periodic, margin = OPEN[dimension]
    return scene(dimension, kernel=kernel, zmin=zmin, cut=cut, periodic=periodic, margin=margin)


def polynomial(x_nc: Any, order: int, random: Any) -> tuple[Any, Any]:
    """A polynomial of an order at the points, and its gradient."""
    d = x_nc.shape[1]
    a, B = dyadic(random.uniform(-1, 1, d)), dyadic(random.uniform(-1, 1, (d, d))) * (order == 2)
    return 0.5 + x_nc @ a + np.einsum("na,ab,nb->n", x_nc, B, x_nc), a + x_nc @ (B + B.T)


@DIMENSIONS
@pytest.mark.parametrize(
    ("kernel", "order"), [(style, order) for style in CORRECTING for order in range(1, KERNELS[style].order + 1)]
)
def test_gradients_are_exact(dimension: int, kernel: str, order: int) -> None:
    """Of every polynomial up to the order, up to a free surface and at its corners.

    The field is made periodic nowhere: every axis is open.
    """
    cells = (6, 5) if dimension == 2 else (3, 4, 3)  # two layers could not carry a quadratic field
    built = scene(dimension, cells=cells, kernel=kernel, cut=3.25, periodic=(False,) * dimension, margin=1.0)
    x_nc = built.state.x_nc
    f_n, true_nc = polynomial(x_nc, order, np.random.default_rng(5))
    evaluator = built.simulate().evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(Rounded(x_nc))
    evaluator.correct(Rounded(built.state.rho_n))
    assert evaluator.corrected_n.all()
    assert value(evaluator.coordination_n).min() < 0.8 * value(evaluator.coordination_n).max(), "the surface is reached"
    field = Rounded(f_n, 8 * EPS * (0.5 + np.abs(x_nc).sum(axis=1) ** 2))  # its own evaluation
    found = evaluator.gradients(
        replace(built.state, rho_n=Rounded(built.state.rho_n), energy_n=field), want=["energy"]
    ).energy_nc
    compiled = built.simulate(evaluator=CompiledEvaluator).evaluator
    compiled.move(x_nc)
    compiled.correct(built.state.rho_n)
    other = compiled.gradients(replace(built.state, energy_n=f_n), want=["energy"]).energy_nc
    for gradient_nc in (value(found), other):
        assert (np.abs(gradient_nc - true_nc) <= error(found) + 8 * EPS * (1 + np.abs(x_nc)).sum()).all()
    assert error(found).max() < 1e-5  # at the corners moments of RK2 are nearly singular


@DIMENSIONS
def test_lower_kernels_are_not_exact(dimension: int) -> None:
    """The test above is sensitive: RK1 misses quadratic fields, the quintic spline even linear ones."""
    kinds = (ArrayEvaluator, CompiledEvaluator)
    for evaluator_of, (kernel, order) in itertools.product(kinds, (("RK1", 2), ("quintic", 1), ("RK0", 1))):
        built = scene(dimension, kernel=kernel, cut=3.25, periodic=(False,) * dimension, margin=1.0)
        f_n, true_nc = polynomial(built.state.x_nc, order, np.random.default_rng(5))
        evaluator = built.simulate(evaluator=evaluator_of).evaluator
        evaluator.move(built.state.x_nc)
        evaluator.correct(built.state.rho_n)
        found = evaluator.gradients(replace(built.state, energy_n=f_n), want=["energy"]).energy_nc
        assert np.abs(found - true_nc).max() > 1e-3


@DIMENSIONS
@pytest.mark.parametrize("kernel", CORRECTING)
def test_sums_of_corrected_gradients(kernel: str, dimension: int) -> None:
    r"""sum V gradW = 0 and sum V x(x)gradW = -1, on every particle, the surface's included."""
    built = free(dimension, kernel)
    evaluator = built.simulate().evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(Rounded(built.state.x_nc))
    evaluator.correct(Rounded(built.state.rho_n))
    assert evaluator.corrected_n.all()
    volume = evaluator.mass_n[evaluator.j] / Rounded(built.state.rho_n)[evaluator.j]
    for b in range(dimension):
        zero = evaluator.total(volume * evaluator.g[b])
        assert (np.abs(value(zero)) <= error(zero)).all()
        assert error(zero).max() < 1e-5  # RK2 at the surface
        for a in range(dimension):
            minus = evaluator.total(volume * evaluator.x[a] * evaluator.g[b])
            assert (np.abs(value(minus) + (a == b)) <= error(minus)).all()


@DIMENSIONS
def test_zmin_decides_for_each_side(dimension: int) -> None:
    """A particle below zmin keeps the plain gradient, independent of its neighbours."""
    count = free(dimension, "RK1").simulate(["coordination"]).evaluate()["coordination"]
    zmin = int(np.median(count))
    built = free(dimension, "RK1", zmin)
    evaluator = built.simulate().evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(built.state.x_nc)
    evaluator.correct(built.state.rho_n)
    assert np.array_equal(evaluator.corrected_n, count >= zmin)
    assert 0 < evaluator.corrected_n.sum() < len(count)
    plain = np.array(evaluator.gradw) == np.array(evaluator.g)
    used_p = evaluator.corrected_n[evaluator.i]
    assert plain[:, ~used_p].all()
    assert not plain[:, used_p].all(axis=0).any()


@DIMENSIONS
def test_too_few_neighbours_for_a_matrix(dimension: int) -> None:
    """A pair alone has no moment matrix: it falls back to the spline, without any NaN."""
    built = scene(dimension, kernel="RK2", periodic=(False,) * dimension, margin=9.0)
    s = built.state
    two = built.with_state(**{k: getattr(s, k)[:2] for k in ("x_nc", "v_nc", "rho_n", "type_n", "solid_n")})
    simulation = two.simulate()
    assert np.isfinite(simulation.evaluate()["f"]).all()
    evaluator = simulation.evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    assert not evaluator.corrected_n.any()
    assert np.array_equal(evaluator.g, evaluator.gradw)


# --- walls and surfaces


@DIMENSIONS
@pytest.mark.parametrize("kernel", ["quintic", "RK1", "RK2"])
def test_rigid_motion_has_no_friction(kernel: str, dimension: int) -> None:
    """Fluid and reconstructed wall with one velocity: no gradient, no viscous force, no artificial viscosity."""
    base = scene(dimension, walls=True, kernel=kernel)
    U = np.array([4.0, -3.0, 2.5])[:dimension]
    moving = base.with_state(v_nc=np.broadcast_to(U, base.state.v_nc.shape).copy())
    frictionless = moving.with_model(viscosity=tuple(replace(v, eta=0.0) for v in base.model.viscosity))
    sticky = moving.with_model(pair=replace(base.model.pair, artificial_viscosity=0.75))
    found = moving.simulate()
    found.evaluate()
    assert not found.fields["grad/v"].any()
    for other in (frictionless, sticky):
        simulation = other.simulate()
        simulation.evaluate()
        assert np.array_equal(simulation.fields["f"], found.fields["f"])
    slipping = base.simulate()
    slipping.evaluate()
    assert np.abs(slipping.fields["grad/v"]).max() > 0.1


@pytest.mark.parametrize("style", ["coordination", "divergence"])
def test_surfaces_of_a_half_filled_box(style: str) -> None:
    """Block with a free surface above and below: layers near it are surface, the middle bulk, one splash."""
    from eos_ref.syntax.fixes import SurfaceDetection

    limit = 22 if style == "coordination" else 1.75
    surface = SurfaceDetection(style, limit, 3)
    built = scene(
        2, cells=(8, 9), disorder=0.05, periodic=(True, False), margin=0.0, surface=surface, cut=3.0, one_type=True
    )
    s = built.state
    rho_n = np.full_like(s.rho_n, 1.3125)  # mass over unit spacing: divr is then near 2 inside
    built = replace(built.with_state(rho_n=rho_n), box=Box((0.0, -4.0), (8.0, 20.0), (True, False)))
    lone = built.state.x_nc.copy()
    lone[0] = (0.5, 18.0)
    built = built.with_state(x_nc=lone)
    simulation = built.simulate()
    found = simulation.evaluate()
    y_n, class_n = built.state.x_nc[:, 1], found["surface"]
    assert class_n[0] == 2
    inside = (y_n > 3.1) & (y_n < 5.9)
    assert not class_n[inside].any()
    edge = ((y_n < 1) | (y_n > 8)) & (np.arange(len(y_n)) > 0)
    assert (class_n[edge] == 1).all()
    assert (np.abs(found["surface/divr"][inside] - 2) < 0.1).all()
    normal = found["surface/n"][edge]
    assert (np.abs(np.hypot(*normal.T) - 1) < 1e-8).all()  # the softening 1e-10 over |grad C| > 0.01
    assert (normal[:, 1] * np.sign(y_n[edge] - 4.5) > 0.5).all()  # also next to the hole that the lone particle left
    assert not found["surface/n"][class_n != 1].any()
    assert (found["surface/r"][class_n > 0] == 0).all()
    at = built.state.x_nc[class_n == 1]
    for k in np.flatnonzero(class_n == 0):
        apart = at - built.state.x_nc[k]
        apart[:, 0] -= 8 * np.round(apart[:, 0] / 8)
        nearest = min(3.0, np.sqrt((apart**2).sum(axis=1)).min())
        assert abs(found["surface/r"][k] - nearest) <= 8 * EPS * 3
    status_n = simulation.output("status")
    layer = (class_n == 0) & (found["surface/r"] < 3)
    assert np.array_equal(status_n, np.select([class_n == 2, class_n == 1, layer], [32, 16, 8], 4))
