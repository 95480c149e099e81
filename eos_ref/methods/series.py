r"""Tait's law by the binomial series in the compression, compiled.

.. math:: P = c^2\rho_0\,d\,\Big(1 + \frac{\gamma-1}{2}d\,\Big(1 + \frac{\gamma-2}{3}d\,(1 + \dots)\Big)\Big) + P_b,
   \qquad d = \rho/\rho_0 - 1

for any exponent. The terms that an interval of densities needs are counted first; a fluid, within a few per cent of
:math:`\rho_0`, needs six to ten, and no logarithm.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from typing import Any

import numba
import numpy as np

import eos_ref.jit  # noqa: F401  chooses the registers before anything is compiled
from eos_ref.eos import compiled
from eos_ref.eos.table import EOS, FloatArray

MOST = 40  # terms; beyond, the power is cheaper
PASS = 4  # terms of Horner's scheme taken in one pass over a block


def coefficients(law: EOS, reach: float) -> FloatArray:
    r"""Return the coefficients of 1, d, d^2, ... of :math:`[(1+d)^\gamma-1]/(\gamma d)`, at most `MOST`.

    The terms left out add up to less than :math:`2^{-54}` where :math:`|d|` does not exceed ``reach`` < 1. The series
    of a whole gamma ends by itself.
    """
    terms = [1.0]
    for k in range(1, MOST):
        next_ = terms[-1] * (law.gamma - k) / (k + 1)
        # From here on the ratio of a term to the one before is below this, so that the rest is a geometric series.
        ratio = reach * max(1.0, abs(law.gamma - k - 1) / (k + 2))
        if next_ == 0 or (ratio < 1 and abs(next_) * reach**k / (1 - ratio) < 2.0**-54):
            break
        terms.append(next_)
    return np.array(terms)


def pressure(law: EOS, coefficient_k: FloatArray, rho_n: FloatArray) -> FloatArray:
    """Return the pressure (n,) of every density (n,)."""
    padded = np.zeros(-(-len(coefficient_k) // PASS) * PASS)
    padded[: len(coefficient_k)] = coefficient_k
    p_n = np.empty(rho_n.shape)
    _sum(rho_n, law.rho0, 1 / law.rho0, law.cs * law.cs * law.rho0, law.background, padded[::-1].copy(), p_n)
    return p_n


@numba.njit(error_model="numpy", cache=True, nogil=True)
def _sum(
    rho_n: Any, rho0: float, per_rho0: float, scale: float, background: float, coefficient_k: Any, out_n: Any
) -> None:
    d_block, sum_block = np.empty(compiled.BLOCK), np.empty(compiled.BLOCK)
    for start in range(0, rho_n.size, compiled.BLOCK):
        rho_b, out_b = rho_n[start : start + compiled.BLOCK], out_n[start : start + compiled.BLOCK]
        d_b, sum_b = d_block[: rho_b.size], sum_block[: rho_b.size]
        for i in range(rho_b.size):
            d_b[i] = (rho_b[i] - rho0) * per_rho0
            sum_b[i] = 0.0
        for k in range(0, coefficient_k.size, PASS):
            a, b, c, e = coefficient_k[k], coefficient_k[k + 1], coefficient_k[k + 2], coefficient_k[k + 3]
            for i in range(rho_b.size):
                d = d_b[i]
                sum_b[i] = (((sum_b[i] * d + a) * d + b) * d + c) * d + e
        for i in range(rho_b.size):
            out_b[i] = scale * (d_b[i] * sum_b[i]) + background
