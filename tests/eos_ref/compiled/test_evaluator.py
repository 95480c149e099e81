"""`CompiledEvaluator` against the double loop of the tests; exactness and conservation, whatever the formulas."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import functools
import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.compiled.neighbours import WINDOW
from eos_ref.errors import InputError
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model.box import Box
from eos_ref.model.state import Gradients, State
from eos_ref.numbers import elementary
from eos_ref.numbers.rounded import error, value
from tests.support.double_loop import DoubleLoop
from tests.support.particle_scenes import EPS, RECIPES, Scene, dyadic, recipe, results, scene

pytestmark = pytest.mark.slow

THREE = functools.partial(CompiledEvaluator, threads=3)


ROOT = Path(__file__).parents[3]


def history(built: Scene) -> Any:
    """Accelerations as if left by a step: they reach Adami's g and a."""
    return np.random.default_rng(3).uniform(-1, 1, built.state.x_nc.shape)


def evaluated(built: Scene, evaluator: Any = CompiledEvaluator) -> dict[str, Any]:
    """All fields of the first evaluation of a scene."""
    simulation = built.simulate(evaluator=evaluator)
    simulation.other_nc = history(built)
    simulation.evaluate()
    return results(simulation)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", RECIPES)
def test_every_field_of_an_evaluation(name: str, dimension: int) -> None:
    """Within the rounding bound of the plain evaluator, whose terms are the same."""
    built = recipe(name, dimension)
    double = DoubleLoop(built)
    double.other = [[np.longdouble(c) for c in row] for row in history(built)]
    expected = double.evaluate()
    simulation = built.simulate()
    simulation.other_nc = history(built)
    bound = results(simulation.rounded())
    for evaluator in (CompiledEvaluator, THREE):
        found = evaluated(built, evaluator)
        assert found.keys() == expected.keys()
        for field, values in found.items():
            true = np.array(expected[field], np.longdouble)
            wrong = np.abs(values - true) - error(bound[field])
            assert (wrong <= 0).all(), f"{field}: {np.abs(values - true).max()} > {error(bound[field]).max()}"


