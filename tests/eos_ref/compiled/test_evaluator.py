"""`CompiledEvaluator`: the list and the order of particles leave no trace; reproducing kernels; conservation."""

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

from eos_ref.compiled import corrections
from eos_ref.compiled.evaluator import LANES, CompiledEvaluator
from eos_ref.compiled.neighbours import WINDOW
from eos_ref.compiled.vectors import graded
from eos_ref.errors import InputError
from eos_ref.kernels import reproducing
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model.box import Box
from eos_ref.model.state import Gradients, State
from eos_ref.numbers import elementary
from eos_ref.numbers.rounded import value
from tests.support.particle_scenes import EPS, Scene, dyadic, recipe, results, scene

pytestmark = pytest.mark.slow


# --- coefficients


@pytest.mark.parametrize(("order", "dimension"), [(1, 2), (1, 3), (2, 2), (2, 3)])
def test_basis_is_that_of_the_arrays(order: int, dimension: int) -> None:
    """Every basis function, and every product of two, at a point: as a factor times a monomial."""
    basis = corrections.Basis(order, dimension)
    u = [0.5, -0.25, 0.75][:dimension]
    monomial = np.array([np.prod([u[a] for a in axes]) for axes in graded(dimension, 2 * order)])
    h = np.array(reproducing.basis(order, u))
    assert basis.moments == len(monomial)
    assert np.array_equal(basis.factor_b * monomial[basis.place_b], h)
    assert np.array_equal(np.outer(basis.factor_b, basis.factor_b) * monomial[basis.index_bb], np.outer(h, h))


@pytest.mark.parametrize("particles", [3, 8, 11])
def test_coefficients_are_columns_of_the_inverse(particles: int) -> None:
    """Of RK1 in 2D, for fewer particles than lanes, as many, and more; a matrix without a factor is left out."""
    basis, random = corrections.Basis(1, 2), np.random.default_rng(2)
    u_nkc = random.uniform(-1, 1, (particles, 9, 2))
    axes = graded(2, 2)
    moment_nm = np.stack([np.prod(u_nkc[..., list(a)], axis=-1).mean(axis=1) for a in axes], axis=1)
    moment_nm[1] = -moment_nm[1]
    corrected_n = np.ones(particles, bool)
    corrected_n[0] = False  # below zmin
    out_nf = np.zeros((particles, 6))
    tables = basis.index_bb, basis.place_b, basis.factor_b
    corrections.coefficients(moment_nm, *tables, -2.0, corrected_n, LANES, out_nf)
    assert np.array_equal(corrected_n, np.arange(particles) > 1)
    assert not out_nf[:2].any()
    for n in range(2, particles):
        matrix_bb = moment_nm[n][basis.index_bb]
        expected_bc = -2.0 * np.linalg.inv(matrix_bb)[:, 1:]
        # Columns of a Cholesky solution and of an LU inverse: (3 b + 1) b and 4 b^2 times b roundings of condition
        # number times U (Higham, Accuracy and Stability of Numerical Algorithms, theorems 10.4 and 9.4), b = 3.
        bound_c = (30 + 36 * 3) * 3 * 2.0**-53 * np.linalg.cond(matrix_bb) * np.linalg.norm(expected_bc, axis=0)
        assert (np.abs(out_nf[n].reshape(3, 2) - expected_bc) <= bound_c).all()


# --- evaluations

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


def assert_same_bits(found: dict[str, Any], expected: dict[str, Any]) -> None:
    for field, values in expected.items():
        assert np.array_equal(found[field], values), field


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
    assert_same_bits(results(reused), results(fresh))


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
    assert_same_bits(results(first), results(second))


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
    assert_same_bits(results(first), results(second))


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
