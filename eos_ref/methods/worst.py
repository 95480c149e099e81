r"""The worst relative error of a way to evaluate a law, found by search over an interval of compressions.

Errors are relative to the sum of the absolute values of the law and of the background pressure: a background that
happens to cancel the law makes every method lose digits, and says nothing of the method.

Sampling alone misses the worst case: rounding errors jump from one double to the next. The search samples the
interval, then climbs from the worst samples to their neighbours, one to 2**20 doubles away, and finally certifies the
worst with Arb. All steps but the last evaluate whole arrays and compare with the law in extended precision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref.eos import rigorous
from eos_ref.eos.table import EOS, FloatArray
from eos_ref.errors import InputError
from eos_ref.methods.laws import Evaluate

SAMPLES = 4096
CLIMBERS = 24
ROUNDS = 8
# Doubles by which a climber's neighbours differ from it.
_STEPS = np.array([sign * 2**k for k in range(0, 21, 2) for sign in (1, -1)])


@dataclass(frozen=True)
class Regime:
    r"""Densities at a distance from equilibrium: :math:`|\rho/\rho_0-1|` from ``low`` to ``high``, both signs.

    Below -0.9, near vacuum, no density is taken: most laws end at 0.
    """

    low: float
    high: float

    def __str__(self) -> str:
        return f"|rho/rho0 - 1| from {self.low:g} to {self.high:g}"

    def ends(self, law: EOS) -> tuple[float, float]:
        """Return the least and the greatest density."""
        return law.rho0 * (1 - min(self.high, 0.9)), law.rho0 * (1 + self.high)

    def densities(self, law: EOS, n: int) -> FloatArray:
        """Return densities (n,) whose distances are in geometric progression, with alternating signs."""
        d_n = np.geomspace(self.low, self.high, n)
        d_n[1::2] *= -1
        return np.asarray(law.rho0 * (1 + np.where(d_n < -0.9, -d_n, d_n)))

    def holds(self, law: EOS, rho_n: FloatArray) -> Any:
        """Return whether densities (n,) belong to the regime; at its ends one rounding of slack."""
        d_n = np.abs(rho_n / law.rho0 - 1)
        low, high = self.ends(law)
        return (d_n >= self.low * (1 - 1e-12) - 2.0**-53) & (d_n > 0) & (rho_n >= low) & (rho_n <= high)


@dataclass(frozen=True)
class Worst:
    """The worst case found: its relative error, certified, and where it is; median and 99th percentile of the samples.

    The percentiles are of the densities with which the search begins, not of those that it climbs to.
    """

    error: float
    rho: float
    median: float = np.nan
    p99: float = np.nan


def worst_case(
    evaluate: Evaluate, law: EOS, rho_n: FloatArray, inside: Callable[[FloatArray], Any], e: float | None = None
) -> Worst:
    """Return the largest relative error of pressures, searching from some densities.

    Parameters
    ----------
    evaluate : function of densities and energies; returns pressures
    rho_n : (n,) densities to begin with
    inside : function of densities; returns where the search may go
    e : energy per unit mass, of laws that need one

    Raises
    ------
    InputError
        No density at which the law is defined.
    """
    rho_n = np.unique(rho_n[law.is_defined(rho_n) & inside(rho_n)])
    if not rho_n.size:
        raise InputError("density", "none of the interval lies in the law's domain")
    error_n = _screened(evaluate, law, rho_n, e)
    median, p99 = (float(q) for q in np.quantile(error_n, (0.5, 0.99), method="higher"))
    for _ in range(ROUNDS):
        best = rho_n[np.argsort(error_n)[-CLIMBERS:]]
        near = (best.view(np.int64)[:, None] + _STEPS).view(np.float64).ravel()
        near = near[np.isfinite(near) & law.is_defined(near)]
        near = np.unique(np.concatenate([best, near[inside(near)]]))
        near_error = _screened(evaluate, law, near, e)
        if near_error.max() <= error_n.max():
            break
        rho_n, error_n = near, near_error
    order = np.argsort(error_n)[-3:]
    certified = [(certain_error(evaluate, law, float(rho), e), float(rho)) for rho in rho_n[order]]
    return Worst(*max(certified), median, p99)


def certain_error(evaluate: Evaluate, law: EOS, rho: float, e: float | None = None) -> float:
    """Return the error of one pressure over the sum of the law's value and the background, rounded up.

    Where both are 0, it is relative to rho0 cs^2.
    """
    energy_n = None if e is None else np.array([e])
    value = float(evaluate(np.array([rho]), energy_n)[0])
    exact = rigorous.pressure(law, rho, e)
    size = float(abs(exact - law.background).lower()) + abs(law.background)
    return rigorous.error(value, exact) / (size or law.rho0 * law.cs**2)


def _screened(evaluate: Evaluate, law: EOS, rho_n: FloatArray, e: float | None) -> FloatArray:
    energy_n = None if e is None else np.full(rho_n.shape, e)
    with np.errstate(all="ignore"):
        exact_n = np.asarray(law.evaluate(rho_n.astype(np.longdouble), None if e is None else np.longdouble(e)))
        size_n = np.abs(exact_n - law.background) + abs(law.background)
        error_n: FloatArray = np.abs((evaluate(rho_n, energy_n) - exact_n) / size_n).astype(float)
    error_n[np.isnan(error_n)] = np.inf  # no number where the law has one: as wrong as can be
    return error_n
