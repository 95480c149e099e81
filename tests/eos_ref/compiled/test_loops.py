"""Compiled sums: vectors in registers, loops over pairs, forces."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from eos_ref.compiled import forces
from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.compiled.loops import Pairs
from eos_ref.compiled.vectors import (
    add_to,
    columns_times,
    dot,
    graded,
    joined,
    matrix_times,
    mirrored,
    monomials,
    outer,
    put,
    roots,
    row,
    vector,
    zero,
)
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.numbers.rounded import Rounded, error, value
from tests.support.particle_scenes import scene

pytestmark = pytest.mark.slow


# --- registers

ROOT = Path(__file__).parents[3]


def test_vectors_compile_with_typed_pointers_off() -> None:
    """The switch of llvmlite under which pointers are written without a type, read when it is imported."""
    code = (
        "import llvmlite\n"
        "from tests.eos_ref.compiled.test_loops import test_arithmetic, test_whole_numbers_and_tuples\n"
        "assert not llvmlite.ir_layer_typed_pointers_enabled\n"
        "test_arithmetic(9)\n"
        "test_whole_numbers_and_tuples(3)\n"
    )
    environment = {**os.environ, "LLVMLITE_ENABLE_IR_LAYER_TYPED_POINTERS": "0", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


# --- vectors

SIZES = [1, 2, 3, 4, 6, 8, 9, 15, 16, 35]


def made_rows(count: int, size: int) -> Any:
    return np.random.default_rng(size).uniform(0.5, 2.0, (count, size))


@numba.njit
def _arithmetic(a_nc: Any, like: Any, out_nc: Any) -> None:
    a, b = row(a_nc, 0, like), row(a_nc, 1, like)
    put(out_nc, 0, a + b)
    put(out_nc, 1, a - b)
    put(out_nc, 2, a * b)
    put(out_nc, 3, a / b)
    put(out_nc, 4, 3.0 * a)
    put(out_nc, 5, roots(a))
    put(out_nc, 6, zero(like))
    add_to(out_nc, 7, a)


@pytest.mark.parametrize("size", SIZES)
def test_arithmetic(size: int) -> None:
    """The bits of numpy, and nothing written outside a row."""
    a_nc, out_nc = made_rows(2, size), np.full((9, size), 7.0)
    _arithmetic(a_nc, (0.0,) * size, out_nc)
    a, b = a_nc
    seven = np.full(size, 7.0)
    assert np.array_equal(out_nc, [a + b, a - b, a * b, a / b, 3 * a, np.sqrt(a), 0 * a, seven + a, seven])


@numba.njit
def _whole_numbers(k_nc: Any, like: Any, out_nc: Any) -> None:
    put(out_nc, 0, row(k_nc, 1, like) * vector(like))


@pytest.mark.parametrize("size", [1, 2, 3])
def test_whole_numbers_and_tuples(size: int) -> None:
    k_nc, out_nc = np.arange(2 * size, dtype=np.int16).reshape(2, size) - 4, np.zeros((1, size))
    like = tuple(0.5 + k for k in range(size))
    _whole_numbers(k_nc, like, out_nc)
    assert np.array_equal(out_nc[0], k_nc[1] * like)


@numba.njit
def _products(
    a_nc: Any, b_nc: Any, m_nf: Any, likes: Any, dot_n: Any, outer_nf: Any, rows_nc: Any, columns_nc: Any, both_nf: Any
) -> None:
    like_a, like_b, like_m = likes
    a, b = row(a_nc, 0, like_a), row(b_nc, 0, like_b)
    dot_n[0] = dot(a, row(a_nc, 1, like_a))
    put(outer_nf, 0, outer(a, b))
    put(rows_nc, 0, matrix_times(row(m_nf, 0, like_m), b))
    put(columns_nc, 0, columns_times(row(m_nf, 0, like_m), b))
    put(both_nf, 0, joined(a, row(a_nc, 1, like_a)))


@pytest.mark.parametrize("size", [1, 2, 3, 4])
@pytest.mark.parametrize("other", [1, 2, 3, 6, 10])
def test_products(size: int, other: int) -> None:
    """Sums from the first term on; small whole numbers are exact."""
    a_nc, b_nc = np.rint(8 * made_rows(2, size)), np.rint(8 * made_rows(1, other))
    m_nf = np.rint(8 * made_rows(1, size * other))
    likes = tuple((0.0,) * k for k in (size, other, size * other))
    found = [np.zeros(1), *(np.zeros((1, k)) for k in (size * other, size, size, 2 * size))]
    _products(a_nc, b_nc, m_nf, likes, *found)
    assert found[0][0] == a_nc[0] @ a_nc[1]
    assert np.array_equal(found[1][0], np.outer(a_nc[0], b_nc[0]).ravel())
    assert np.array_equal(found[2][0], m_nf.reshape(size, other) @ b_nc[0])
    assert np.array_equal(found[3][0], m_nf.reshape(other, size).T @ b_nc[0])
    assert np.array_equal(found[4][0], a_nc.ravel())


@numba.njit
def _monomials(u_nc: Any, like: Any, like_m: Any, out_nm: Any) -> None:
    u = row(u_nc, 0, like)
    m = monomials(u, like_m)
    put(out_nm, 0, m)
    put(out_nm, 1, mirrored(m, u))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_monomials(dimension: int, degree: int) -> None:
    """All of them in graded order, exact for small whole numbers; those of -u change sign where the degree is odd."""
    axes = graded(dimension, degree)
    u_nc, out_nm = np.array([[3.0, -5.0, 7.0]])[:, :dimension].copy(), np.zeros((2, len(axes)))
    _monomials(u_nc, (0.0,) * dimension, (0.0,) * len(axes), out_nm)
    for found_m, u in zip(out_nm, (u_nc[0], -u_nc[0]), strict=True):
        assert found_m.tolist() == [np.prod(u[list(product)]) for product in axes]


# --- loops


def test_loops_import_the_compiled_elementary_functions() -> None:
    """In a fresh process, as cached code needs no compilation and other modules import them, too."""
    code = (
        "from eos_ref.compiled import loops\n"
        "from eos_ref.jit import inline\n"
        "from eos_ref.kernels.quintic import QUINTIC\n"
        "assert inline(QUINTIC.shape)(0.0) == 66.0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def flat(sums: Any) -> list[Any]:
    """Return the arrays of a result, which may be one, or tuples and lists of them."""
    return [array for part in sums for array in flat(part)] if isinstance(sums, tuple | list) else [sums]


@pytest.mark.parametrize("dimension", [2, 3])
def test_sums_are_those_of_the_arrays(dimension: int) -> None:
    """Each sum of its own, within the rounding bound of the array evaluator."""
    built = scene(dimension, walls=True)
    s = built.state
    plain, compiled = (
        kind(built.model, built.box, s.type_n, s.solid_n) for kind in (ArrayEvaluator, CompiledEvaluator)
    )
    plain.move(Rounded(s.x_nc))
    compiled.move(s.x_nc)
    assert np.array_equal(compiled.coordination_n, plain.coordination_n)
    random = np.random.default_rng(5)
    weight_n, a_nc = random.uniform(0.5, 1.5, compiled.n), random.uniform(-1, 1, s.x_nc.shape)
    arguments: dict[str, tuple[Any, ...]] = {
        "kernel_sum": (weight_n,),
        "wall_sums": (weight_n, s.rho_n, a_nc),
        "shift_sums": (weight_n, 0.25),
        "color_sums": (weight_n,),
        "surface_sums": (s.rho_n,),
        "nearest": (np.arange(compiled.n) % 5,),
    }
    for name, given in arguments.items():
        found, expected = (flat(getattr(evaluator, name)(*given)) for evaluator in (compiled, plain))
        assert len(found) == len(expected), name
        for sum_n, bounded_n in zip(found, expected, strict=True):
            assert np.any(sum_n != 0), name
            assert (np.abs(sum_n - value(bounded_n)) <= error(bounded_n)).all(), name


# --- forces

X_C, SLOPE = (0.375, -0.5), -0.75  # displacement x_i - x_j, and W'/r
LIKE = (0.0, 0.0)
U = 2.0**-53  # unit roundoff
ROUNDINGS = 16  # of a product of numbers given exactly: at most 8 operations on either side, each within U


def assert_products(actual: Any, expected: Any) -> None:
    """Check products of a few factors, which two orders of multiplication round by U each."""
    assert (np.abs(actual - np.asarray(expected)) <= ROUNDINGS * U * np.abs(expected)).all()


def two(terms: forces.Terms, *virials: np.ndarray, **fields: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return force (pressure, then the rest), density diffusion and heat flow of both particles."""
    pairs = Pairs(
        np.array([0, 1, 1], np.uint64),
        np.array([1], np.uint32),
        np.array([X_C]),
        np.array([0.5]),
        np.array([SLOPE]),
        None,
        None,
    )
    plain = dict.fromkeys(forces.Fields._fields) | {
        "volume_n": np.array([0.5, 0.75]),
        "v_nc": np.array([[1.0, 0.5], [-0.25, 0.25]]),
        "rho_n": np.array([1.25, 1.5]),
        "rho0_n": np.array([1.0, 1.125]),
        "pressure_n": np.array([2.0, 3.0]),
        "viscosity_n": np.array([0.25, 0.75]),
        "sound_n": np.array([10.0, 12.0]),
    }
    force_nf, drho_n, heat_n = np.zeros((2, 4)), np.zeros(2), np.zeros(2)
    given = forces.Fields(**(plain | fields))
    forces.pair_terms(pairs, given, terms, LIKE, LIKE * 2, force_nf, drho_n, heat_n, *virials)
    return force_nf, drho_n, heat_n


