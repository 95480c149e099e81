r"""The quintic spline.

Symbols: ``r`` distance, ``cut`` support radius :math:`r_c`, ``h = cut/3`` smoothing length, ``q = r/h``.
Source: Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997), equation for the quintic spline.
"""

from __future__ import annotations

import math

from eos_ref.kernels.kernel import Kernel
from eos_ref.numbers.elementary import N, maximum


def quintic(q: N) -> N:
    r"""Return the shape of the quintic spline, :math:`(3-q)_+^5 - 6(2-q)_+^5 + 15(1-q)_+^5`; 66 at q = 0."""
    a, b, c = maximum(3 - q, 0.0), maximum(2 - q, 0.0), maximum(1 - q, 0.0)
    aa, bb, cc = a * a, b * b, c * c
    return aa * aa * a - 6 * (bb * bb * b) + 15 * (cc * cc * c)


def quintic_slope(q: N) -> N:
    r"""Return the derivative of the shape, :math:`-5[(3-q)_+^4 - 6(2-q)_+^4 + 15(1-q)_+^4]`."""
    a, b, c = maximum(3 - q, 0.0), maximum(2 - q, 0.0), maximum(1 - q, 0.0)
    aa, bb, cc = a * a, b * b, c * c
    return -5 * (aa * aa - 6 * (bb * bb) + 15 * (cc * cc))


def normalisation(dimension: int, h: float) -> float:
    r"""Return the factor of an integral of 1: :math:`7/(478\pi h^2)` in 2D, :math:`1/(120\pi h^3)` in 3D."""
    return 7 / (478 * math.pi * h**2) if dimension == 2 else 1 / (120 * math.pi * h**3)


QUINTIC = Kernel("quintic", support=3.0, factor=normalisation, shape=quintic, slope=quintic_slope)
