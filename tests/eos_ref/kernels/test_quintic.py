"""The quintic spline: normalisation, moments, derivative, ends; the bases of the reproducing kernels."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from eos_ref.kernels import reproducing
from eos_ref.kernels.quintic import QUINTIC
from tests.support.particle_scenes import EPS

CUTS = [0.37, 1.0, 3.0, 41.7]


def exact(q: Fraction, power: int) -> Fraction:
    """Sum of the truncated powers in rational arithmetic."""
    return sum(
        (c * max(k - q, Fraction(0)) ** power for k, c in ((3, 1), (2, -6), (1, 15))),
        Fraction(0),
    )


def absolute(q: Fraction, power: int) -> float:
    return float(sum(abs(c) * max(k - q, Fraction(0)) ** power for k, c in ((3, 1), (2, -6), (1, 15))))


QS = [Fraction(k, 64) for k in range(0, 210, 3)]


@pytest.mark.parametrize("q", QS, ids=float)
def test_shape_and_slope_are_the_documented_polynomials(q: Fraction) -> None:
    """k - q is exact here; a power rounds 4 times, its factor and the sums 3 times: 7 u of the absolute terms."""
    assert abs(Fraction(float(QUINTIC.shape(float(q)))) - exact(q, 5)) <= 4 * EPS * absolute(q, 5)
    assert abs(Fraction(float(QUINTIC.slope(float(q)))) + 5 * exact(q, 4)) <= 4 * EPS * 5 * absolute(q, 4)


@pytest.mark.parametrize("q", [Fraction(k, 64) for k in range(1, 192, 7)], ids=float)
def test_slope_is_the_derivative(q: Fraction) -> None:
    """Exact central difference: its error is step**2/6 times the third derivative, at most 60 (9 + 24 + 15)."""
    step = Fraction(1, 2**24)
    difference = (exact(q + step, 5) - exact(q - step, 5)) / (2 * step)
    allowed = float(step**2) / 6 * 60 * (9 + 24 + 15) + 4 * EPS * 5 * absolute(q, 4)
    assert abs(float(difference) - QUINTIC.slope(float(q))) <= allowed


def test_values_at_the_ends() -> None:
    assert QUINTIC.shape(0.0) == 66
    assert QUINTIC.slope(0.0) == 0
    for q in (3.0, 3.0000001, 5.0):
        assert QUINTIC.shape(q) == QUINTIC.slope(q) == 0
    inside = np.linspace(0, 3, 301)[1:-1]
    assert (QUINTIC.shape(inside) > 0).all()
    assert (QUINTIC.slope(inside) < 0).all()


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_value_at_zero(dimension: int, cut: float) -> None:
    h = cut / 3
    assert QUINTIC.self_value(dimension, cut) == 66 * QUINTIC.normalisation(dimension, cut)
    known = {2: 66 * 7 / 478 / math.pi / h / h, 3: 66 / 120 / math.pi / h / h / h}[dimension]
    assert abs(QUINTIC.self_value(dimension, cut) - known) <= 9 * EPS * known  # 9 roundings each


def radial(dimension: int, cut: float, power: int, shape: str) -> float:
    r"""Integral over space of r**power times W, or W' if ``shape`` is the slope.

    Gauss's rule of 8 nodes on each of the three polynomial pieces is exact to degree 15.
    """
    node, weight = np.polynomial.legendre.leggauss(8)
    q = np.concatenate([(node + 1) / 2 + k for k in range(3)])
    weight = np.tile(weight / 2, 3)
    h, sphere = cut / 3, 2 * math.pi if dimension == 2 else 4 * math.pi
    f = QUINTIC.shape(q) if shape == "value" else QUINTIC.slope(q) / h
    return float(np.sum(weight * f * q ** (dimension - 1 + power))) * (
        sphere * QUINTIC.normalisation(dimension, cut) * h ** (dimension + power)
    )


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_integrals(dimension: int, cut: float) -> None:
    r"""Integral 1; by parts :math:`\int x\otimes\nabla W=-\mathbf1`, the trace of which is -d.

    The 24 terms have absolute sums below 8 times the integral, each with some 20 roundings.
    """
    assert abs(radial(dimension, cut, 0, "value") - 1) <= 8 * 20 * EPS
    assert abs(radial(dimension, cut, 1, "slope") + dimension) <= 8 * 20 * EPS * dimension


@pytest.mark.parametrize("dimension", [2, 3])
def test_moments_on_the_plane_and_in_space(dimension: int) -> None:
    r"""By the midpoint rule on a grid: :math:`\int\mathbf xW=0` and :math:`\int\mathbf x\otimes\mathbf xW` isotropic.

    The fifth derivative jumps by at most 120 (1 + 6 + 15) at a knot, so that the Fourier transform falls as sigma_d
    2640 k**-6.5 (2D) or k**-7 (3D), k in 1/h. The grid aliases k = 2 pi m/3 of its 2d nearest images: 5e-12 and 1e-10.
    """
    cut, m = 1.5, 64 if dimension == 2 else 32
    line = (np.arange(-m, m + 1) + 0.25) * cut / m  # no node at the origin, no symmetry used
    x = np.array(np.meshgrid(*[line] * dimension, indexing="ij")).reshape(dimension, -1)
    w = QUINTIC.normalisation(dimension, cut) * QUINTIC.shape(3 * np.sqrt((x**2).sum(axis=0)) / cut)
    w *= (cut / m) ** dimension
    second = radial(dimension, cut, 2, "value") / dimension
    assert abs(w.sum() - 1) < 1e-9
    assert np.abs(x @ w).max() < 1e-9 * cut
    assert np.abs((x * w) @ x.T - second * np.eye(dimension)).max() < 1e-9 * cut**2


@pytest.mark.parametrize(
    ("order", "dimension", "size"), [(0, 2, 1), (1, 2, 3), (2, 2, 6), (0, 3, 1), (1, 3, 4), (2, 3, 10)]
)
def test_bases(order: int, dimension: int, size: int) -> None:
    u = [np.array([3.0]), np.array([5.0]), np.array([7.0])][:dimension]
    h = [float(b[0]) for b in reproducing.basis(order, u)]
    assert len(h) == size == reproducing.basis_size(order, dimension)
    whole = {2: [1, 3, 5, 4.5, 12.5, 15], 3: [1, 3, 5, 7, 4.5, 12.5, 24.5, 15, 21, 35]}[dimension]
    assert h == whole[:size]
