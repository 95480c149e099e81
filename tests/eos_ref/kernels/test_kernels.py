"""Every kernel of the registry: normalisation, derivative, ends; the quintic spline in rational numbers; bases."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref.kernels import reproducing
from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.kernels.styles import KERNELS
from tests.support.particle_scenes import EPS

PROPERTY = settings(deadline=None, derandomize=True, max_examples=60)
CUTS = [0.37, 1.0, 3.0, 41.7]
kernels = pytest.mark.parametrize("kernel", {each.kernel for each in KERNELS.values()}, ids=lambda kernel: kernel.name)
dimensions = pytest.mark.parametrize("dimension", [2, 3])
fractions = st.integers(0, 210).map(lambda k: Fraction(k, 64))


def truncated(q: Fraction, power: int, signed: bool = True) -> Fraction:
    """Sum of the truncated powers of the spline, or of their absolute values, in rational arithmetic."""
    terms = [(c if signed else abs(c)) * max(k - q, Fraction(0)) ** power for k, c in ((3, 1), (2, -6), (1, 15))]
    return sum(terms, Fraction(0))


@PROPERTY
@given(fractions)
def test_quintic_spline_and_its_slope_are_the_documented_polynomials(q: Fraction) -> None:
    """k - q is exact here; a power rounds 4 times, its factor and the sums 3 times: 7 u of the absolute terms.

    The exact central difference is off by step**2/6 times the third derivative, at most 60 (9 + 24 + 15).
    """
    own = 4 * EPS * 5 * float(truncated(q, 4, signed=False))
    slope, step = QUINTIC.slope(float(q)), Fraction(1, 2**24)
    assert abs(Fraction(float(QUINTIC.shape(float(q)))) - truncated(q, 5)) <= 4 * EPS * truncated(q, 5, signed=False)
    assert abs(Fraction(float(slope)) + 5 * truncated(q, 4)) <= own
    if q:
        difference = (truncated(q + step, 5) - truncated(q - step, 5)) / (2 * step)
        assert abs(float(difference) - slope) <= float(step**2) / 6 * 60 * (9 + 24 + 15) + own


@kernels
def test_kernel_falls_from_its_middle_to_the_end_of_its_support(kernel: Kernel) -> None:
    assert kernel.shape(0.0) > 0 == kernel.slope(0.0)
    for q in (kernel.support, kernel.support * (1 + 1e-7), 2 * kernel.support):
        assert kernel.shape(q) == kernel.slope(q) == 0
    inside = np.linspace(0, kernel.support, 301)[1:-1]
    assert (kernel.shape(inside) > 0).all() and (kernel.slope(inside) < 0).all()
    differences = (kernel.shape(inside + 1e-6) - kernel.shape(inside - 1e-6)) / 2e-6  # off by 1e-12/6 times W'''
    assert np.abs(differences - kernel.slope(inside)).max() < 1e-8 * np.abs(kernel.slope(inside)).max()


@pytest.mark.parametrize("cut", CUTS)
@dimensions
def test_value_at_zero(dimension: int, cut: float) -> None:
    h = cut / 3
    assert QUINTIC.shape(0.0) == 66
    assert QUINTIC.self_value(dimension, cut) == 66 * QUINTIC.normalisation(dimension, cut)
    known = {2: 66 * 7 / 478 / math.pi / h / h, 3: 66 / 120 / math.pi / h / h / h}[dimension]
    assert abs(QUINTIC.self_value(dimension, cut) - known) <= 9 * EPS * known  # 9 roundings each


def radial(kernel: Kernel, dimension: int, cut: float, power: int, shape: str) -> float:
    r"""Integral over space of r**power times W, or W' if ``shape`` is the slope.

    Gauss's rule of 8 nodes on each piece, between whole numbers, is exact to degree 15.
    """
    node, weight = np.polynomial.legendre.leggauss(8)
    pieces = round(kernel.support)
    q, weight = np.concatenate([(node + 1) / 2 + k for k in range(pieces)]), np.tile(weight / 2, pieces)
    h, sphere = cut / kernel.support, 2 * math.pi if dimension == 2 else 4 * math.pi
    f = kernel.shape(q) if shape == "value" else kernel.slope(q) / h
    return float(np.sum(weight * f * q ** (dimension - 1 + power))) * (
        sphere * kernel.normalisation(dimension, cut) * h ** (dimension + power)
    )


@kernels
@pytest.mark.parametrize("cut", CUTS)
@dimensions
def test_integrals(kernel: Kernel, dimension: int, cut: float) -> None:
    r"""Integral 1; by parts :math:`\int x\otimes\nabla W=-\mathbf1`, the trace of which is -d.

    The 24 terms have absolute sums below 8 times the integral, each with some 20 roundings.
    """
    assert abs(radial(kernel, dimension, cut, 0, "value") - 1) <= 8 * 20 * EPS
    assert abs(radial(kernel, dimension, cut, 1, "slope") + dimension) <= 8 * 20 * EPS * dimension


@dimensions
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
    second = radial(QUINTIC, dimension, cut, 2, "value") / dimension
    assert abs(w.sum() - 1) < 1e-9 and np.abs(x @ w).max() < 1e-9 * cut
    assert np.abs((x * w) @ x.T - second * np.eye(dimension)).max() < 1e-9 * cut**2


@pytest.mark.parametrize("order", [0, 1, 2])
@dimensions
def test_bases(order: int, dimension: int) -> None:
    h = [float(b[0]) for b in reproducing.basis(order, [np.array([u]) for u in (3.0, 5.0, 7.0)[:dimension]])]
    turned = reproducing.basis(order, [-3.0, -5.0, -7.0][:dimension])
    whole = {2: [1, 3, 5, 4.5, 12.5, 15], 3: [1, 3, 5, 7, 4.5, 12.5, 24.5, 15, 21, 35]}[dimension]
    assert len(h) == reproducing.basis_size(order, dimension) == {2: (1, 3, 6), 3: (1, 4, 10)}[dimension][order]
    assert h == whole[: len(h)]
    assert turned == [-b if 1 <= k <= dimension else b for k, b in enumerate(h)], "odd and even functions"