def test_pressure_and_viscosity() -> None:
    """-V_i V_j (P_i + P_j) grad W and 2 eta V_i V_j F v_ij, with F = W'/r; opposite on the partner."""
    force_nf, drho_n, heat_n = two(forces.Terms(0.0, 0.0, False, 0.5, 1.5))
    x_c, v_c = np.array(X_C), np.array([1.25, 0.25])
    assert_products(force_nf[0, :2], -(0.5 * 0.75) * 5.0 * SLOPE * x_c)
    assert_products(force_nf[0, 2:], 2 * 0.5 * (0.5 * 0.75) * SLOPE * v_c)
    assert np.array_equal(force_nf[1], -force_nf[0])
    assert not drho_n.any()
    assert not heat_n.any()


def test_harmonic_means() -> None:
    arithmetic, harmonic = (two(forces.Terms(0.0, 0.0, mean, 0.5, 1.5))[0] for mean in (False, True))
    assert np.array_equal(harmonic[:, :2], arithmetic[:, :2])
    assert_products(harmonic[:, 2:], arithmetic[:, 2:] * (2 * 0.25 * 0.75 / (0.25 + 0.75)) / 0.5)


def test_density_diffusion_acts_on_fluid_alone() -> None:
    """-2 xi V_j F [(rho_j - rho0_j) - (rho_i - rho0_i)]."""
    terms = forces.Terms(0.0, 0.125, False, 0.5, 1.5)
    drho_n = two(terms)[1]
    psi = (1.5 - 1.125) - (1.25 - 1.0)
    assert_products(drho_n, [-2 * 0.125 * 0.75 * psi * SLOPE, 2 * 0.125 * 0.5 * psi * SLOPE])
    assert not two(terms, solid_n=np.array([True, False]))[1].any()


