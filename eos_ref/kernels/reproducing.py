r"""Bases of the reproducing kernels RK0, RK1 and RK2, each written once, for every number type.

Source: Bonet & Lok, CMAME 180, 97 (1999); Palermo et al., Phys. Fluids 36, 113337 (2024).
"""

from __future__ import annotations

import math

from eos_ref.numbers.elementary import N


def basis(order: int, u: list[N]) -> list[N]:
    r"""Return the basis H of a reproducing kernel of an order, at :math:`\mathbf u = \mathbf x_{ij}/r_c`.

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
    """Return the number of functions in the basis."""
    return math.comb(dimension + order, order)