@pytest.mark.parametrize("kernel", ["quintic", "RK1", "RK2"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_only_requested_gradients_are_computed(kernel: str, dimension: int) -> None:
    built = scene(dimension, kernel=kernel)
    for evaluator in (built.simulate().evaluator, built.simulate(evaluator=CompiledEvaluator).evaluator):
        evaluator.move(built.state.x_nc)
        evaluator.correct(built.state.rho_n)
        found = evaluator.gradients(replace(built.state, energy_n=built.state.rho_n**2), want=("energy",))
        assert found.v_ncc is found.rho_nc is None and found.energy_nc.shape == built.state.x_nc.shape
        assert evaluator.gradients(built.state, want=()) == Gradients()


def assert_close(found: Any, expected: Any) -> None:
    """Equal up to some thousand roundings of the largest value."""
    assert np.abs(found - expected).max() <= 4096 * EPS * np.abs(expected).max()


# --- the list and the order of particles leave no trace


@pytest.mark.parametrize("name", ["walls, RK1", "divergence", "walls, thermal"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_reused_list_gives_the_same_bits(name: str, dimension: int) -> None:
    built = recipe(name, dimension)
    reused = built.simulate(evaluator=functools.partial(CompiledEvaluator, skin=0.5))
    step_nc = dyadic(np.random.default_rng(5).uniform(-0.03, 0.03, built.state.x_nc.shape))
    for _ in range(4):
        reused.evaluate()
        reused.state.x_nc = reused.state.x_nc + step_nc
        reused.state.rho_n = built.state.rho_n.copy()
    fresh = built.with_state(x_nc=reused.state.x_nc).simulate(evaluator=CompiledEvaluator)
    reused.evaluate()
    fresh.evaluate()
    assert isinstance(reused.evaluator, CompiledEvaluator)
    assert reused.evaluator.neighbours.built == 1
    old, new = results(reused), results(fresh)
    for field in new:
        assert np.array_equal(old[field], new[field]), field


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_box_may_change(dimension: int) -> None:
    """`Simulation.remap` leaves nothing of the old box in the list."""
    built = recipe("divergence", dimension)
    wider = replace(
        built.box,
        high_c=tuple(low + 1.25 * (high - low) for low, high in zip(built.box.low_c, built.box.high_c, strict=True)),
    )
    first = built.simulate(evaluator=CompiledEvaluator)
    first.evaluate()
    first.remap(wider)
    first.evaluate()
    second = replace(built, box=wider).with_state(x_nc=first.state.x_nc).simulate(evaluator=CompiledEvaluator)
    second.evaluate()
    for field, values in results(second).items():
        assert np.array_equal(results(first)[field], values), field


def test_phases_may_change() -> None:
    """Setting ``solid_n`` is equivalent to an evaluator made with it."""
    built = recipe("walls, RK1", 2)
    first = built.simulate(evaluator=CompiledEvaluator)
    first.evaluate()
    frozen_n = built.state.solid_n ^ (np.arange(len(built.state.solid_n)) % 3 == 0)
    first.state.solid_n = first.evaluator.solid_n = frozen_n
    first.state.rho_n = built.state.rho_n.copy()
    first.evaluate()
    second = built.with_state(solid_n=frozen_n).simulate(evaluator=CompiledEvaluator)
    second.evaluate()
    for field, values in results(second).items():
        assert np.array_equal(results(first)[field], values), field


def test_same_bits_in_every_process() -> None:
    code = "from tests.eos_ref.compiled.test_evaluator import fingerprint as f; print(f(), f())"
    command = [sys.executable, "-c", code]
    runs = [
        subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout.split() for _ in range(2)
    ]
    assert len({fingerprint(), *runs[0], *runs[1]}) == 1


def fingerprint() -> str:
    """Digest of the bits of all fields of a few scenes, one of them in an internal order."""
    digest = hashlib.sha256()
    for built in (recipe("walls, RK2", 2), recipe("cross", 3), large(shuffled=True)):
        for evaluator in (CompiledEvaluator, THREE):
            for values in evaluated(built, evaluator).values():
                digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def large(shuffled: bool) -> Scene:
    """A scene with enough particles to get an internal order."""
    built = scene(2, cells=(72, 60), kernel="RK1", walls=True, artificial=0.5, shift=recipe("cross", 2).model.fix.shift)
    if not shuffled:
        return built
    s, order_n = built.state, np.random.default_rng(6).permutation(len(built.state.x_nc))
    fields = {k: getattr(s, k)[order_n] for k in ("x_nc", "v_nc", "rho_n", "type_n", "solid_n")}
    return built.with_state(**fields)


def test_threads_share_the_pairs() -> None:
    """Every pair belongs to one thread, each has about as many, and particles without pairs are no obstacle."""
    built = large(shuffled=False)
    evaluator = THREE(built.model, built.box, built.state.type_n, built.state.solid_n)
    whole = CompiledEvaluator(built.model, built.box, built.state.type_n, built.state.solid_n)
    for e in (evaluator, whole):
        e.move(built.state.x_nc)
    counts = [np.diff(pairs.start_n.astype(int)) for pairs in evaluator.parts]
    assert np.array_equal(sum(counts), np.diff(whole.parts[0].start_n.astype(int)))
    assert all(0.3 < count_n.sum() / sum(counts).sum() < 0.36 for count_n in counts)
    lone = THREE(built.model, Box((0.0, 0.0), (99.0, 99.0), (False, False)), np.ones(2, int), np.zeros(2, bool))
    lone.move(np.array([[1.0, 1.0], [50.0, 50.0]]))
    assert value(lone.coordination_n).tolist() == [0, 0]


@pytest.mark.parametrize("threads", [0, -1, 1.5, "two"])
def test_number_of_threads_is_refused(threads: Any) -> None:
    built = recipe("cross", 2)
    with pytest.raises(InputError, match="threads: must be a whole number, at least 1"):
        CompiledEvaluator(built.model, built.box, built.state.type_n, built.state.solid_n, threads=threads)


def test_tilted_box_is_refused() -> None:
    built = scene()
    tilted = replace(built, box=replace(built.box, tilt=(0.5,)))
    with pytest.raises(InputError, match="tilt of the box: must be 0 for compiled sums: take ArrayEvaluator"):
        tilted.simulate(evaluator=CompiledEvaluator)


def test_relabelling() -> None:
    """Shuffled particles, which get an internal order, and ordered ones, which do not."""
    order_n = np.random.default_rng(6).permutation(72 * 60)
    assert len(order_n) > WINDOW
    plain, shuffled = large(shuffled=False), large(shuffled=True)
    simulations = [s.simulate(evaluator=CompiledEvaluator) for s in (plain, shuffled)]
    expected, found = (results(s) for s in simulations if s.evaluate() is not None)
    evaluators = [s.evaluator for s in simulations if isinstance(s.evaluator, CompiledEvaluator)]
    assert [e.neighbours.order_n is None for e in evaluators] == [True, False]
    assert np.array_equal(found["coordination"], expected["coordination"][order_n])
    for field, values in expected.items():
        assert_close(found[field], values[order_n])


@pytest.mark.parametrize("name", ["walls, RK2", "cross", "gas"])
def test_translation_by_whole_boxes_and_by_any_image(name: str) -> None:
    """All particles moved keep their bits, wherever the box is; single ones in other images too, as no sum rounds."""
    built = recipe(name, 2)
    expected = evaluated(built)
    edge_c = np.array(built.box.edge_c)
    images = np.random.default_rng(7).integers(-4, 5, built.state.x_nc.shape)
    for shift_nc in (3 * edge_c, np.array([0.625, -7.25]), images * edge_c):
        found = evaluated_at(built, built.state.x_nc + shift_nc)
        for field, values in expected.items():
            assert_close(found[field], values)
            if shift_nc.ndim == 1:
                assert np.array_equal(found[field], values), field


def evaluated_at(built: Scene, x_nc: Any) -> dict[str, Any]:
    """All fields at positions that need not lie in the box."""
    simulation = built.simulate(evaluator=CompiledEvaluator)
    simulation.other_nc = history(built)
    simulation.state.x_nc = x_nc
    simulation.evaluate()
    return results(simulation)


# --- what reproducing kernels reproduce


@pytest.mark.parametrize(("kernel", "degree"), [("RK1", 1), ("RK2", 2)])
@pytest.mark.parametrize("dimension", [2, 3])
def test_polynomials_have_their_gradients(kernel: str, degree: int, dimension: int) -> None:
    """Exact up to the degree, at the edge of a block in the open as well; one degree more is not."""
    built = scene(dimension, kernel=kernel, cells=(7, 6) if dimension == 2 else (5, 4, 5), cut=3.25)
    built = Scene(built.model, Box((-4.0,) * dimension, (20.0,) * dimension, (False,) * dimension), built.state)
    x_nc, n = built.state.x_nc, len(built.state.x_nc)
    evaluator = CompiledEvaluator(built.model, built.box, built.state.type_n, built.state.solid_n)
    evaluator.move(x_nc)
    evaluator.correct(built.state.rho_n)
    assert evaluator.corrected_n.all()
    for power in range(1, degree + 2):
        slope_cc = np.random.default_rng(8).uniform(-1, 1, (dimension, dimension))
        linear_nc = x_nc @ slope_cc.T / 8
        v_nc = linear_nc**power
        true_ncc = power * linear_nc[:, :, None] ** (power - 1) * slope_cc[None] / 8
        G_ncc = evaluator.gradients(replace(built.state, v_nc=v_nc), want=("v",)).v_ncc
        assert G_ncc.shape == (n, dimension, dimension)
        difference = np.abs(G_ncc - true_ncc).max()
        # The condition of the moment matrices stands before the roundings.
        assert difference < 1e-10 if power <= degree else difference > 1e-4


@pytest.mark.parametrize("kernel", ["RK1", "RK2"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_consistency_of_the_gradients_stored(kernel: str, dimension: int) -> None:
    r"""Both :math:`\sum_jV_j\widetilde\nabla W=0` and :math:`\sum_jV_j\mathbf x\otimes\widetilde\nabla W=-1`."""
    built = scene(dimension, kernel=kernel)
    s, evaluator = built.state, built.simulate(evaluator=CompiledEvaluator).evaluator
    assert isinstance(evaluator, CompiledEvaluator)
    evaluator.move(s.x_nc)
    evaluator.correct(s.rho_n)
    (pairs,), n = evaluator.parts, len(s.x_nc)
    size = int(pairs.start_n[n])
    i, j = np.repeat(np.arange(n), np.diff(pairs.start_n.astype(int))), pairs.j_p[:size].astype(int)
    x_pc, V_n = pairs.x_pc[:size], evaluator.mass_n / s.rho_n
    zero_nc, minus_one_ncc = np.zeros((n, dimension)), np.zeros((n, dimension, dimension))
    for k, other, g_pc, apart_pc in ((i, j, pairs.gi_pc[:size], x_pc), (j, i, pairs.gj_pc[:size], -x_pc)):
        weighted = V_n[other][:, None] * g_pc
        np.add.at(zero_nc, k, weighted)
        np.add.at(minus_one_ncc, k, apart_pc[:, :, None] * weighted[:, None, :])
    # Sums of terms of size 1 or less, rounded times the condition of the matrices, some hundred.
    assert np.abs(zero_nc).max() < 1e-11
    assert np.abs(minus_one_ncc + np.eye(dimension)).max() < 1e-11


def test_matrix_without_a_factor_falls_back_to_the_spline() -> None:
    """Particles on a line have no gradient across it: RK1 gives up on them, one by one."""
    built = scene(2, kernel="RK1", one_type=True)
    x_nc = np.column_stack([np.arange(8) + 0.25, np.full(8, 2.0)])
    x_nc[7] = [3.5, 4.0]  # a neighbour of the middle of the line
    box = Box((-9.0, -9.0), (19.0, 19.0), (False, False))
    evaluator = CompiledEvaluator(built.model, box, np.ones(8, int), np.zeros(8, bool))
    evaluator.move(x_nc)
    evaluator.correct(np.ones(8))
    assert not evaluator.corrected_n[[0, 6]].any()
    assert evaluator.corrected_n[[2, 3, 4]].all()
    state = State(x_nc, x_nc, np.ones(8), np.ones(8, int), np.zeros(8, bool))
    G_ncc = evaluator.gradients(state, want=("v",)).v_ncc
    plain = CompiledEvaluator(scene(2, one_type=True).model, box, np.ones(8, int), np.zeros(8, bool))
    plain.move(x_nc)
    assert np.array_equal(G_ncc[[0, 6]], plain.gradients(state, want=("v",)).v_ncc[[0, 6]])


# --- conservation


@pytest.mark.parametrize("dimension", [2, 3])
def test_momentum_and_energy_are_conserved(dimension: int) -> None:
    """Pair terms are antisymmetric: sums vanish up to the roundings of adding them."""
    built = recipe("gas", dimension)
    found = evaluated(built)
    n = len(built.state.x_nc)
    for field in ("f", "heatflow"):
        size = np.abs(found[field]).sum()
        assert np.abs(found[field].sum(axis=0)).max() <= 64 * n * EPS * size
        assert size > 1
    moving = built.with_state(v_nc=built.state.v_nc + 0.5)
    assert_close(evaluated(moving)["f"], found["f"])


# --- compiled counterparts of the elementary functions


@numba.njit(error_model="numpy")
def _chosen(a: float, b: float) -> tuple[float, float, float]:
    return elementary.maximum(a, b), elementary.minimum(a, b), elementary.where(a > b, a, b)


@pytest.mark.parametrize("a", [0.0, 1.5, -2.0, np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("b", [0.0, 1.5, -3.0, np.nan])
def test_compiled_choices_are_those_of_numpy(a: float, b: float) -> None:
    expected = elementary.maximum(a, b), elementary.minimum(a, b), elementary.where(a > b, a, b)
    assert np.array_equal(_chosen(a, b), expected, equal_nan=True)


def test_pairs_at_the_cutoff_do_not_count() -> None:
    """r < cut strictly, also where the square of the cutoff rounds."""
    for cut in (3.0, 0.3, 0.7, 1.1, 2.2):
        built = scene(2, cut=cut, one_type=True)
        box = Box((-9.0, -9.0), (9.0, 9.0), (False, False))
        for r in (cut, np.nextafter(cut, 0.0), np.nextafter(cut, 9.0)):
            evaluator = CompiledEvaluator(built.model, box, np.ones(2, int), np.zeros(2, bool))
            evaluator.move(np.array([[0.0, 0.0], [0.0, r]]))
            assert value(evaluator.coordination_n).tolist() == [int(r < cut)] * 2
            w0 = QUINTIC.self_value(2, cut)
            assert_close(evaluator.density_sum(), np.full(2, evaluator.mass_n[0] * w0))
