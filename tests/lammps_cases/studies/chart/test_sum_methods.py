"""Ways to add up: each within its bound of the exact sum, and mistakes outside of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lammps_cases.studies.chart.sum_methods import METHODS, Half, SumMethod, error, exact, rows
from lammps_cases.studies.chart.sums import scene

pytestmark = pytest.mark.slow

SCENES = {"2D": scene(2, 3.0, 12), "3D": scene(3, 4.0, 8)}
NAMED = {method.name: method for method in METHODS}


def most_terms(pairs: Half) -> int:
    return int(np.diff(rows(pairs, np.zeros(len(pairs.j_p)))[0]).max())


def off_by(method: SumMethod, pairs: Half, term_p: Any, true_p: Any = None) -> float:
    """Error of the sums of terms, as sums of the true ones (default: the same)."""
    true_p = term_p if true_p is None else true_p
    return error(method.prepare(pairs, term_p)(), exact(pairs, true_p), exact(pairs, np.abs(true_p)))


def allowed(method: SumMethod, pairs: Half) -> float:
    """Its bound, and one rounding of each of the two exact sums."""
    return float(method.bound(most_terms(pairs))) + 2.0**-52


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
@pytest.mark.parametrize("where", SCENES)
@pytest.mark.parametrize("quantity", ["density", "gradient"])
def test_sums_are_within_their_bound(method: SumMethod, where: str, quantity: str) -> None:
    pairs, terms = SCENES[where]
    assert off_by(method, pairs, terms[quantity]) <= allowed(method, pairs)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_a_neighbour_dropped_or_taken_twice_is_an_error_beyond_every_bound(method: SumMethod) -> None:
    pairs, terms = SCENES["2D"]
    for factor in (0.0, 2.0):
        wrong_p = terms["density"].copy()
        wrong_p[int(np.argsort(wrong_p)[len(wrong_p) // 2])] *= factor  # half of the neighbours are farther away
        off = off_by(method, pairs, wrong_p, terms["density"])
        assert off > 10 * max(allowed(m, pairs) for m in METHODS)


@pytest.mark.parametrize("where", SCENES)
@pytest.mark.parametrize("quantity", ["density", "gradient"])
def test_single_precision_is_seen(where: str, quantity: str) -> None:
    pairs, terms = SCENES[where]
    of_double = allowed(NAMED["full list"], pairs)
    for method in METHODS:
        off = off_by(method, pairs, terms[quantity])
        assert (off > of_double) == ("float32" in method.name), method.name


@pytest.mark.parametrize("where", SCENES)
@pytest.mark.parametrize("quantity", ["density", "gradient"])
def test_compensated_is_no_worse_than_plain(where: str, quantity: str) -> None:
    pairs, terms = SCENES[where]
    for kind in ("half list", "full list"):
        plain, compensated = (off_by(NAMED[name], pairs, terms[quantity]) for name in (kind, f"{kind}, compensated"))
        assert compensated <= plain


@st.composite
def lists(draw: Any) -> tuple[Half, Any]:
    """Any graph of pairs, with empty rows and particles that meet their own images, and terms of any size and sign."""
    n = draw(st.integers(1, 6))
    counts = draw(st.lists(st.integers(0, 30), min_size=n, max_size=n))
    start_n = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    size = int(start_n[-1])
    partners = draw(st.lists(st.integers(0, n - 1), min_size=size, max_size=size))
    number = st.floats(-1e15, 1e15, allow_subnormal=False).filter(lambda t: t == 0 or abs(t) > 1e-15)
    terms = draw(st.lists(number, min_size=size, max_size=size))
    return Half(start_n, np.array(partners, np.uint32)), np.array(terms, float)


@settings(max_examples=60, deadline=None)
@given(lists())
def test_any_terms_are_within_the_bound(made: tuple[Half, Any]) -> None:
    pairs, term_p = made
    i_p = pairs.i_p
    for method in METHODS:
        found_n = method.prepare(pairs, term_p)()
        for n in range(len(pairs)):
            of_n = [*term_p[i_p == n].tolist(), *term_p[pairs.j_p == n].tolist()]
            size = math.fsum(map(abs, of_n))
            off = abs(found_n[n] - math.fsum(of_n))
            # A sum that is not double is rounded once more when it is read; the exact one is rounded too.
            assert off <= float(method.bound(max(len(of_n), 1))) * size + 2.0**-52 * size, method.name


def test_exact_sums_are_rounded_once() -> None:
    pairs = Half(np.array([0, 3, 3, 3, 3]), np.array([1, 2, 3], np.uint32))
    term_p = np.array([1e16, 1.0, -1e16])
    assert exact(pairs, term_p).tolist() == [1.0, 1e16, 1.0, -1e16]
    assert NAMED["full list, compensated"].prepare(pairs, term_p)()[0] == 1.0
    assert NAMED["full list"].prepare(pairs, term_p)()[0] == 0.0
