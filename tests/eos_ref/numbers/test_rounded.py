"""Errors of `Rounded` arrays cover rounding: single operations, expressions, sums, decisions, fields."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model import interactions
from eos_ref.numbers.elementary import maximum, minimum, sqrt, where
from eos_ref.numbers.rounded import ROUNDING, Decision, Rounded, error, exact_zero, placed, value
from eos_ref.syntax.fixes import SurfaceDetection
from tests.support.particle_scenes import RECIPES, Scene, bounded, recipe, results, scene

QUICK = settings(max_examples=150, deadline=None, derandomize=True)
U = 2.0**-53
number = st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-6)
positive = st.floats(1e-6, 1e6)
spread = st.floats(-1, 1)  # position of the true value inside its interval
relative = st.sampled_from([0.0, 1e-15, 1e-9, 1e-3, 0.5])


def inside(found: Rounded, true: Any, at: int = 0) -> bool:
    """Whether the truth lies within the error; exact, the bound itself is good to a few roundings (2**-40)."""
    if not math.isfinite(found.error[at]):
        return True
    return abs(Fraction(float(found.value[at])) - Fraction(true)) <= Fraction(float(found.error[at])) * (
        1 + Fraction(1, 2**40)
    )


def operand(x: float, rel: float, where_: float) -> tuple[Rounded, Fraction]:
    """A number with an error, and a true value inside."""
    err = abs(x) * rel
    return Rounded([x], [err]), Fraction(x) + Fraction(err) * Fraction(where_)


OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "max": lambda a, b: maximum(a, b) if isinstance(a, Rounded) or isinstance(b, Rounded) else max(a, b),
    "min": lambda a, b: minimum(a, b) if isinstance(a, Rounded) or isinstance(b, Rounded) else min(a, b),
}


@pytest.mark.parametrize("name", OPERATIONS)
@QUICK
@given(number, relative, spread, number, relative, spread)
def test_operations(name: str, x: float, rx: float, tx: float, y: float, ry: float, ty: float) -> None:
    """Any true operands inside the errors give a result inside the error; from either side with plain numbers."""
    a, true_a = operand(x, rx, tx)
    b, true_b = operand(y, ry, ty)
    of = OPERATIONS[name]
    for left, right, p, q in (
        (a, b, true_a, true_b),
        (a, np.array([y]), true_a, Fraction(y)),
        (np.array([x]), b, Fraction(x), true_b),
        (x, b, Fraction(x), true_b),
        (a, y, true_a, Fraction(y)),
    ):
        if name == "/" and q == 0:
            continue
        found = of(left, right)
        assert isinstance(found, Rounded)
        assert inside(found, of(p, q))


@QUICK
@given(positive, relative, spread)
def test_square_roots(x: float, rel: float, t: float) -> None:
    """Of an interval, down to one that reaches 0: r**2 against the truth."""
    a, true = operand(x, rel, t)
    found = sqrt(a)
    root = Fraction(math.isqrt(int(true * 2**200))) / 2**100 if true > 0 else Fraction(0)  # 100 bits behind the point
    assert inside(found, root)


@QUICK
@given(st.floats(1e-30, 1.0))
def test_square_roots_next_to_zero(err: float) -> None:
    """An error larger than the value: the root may be anything up to the root of both."""
    found = sqrt(Rounded([0.0], [err]))
    assert found.error[0] >= math.sqrt(err) * (1 - 1e-15)


@QUICK
@given(positive, st.sampled_from([0.0, 1e-15, 1e-11]), spread, st.sampled_from([-2.5, -0.4, 0.5, 1.0, 2.0, 3.5, 7.0]))
def test_powers(x: float, rel: float, t: float, power: float) -> None:
    """First order in the error: relative errors up to 1e-11, whose square 49/2 1e-22 is below the own roundings."""
    a, true = operand(x, rel, t)
    found = a**power
    exact = np.longdouble(0) + np.exp(np.longdouble(power) * np.log(np.longdouble(x) + np.longdouble(x * rel * t)))
    relative_error = 2 + abs(power * math.log(x))  # of exp(p log x) in longdouble
    assert abs(np.longdouble(found.value[0]) - exact) <= found.error[0] + relative_error * 2.0**-62 * exact
    assert float(true) > 0


UNARY = (lambda a: -a, abs, lambda a: sqrt(abs(a)) if isinstance(a, Rounded) else np.sqrt(abs(a)))


@QUICK
@given(st.lists(st.tuples(st.sampled_from("+-*/mnuas"), number), min_size=1, max_size=12), number)
def test_expressions(steps: list[tuple[str, float]], start: float) -> None:
    """Chains of operations in float64 with errors, against the chain in longdouble."""
    r, exact = Rounded([start]), np.array([start], np.longdouble)
    plain = np.array([start])
    for name, y in steps:
        if name in "uas":
            f = UNARY["uas".index(name)]
            r, exact, plain = f(r), f(exact), f(plain)
            continue
        if name == "/" and y == 0:
            continue
        of = OPERATIONS[{"m": "max", "n": "min"}.get(name, name)]
        if name in "mn":
            pick: Any = np.maximum if name == "m" else np.minimum
            r, exact, plain = of(r, y), pick(exact, y), pick(plain, y)
        else:
            r, exact, plain = of(r, y), of(exact, np.longdouble(y)), of(plain, y)
    assert r.value[0] == plain[0]
    if math.isfinite(r.error[0]):
        assert abs(exact[0] - r.value[0]) <= r.error[0] * (1 + 2.0**-8)


@pytest.mark.slow
@QUICK
@given(st.lists(st.tuples(number, relative, spread, st.integers(0, 3)), min_size=1, max_size=40), st.randoms())
def test_sums_in_any_order(terms: list[tuple[float, float, float, int]], random: Any) -> None:
    """Float64 sums in any order of numbers within the errors, and the exact sum, are within the bound."""
    x, err = np.array([t[0] for t in terms]), np.array([abs(t[0]) * t[1] for t in terms])
    row = np.array([t[3] for t in terms])
    found = Rounded(x, err).sum_by(row, 5)
    assert found.value.shape == (5,)
    assert found.value[4] == found.error[4] == 0, "an empty row"
    true_p = [Fraction(t[0]) + Fraction(abs(t[0]) * t[1]) * Fraction(t[2]) for t in terms]
    for k in range(4):
        mine = [p for p in range(len(x)) if row[p] == k]
        assert inside(found, sum((true_p[p] for p in mine), Fraction(0)), k)
        for _ in range(3):
            random.shuffle(mine)
            total = 0.0
            for p in mine:
                total += float(true_p[p])  # rounds once more; the bound has room for two on either side
            assert abs(Fraction(total) - Fraction(float(found.value[k]))) <= Fraction(float(found.error[k])) * (
                1 + Fraction(1, 2**40)
            )


def test_a_sum_that_cancels() -> None:
    """The bound is that of the absolute terms, not of the sum."""
    found = Rounded([1e16, 1.0, -1e16]).sum_by(np.zeros(3, int), 1)
    assert found.error[0] >= 1
    assert found.error[0] <= 3 * ROUNDING * 2.1e16


# --- decisions


def test_comparisons_are_open_within_the_errors() -> None:
    a, b = Rounded([1.0, 2.0, 3.0], 0.25), Rounded([1.5, 2.6, 2.0], 0.25)
    for found, answer in ((a < b, [True, True, False]), (a > b, [False, False, True])):
        assert found.answer.tolist() == answer
        assert found.open.tolist() == [True, False, False]
    assert (a <= 1.0).open.tolist() == [True, False, False]
    assert (a >= 1.0).answer.tolist() == [True, True, True]
    assert (a > 1.0).answer.tolist() == [False, True, True]  # reflected
    reflected: Any = np.array([1.0, 1.0, 1.0]) < a
    assert reflected.open.tolist() == [True, False, False]


def test_equality_is_a_plain_guard() -> None:
    a = Rounded([0.0, 1.0], 0.25)
    assert (a == 0).tolist() == [True, False]
    assert (a == 0).tolist() == [True, False]


three = st.sampled_from([(False, False), (True, False), (False, True), (True, True)])  # answer, open


@given(three, three)
def test_logic(p: tuple[bool, bool], q: tuple[bool, bool]) -> None:
    """An outcome is open exactly if the possible operands give different ones."""

    def possible(pair: tuple[bool, bool]) -> list[bool]:
        return [False, True] if pair[1] else [pair[0]]

    a, b = Decision([p[0]], [p[1]]), Decision([q[0]], [q[1]])
    for found, rule in ((a & b, lambda x, y: x and y), (a | b, lambda x, y: x or y), (~a, lambda x, _: not x)):
        outcomes = {rule(x, y) for x in possible(p) for y in possible(q)}
        assert found.answer[0] == rule(p[0], q[0])
        assert bool(found.open[0]) == (len(outcomes) == 2)
    for plain in (True, False):  # with arrays of flags, from either side
        flags = np.array([plain])
        for found in (a & flags, flags & a):
            assert found.answer[0] == (p[0] and plain)
            assert bool(found.open[0]) == (p[1] and plain)
        for found in (a | flags, flags | a):
            assert found.answer[0] == (p[0] or plain)
            assert bool(found.open[0]) == (p[1] and not plain)


@QUICK
@given(number, relative, number, relative, three)
def test_choices(x: float, rx: float, y: float, ry: float, choice: tuple[bool, bool]) -> None:
    """An open choice covers both outcomes with their errors, a made one its own."""
    a, b = Rounded([x], [abs(x) * rx]), Rounded([y], [abs(y) * ry])
    found = where(Decision([choice[0]], [choice[1]]), a, b)
    chosen = a if choice[0] else b
    assert found.value[0] == chosen.value[0]
    for outcome in (a, b) if choice[1] else (chosen,):
        for end in (-1, 1):
            assert inside(found, Fraction(float(outcome.value[0])) + end * Fraction(float(outcome.error[0])))
    plain = where(np.array([choice[0]]), a, b)
    assert (plain.value[0], plain.error[0]) == (chosen.value[0], chosen.error[0])
    assert where(np.array([choice[0]]), a, 0.0).error[0] == (a.error[0] if choice[0] else 0)


def test_unbounded_errors_stay_unbounded() -> None:
    """A divisor whose interval holds 0 leaves no bound, and nothing afterwards brings one back."""
    lost = 1.0 / Rounded([0.5], [0.5])
    assert lost.error[0] == math.inf
    with np.errstate(invalid="ignore"):
        for found in (lost * 0.0, lost + 1.0, sqrt(lost), lost * 2.0):
            assert not (found.error[0] <= 1e300)


def test_zero_without_error_stays_so() -> None:
    """In sums, products and quotients of known divisor; not where the other operand may be anything."""
    none, some, lost = Rounded([0.0]), Rounded([2.0], [1e-9]), Rounded([2.0], [np.inf])
    for found in (none * some, some * none, none / some, none + none, none - none, none.sum_by(np.array([0]), 1)):
        assert found.value.tolist() == [0.0] and exact_zero(found).all()
    for open_ in (none * lost, none / Rounded([1e-10], [1e-9]), Rounded([0.0], [1e-300]) * some, some - some):
        assert not exact_zero(open_).any()
    certain = none > 0
    assert isinstance(certain, Decision) and not certain.answer.any() and not certain.open.any()
    assert (Rounded([0.0], [1e-300]) > 0).open.all()


def test_indexing_and_shapes() -> None:
    a = Rounded(np.arange(6.0).reshape(3, 2), 0.5)
    assert a.shape == a.error.shape == (3, 2)
    assert len(a) == 3
    assert a[:, 1].value.tolist() == [1.0, 3.0, 5.0]
    assert a[np.array([2, 0]), 0].error.tolist() == [0.5, 0.5]
    assert (error(np.ones(2)) == 0).all()
    assert value(a) is a.value


def test_numpy_defers_operators_to_rounded() -> None:
    for found in (np.ones(2) * Rounded([1.0, 2.0], 0.5), np.float64(3) - Rounded([1.0, 2.0], 0.5)):
        assert isinstance(found, Rounded)
        assert (found.error >= 0.5).all()


# --- kernels and whole evaluations


@QUICK
@given(st.floats(0, 3.5))
def test_kernel_bounds(q: float) -> None:
    found, slope = QUINTIC.shape(Rounded([q])), QUINTIC.slope(Rounded([q]))
    parts = [(c, max(k - Fraction(q), Fraction(0))) for k, c in ((3, 1), (2, -6), (1, 15))]
    assert inside(found, sum(c * p**5 for c, p in parts))
    assert inside(slope, -5 * sum(c * p**4 for c, p in parts))


def test_harmonic_mean_of_nothing() -> None:
    found = interactions.harmonic_mean(Rounded([0.0, 2.0]), Rounded([0.0, 6.0]))
    assert found.value.tolist() == [0.0, 3.0]
    assert (found.error < 1e-14).all()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", RECIPES)
def test_bounds_cover_longdouble(name: str, dimension: int) -> None:
    """Values are those of a plain run to the last bit; a longdouble run differs by less than the bound."""
    built = recipe(name, dimension)
    plain, fine = built.simulate(), built.longdouble().simulate()
    bound = bounded(built)
    plain.evaluate()
    fine.evaluate()
    found, true = results(plain), results(fine)
    assert found.keys() == true.keys() == bound.keys()
    for field, (values, errors) in bound.items():
        assert np.array_equal(values, found[field]), field
        assert (np.abs(true[field] - values) <= errors).all(), field
    assert true["f"].dtype == np.longdouble
    assert (true["f"] != found["f"]).any(), "longdouble has more digits"


@pytest.mark.parametrize("kinds", list(itertools.product((False, True), repeat=2)))
def test_assigned_elements_keep_their_errors(kinds: tuple[bool, bool]) -> None:
    numbers = np.array([1.0, 2.0]), np.array([3.0, 4.0, 5.0])
    part, rest = (Rounded(x, 0.25 * x) if kind else x for x, kind in zip(numbers, kinds, strict=True))
    found = placed(part, np.array([2, 0]), rest)
    assert isinstance(found, Rounded) == any(kinds)
    assert value(found).tolist() == [2.0, 4.0, 1.0]
    assert error(found).tolist() == [0.5 * kinds[0], 1.0 * kinds[1], 0.25 * kinds[0]]
    assert numbers[1].tolist() == [3.0, 4.0, 5.0], "the array given stays as it was"


def edge_scene() -> tuple[Scene, int]:
    """The limit of surface detection is the divergence of one particle, to the last bit."""
    far = SurfaceDetection("divergence", 1.6, 3)
    built = scene(2, periodic=(True, False), margin=3.0, surface=far)
    divr_n = built.simulate().evaluate()["surface/divr"]
    k = int(np.argsort(divr_n)[len(divr_n) // 3])
    return scene(2, periodic=(True, False), margin=3.0, surface=SurfaceDetection("divergence", float(divr_n[k]), 3)), k


def test_open_surface_leaves_dependent_fields_open() -> None:
    """Whether the particle is a surface is undecided: class, normal, and distances of neighbours have errors."""
    built, k = edge_scene()
    found = bounded(built)
    assert found["surface"][0][k] == 0
    assert found["surface"][1][k] >= 1
    assert np.hypot(*found["surface/n"][1][k]) >= 1 - 1e-8  # a unit vector or zero; 1e-10 softens it
    simulation = built.simulate()
    simulation.evaluate()
    e = simulation.evaluator
    assert isinstance(e, ArrayEvaluator)
    r_n, error_n = found["surface/r"]
    assert error_n[k] >= r_n[k] > 0  # 0 if it is a surface
    beside = e.j[e.i == k]
    certain = found["surface"][0][beside] == 1
    assert certain.any() and not certain.all()
    assert (error_n[beside[~certain]] >= built.model.cut).all()
    assert (r_n[beside[certain]] == 0).all() and (error_n[beside[certain]] == 0).all()
    decided = np.ones(len(built.state.x_nc), bool)
    decided[e.j[e.i == k]] = False
    decided[k] = False
    assert decided.any()
    assert (found["surface/r"][1][decided] < 1e-12).all()
    assert (found["surface/n"][1][decided] < 1e-9).all()
