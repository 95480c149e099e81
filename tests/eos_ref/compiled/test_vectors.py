"""Short vectors of compiled loops against numpy: sizes that fill registers, leave lanes over, or take several."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest

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

pytestmark = pytest.mark.slow

SIZES = [1, 2, 3, 4, 6, 8, 9, 15, 16, 35]


def rows(count: int, size: int) -> Any:
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
    a_nc, out_nc = rows(2, size), np.full((9, size), 7.0)
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
    a_nc, b_nc = np.rint(8 * rows(2, size)), np.rint(8 * rows(1, other))
    m_nf = np.rint(8 * rows(1, size * other))
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
