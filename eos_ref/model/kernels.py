r"""Kernels of fix rheo: the quintic spline and the bases of the reproducing kernels, each written once.

Plain operators and `eos_ref.numbers.elementary` functions, as in `eos_ref.eos.laws`: the same bodies serve numpy
arrays, compiled loops and numbers that carry their rounding error.

Symbols: ``r`` distance, ``cut`` support radius :math:`r_c`, ``h = cut/3`` smoothing length, ``q = r/h``.
Source: Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997), equation for the quintic spline.
"""

from __future__ import annotations

import math

from eos_ref.numbers.elementary import Number, maximum

SUPPORT = 3.0  # cut/h


def quintic(q: Number) -> Number:
    r"""Shape of the quintic spline, :math:`(3-q)_+^5 - 6(2-q)_+^5 + 15(1-q)_+^5`; 66 at q = 0."""
    a, b, c = maximum(3 - q, 0.0), maximum(2 - q, 0.0), maximum(1 - q, 0.0)
    aa, bb, cc = a * a, b * b, c * c
    return aa * aa * a - 6 * (bb * bb * b) + 15 * (cc * cc * c)


def quintic_slope(q: Number) -> Number:
    r"""Its derivative, :math:`-5[(3-q)_+^4 - 6(2-q)_+^4 + 15(1-q)_+^4]`."""
    a, b, c = maximum(3 - q, 0.0), maximum(2 - q, 0.0), maximum(1 - q, 0.0)
    aa, bb, cc = a * a, b * b, c * c
    return -5 * (aa * aa - 6 * (bb * bb) + 15 * (cc * cc))


def normalisation(dimension: int, cut: float) -> float:
    r"""Factor that makes the kernel's integral 1: :math:`7/(478\pi h^2)` in 2D, :math:`1/(120\pi h^3)` in 3D."""
    h = cut / SUPPORT
    return 7 / (478 * math.pi * h**2) if dimension == 2 else 1 / (120 * math.pi * h**3)


def self_value(dimension: int, cut: float) -> float:
    """W(0), dimension 1/length**d."""
    return 66 * normalisation(dimension, cut)


def basis(order: int, u: list[Number]) -> list[Number]:
    r"""Basis H of a reproducing kernel of an order, at :math:`\mathbf u = \mathbf x_{ij}/r_c`.

    Order 0: (1). Order 1: (1, u_x, u_y[, u_z]). Order 2 appends :math:`\frac12u_a^2` for every axis, then
    :math:`u_au_b` for a < b.
    """
    one = 1 + 0 * u[0]
    h = [one]
    if order >= 1:
        h += u
    if order >= 2:
        h += [0.5 * (c * c) for c in u]
        h += [u[a] * u[b] for a in range(len(u)) for b in range(a + 1, len(u))]
    return h


def basis_size(order: int, dimension: int) -> int:
    """Number of functions in the basis."""
    return math.comb(dimension + order, order)
