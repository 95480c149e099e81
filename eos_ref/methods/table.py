"""A law tabulated: values and slopes at equidistant densities, cubic interpolation, compiled."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from typing import Any

import numba
import numpy as np

import eos_ref.jit  # noqa: F401  chooses the registers before anything is compiled
from eos_ref.eos.table import EOS, FloatArray


class Table:
    r"""Cubic Hermite interpolation of :math:`P(\rho)` on an interval around :math:`\rho_0`.

    Parameters
    ----------
    law : EOS
        A law of the density alone.
    low, high : float
        Ends of the interval; outside of it the end's cubic goes on.
    nodes : int
        Most densities on either side of :math:`\rho_0`, at least 2.

    Notes
    -----
    The error of interpolation is at most :math:`\frac{h^4}{384}\max|P''''|`, with h the distance of two nodes. Both
    sides begin at a node at :math:`\rho_0`, in the distance from it, so that the pressure keeps its digits there.
    """

    def __init__(self, law: EOS, low: float, high: float, nodes: int) -> None:
        self.rho0, self.background = law.rho0, law.background
        reach_s = np.array([max(law.rho0 - low, 0.0), max(high - law.rho0, 0.0)])
        # Powers of two, no finer than the densities themselves: every node is a double, and no distance is rounded.
        finest = float(np.spacing(law.rho0 + reach_s.max()))
        self.step_s = 2.0 ** np.ceil(np.log2(np.maximum(reach_s / (nodes - 1), finest)))
        count = int(np.ceil(reach_s / self.step_s).max()) + 1
        sides = [_coefficients(law, s, count) for s in (-self.step_s[0], self.step_s[1])]
        self.coefficient_skf = np.stack(sides)

    def pressure(self, rho_n: FloatArray, e_n: FloatArray | None = None) -> FloatArray:
        """Return the pressure (n,) of every density (n,)."""
        p_n = np.empty(rho_n.shape)
        _interpolate(rho_n, self.rho0, 1 / self.step_s, self.coefficient_skf, self.background, p_n)
        return p_n


def _coefficients(law: EOS, step: float, nodes: int) -> FloatArray:
    """Return p, a, b, c of every interval, (nodes - 1, 4): at t from 0 to 1, P - P_b = p + t (a + t (b + t c))."""
    rho_k = law.rho0 + step * np.arange(nodes)
    p_k, slope_k = np.asarray(law.evaluate(rho_k)) - law.background, np.asarray(law.stiffness(rho_k)) * step
    rise_k = np.diff(p_k)
    left, right = slope_k[:-1], slope_k[1:]
    return np.stack([p_k[:-1], left, 3 * rise_k - 2 * left - right, left + right - 2 * rise_k], axis=1)


@numba.njit(error_model="numpy", cache=True, nogil=True)
def _interpolate(rho_n: Any, rho0: float, per_step_s: Any, coefficient_skf: Any, background: float, out_n: Any) -> None:
    last = coefficient_skf.shape[1] - 1
    for i in range(rho_n.size):
        d = rho_n[i] - rho0
        side = int(d >= 0)
        place = abs(d) * per_step_s[side]
        k = min(int(place), last)
        t = place - k
        c = coefficient_skf[side, k]
        out_n[i] = c[0] + t * (c[1] + t * (c[2] + t * c[3])) + background
