"""Frontiers: which methods dominate which."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lammps_cases.records.measure import Timing
from lammps_cases.studies.chart.record import DIGITS, MethodPoint, compared, frontier, point
from tests.support.roundings import rounded

pytestmark = pytest.mark.slow

ROUNDS = 11


def _points(methods: dict[str, tuple[float, float]]) -> tuple[MethodPoint, ...]:
    """Points of (error, seconds), without scatter of the times."""
    timings = {name: Timing((seconds,) * ROUNDS, 1, seconds) for name, (_, seconds) in methods.items()}
    given = [point("q", "r", name, error, timings[name], 1.0) for name, (error, _) in methods.items()]
    return compared(given, timings)


def test_frontier_holds_only_undominated_methods() -> None:
    found = _points({"fast": (1e-3, 1.0), "middle": (1e-8, 2.0), "bad": (1e-6, 3.0), "exact": (0.0, 4.0)})
    assert [p.method for p in frontier(found)] == ["fast", "middle", "exact"]
    assert {p.method: p.dominated_by for p in found}["bad"] == "middle"


def test_errors_within_one_bit_are_equal() -> None:
    found = _points({"a": (1.0e-16, 2.0), "b": (1.9e-16, 1.0)})
    assert [p.method for p in frontier(found)] == ["b"]
    found = _points({"a": (1.0e-16, 2.0), "b": (2.1e-16, 1.0)})
    assert [p.method for p in frontier(found)] == ["b", "a"]


def test_indistinguishable_times_are_listed_and_do_not_dominate() -> None:
    seconds = tuple(1.0 + 0.1 * (-1) ** k for k in range(ROUNDS))
    other = tuple(1.0 - 0.1 * (-1) ** k for k in range(ROUNDS))
    timings = {"a": Timing(seconds, 1, 1.0), "b": Timing(other, 1, 1.0)}
    found = compared([point("q", "r", name, 1e-9, timings[name], 1.0) for name in timings], timings)
    assert [p.like for p in found] == [("b",), ("a",)]
    assert len(frontier(found)) == 2


@given(
    st.dictionaries(
        st.text("abcdefgh", min_size=1, max_size=3),
        st.tuples(st.sampled_from([0.0, 1e-16, 1e-12, 1e-8, 1e-3, 1.0, math.inf]), st.floats(0.5, 50.0)),
        min_size=1,
        max_size=8,
    )
)
def test_errors_fall_along_the_frontier(methods: dict[str, tuple[float, float]]) -> None:
    """It is never empty, and errors fall as times grow."""
    best = frontier(_points(methods))
    assert best
    for one, next_ in itertools.pairwise(best):
        assert one.ns.median <= next_.ns.median
        assert next_.error < one.error or one.ns.median == next_.ns.median


@pytest.mark.parametrize(
    ("error", "digits"), [(1e-3, 3.0), (0.0, DIGITS), (1e-30, DIGITS), (50.0, 0.0), (math.inf, 0.0), (math.nan, 0.0)]
)
def test_digits(error: float, digits: float) -> None:
    timing = Timing((1.0,), 1, 1.0)
    assert point("q", "r", "m", error, timing, 1.0).digits == rounded(digits, 2)


def test_times_are_per_particle_and_without_compilation() -> None:
    found = point("q", "r", "m", 1e-3, Timing((2.0, 2.0, 2.0), 4, 7.0), 1000.0)
    assert found.ns.median == rounded(2e6, 3)
    assert found.compiling == rounded(5.0, 3)