def test_heat_flows_between_solids_too() -> None:
    """2 kappa V_i V_j F (T_i - T_j), the gain of one is the loss of the other; two solids have no force."""
    given = {"conductivity_n": np.array([0.5, 1.5]), "temperature_n": np.array([2.0, 5.0])}
    force_nf, _, heat_n = two(forces.Terms(0.0, 0.0, False, 0.5, 1.5), solid_n=np.array([True, True]), **given)
    flow = 2 * 1.0 * (0.5 * 0.75) * SLOPE * (2.0 - 5.0)
    assert_products(heat_n, [flow, -flow])
    assert not force_nf.any()


def test_wall_extrapolates_its_velocity_and_repels() -> None:
    """The fluid meets v_s + (v_s - v_f) k; within half a cutoff a deep solid adds (chi - 0.9)(rc/2 - r) rho0 c^2 rc."""
    walls = {"solid_n": np.array([True, False]), "rest_volume_n": np.ones(2), "chi_n": np.array([0.95, 0.75])}
    cut = 1.5
    force_nf, _, _ = two(forces.Terms(0.0, 0.0, False, 0.5, cut), **walls)
    ratio = (2 * cut * 0.45) / (2 * cut * 0.25)
    r = math.hypot(*X_C)
    repulsion = (0.95 - 0.9) * (cut / 2 - r) * 1.0 * 11.0**2 * cut / r
    viscous_c = 2 * 0.5 * (0.5 * 0.75) * SLOPE * (1 + ratio) * np.array([1.25, 0.25])
    repelled_c = repulsion * np.array(X_C)
    # The differences chi - 0.9 and rc/2 - r enlarge the errors of what is subtracted.
    lost = 1 + 0.9 / (0.95 - 0.9) + r / (cut / 2 - r)
    bound_c = ROUNDINGS * U * (np.abs(viscous_c) + lost * np.abs(repelled_c))
    assert (np.abs(force_nf[0, 2:] - (viscous_c + repelled_c)) <= bound_c).all()
    assert np.array_equal(force_nf[1], -force_nf[0])


def test_virials_of_both_particles() -> None:
    """Half of the distance times the force on either; without an array for them nothing else changes."""
    terms = forces.Terms(0.0, 0.0, False, 0.5, 1.5)
    virial_nf = np.zeros((2, 4))
    force_nf = two(terms)[0]
    assert np.array_equal(two(terms, virial_nf)[0], force_nf)
    sizes_nc = np.abs(force_nf[:, :2]) + np.abs(force_nf[:, 2:])
    for k, x_c in enumerate((np.array(X_C), -np.array(X_C))):
        virial = 0.5 * np.outer(x_c, force_nf[k, :2] + force_nf[k, 2:]).ravel()
        bound = ROUNDINGS * U * np.outer(np.abs(x_c), sizes_nc[k]).ravel()
        assert virial.any() and (np.abs(virial_nf[k] - virial) <= bound).all()
