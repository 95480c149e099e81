"""Compiled operations on `Rounded` arrays, and sums over pairs: the same bits as with arrays."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation import pair_loops, rounded_loops
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import separations
from eos_ref.numbers.rounded import Rounded, value
from tests.support.particle_scenes import scene

pytestmark = pytest.mark.slow
N = 1024
ODD = [0.0, -0.0, 1.0, -1.5, 5e-324, 1e-308, 1e300, np.inf, -np.inf, np.nan]


@pytest.fixture(autouse=True)
def loops_as_before() -> Iterator[None]:
    kept = Rounded.loops, ArrayEvaluator.loops
    yield
    Rounded.loops, ArrayEvaluator.loops = kept


def numbers(seed: int) -> Rounded:
    """Values and errors of every kind, in all combinations."""
    random = np.random.default_rng(seed)
    values = np.where(
        random.random(N) < 0.5, random.choice(ODD, N), random.normal(size=N) * 10.0 ** random.integers(-9, 9, N)
    )
    errors = np.where(random.random(N) < 0.5, random.choice([0.0, 1e-320, np.inf, np.nan], N), random.random(N) * 1e-9)
    return Rounded(values, errors)


def both(compute: Callable[[], Rounded]) -> tuple[Rounded, Rounded]:
    made = []
    for loops in (None, rounded_loops):
        Rounded.loops = loops
        with np.errstate(all="ignore"):
            made.append(compute())
    return made[0], made[1]


def same(one: Rounded, other: Rounded) -> None:
    for a, b in ((one.value, other.value), (one.error, other.error)):
        # The sign and the payload of a NaN mean nothing.
        assert np.where(np.isnan(a), 0, a).tobytes() == np.where(np.isnan(b), 0, b).tobytes()
        assert (np.isnan(a) == np.isnan(b)).all()


@pytest.mark.parametrize("name", ["add", "sub", "mul", "truediv"])
@pytest.mark.parametrize("other", ["array", "plain", "number", "itself"])
def test_operations_have_the_same_bits(name: str, other: str) -> None:
    a = numbers(1)
    b: Any = {"array": numbers(2), "plain": numbers(3).value, "number": 1.7, "itself": a}[other]
    same(*both(lambda: getattr(operator, name)(a, b)))
    same(*both(lambda: getattr(operator, name)(b, a)))


def test_arrays_are_left_to_the_loops_unless_one_is_broadcast() -> None:
    a = numbers(1)
    assert rounded_loops.operation("add", a, a) is not None
    assert rounded_loops.operation("add", a[:3], 1.5) is not None
    assert rounded_loops.operation("add", a, numbers(2).value[:1]) is None
    assert rounded_loops.operation("add", numbers(2)[:1], a) is None


@pytest.mark.parametrize("name", ["add", "sub", "mul", "truediv"])
def test_operations_with_broadcast_vectors_and_errors_have_the_same_bits(name: str) -> None:
    a, b = (Rounded(x.value.reshape(-1, 2), x.error.reshape(-1, 2)) for x in (numbers(1), numbers(2)))
    same(*both(lambda: getattr(operator, name)(a, b)))
    same(*both(lambda: getattr(operator, name)(a[:, 1], Rounded(b.value[:, 0], 1e-9))))


def test_sums_by_row_have_the_same_bits() -> None:
    random = np.random.default_rng(4)
    x, rows = Rounded(random.normal(size=N), random.random(N) * 1e-9), random.integers(0, 50, N)
    same(*both(lambda: x.sum_by(rows, 60)))


@pytest.mark.parametrize("rows", [1, N])
@pytest.mark.parametrize("dimension", [2, 3])
def test_pairs_within_the_cutoff_are_the_same(dimension: int, rows: int) -> None:
    random = np.random.default_rng(5)
    x_nc = random.random((40, dimension)) * 3
    i, j = (random.integers(0, 40, N).astype(np.int32) for _ in range(2))
    shift_pc = random.integers(-1, 2, (rows, dimension)) * 3.0 * (rows > 1)
    whole_pc = np.broadcast_to(shift_pc, (N, dimension))
    inside = separations(x_nc, i, j, whole_pc) < 1.0
    found = pair_loops.near(x_nc, i, j, shift_pc, 1.0)
    assert 0 < inside.sum() < N
    for one, other in zip(found, (i[inside], j[inside], whole_pc[inside]), strict=True):
        assert (one == other).all()


@pytest.mark.parametrize("in_order", [True, False])
def test_totals_have_the_bits_of_bincount(in_order: bool) -> None:
    """Whatever the order of the particles: each sum takes its terms in theirs."""
    random = np.random.default_rng(6)
    rows, terms = random.integers(0, 50, N), random.normal(size=N) * 10.0 ** random.integers(-9, 9, N)
    rows = np.sort(rows) if in_order else rows
    assert pair_loops.total(rows, terms, 60).tobytes() == np.bincount(rows, terms, 60).tobytes()
    assert not pair_loops.total(rows[:0], terms[:0], 3).any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_values_of_pairs_have_the_same_bits(dimension: int, monkeypatch: pytest.MonkeyPatch) -> None:
    built, found = scene(dimension), []
    for loops in (None, pair_loops):
        monkeypatch.setattr(ArrayEvaluator, "loops", loops)
        of = ArrayEvaluator(built.model, built.box, built.state.type_n, built.state.solid_n)
        of.move(built.state.x_nc)
        found.append(of)
    one, other = found
    assert len(one.i) > one.n
    for a, b in zip(*([of.i, of.j, of.shift_pc, *of.x, *of.gradw, of.rr, of.r, of.w] for of in found), strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(value(one.kernel_sum()), value(other.kernel_sum()))
