r"""Ways to evaluate an equation of state.

A method prepares, for one law and an interval of densities, a function of densities and energies that returns
pressures in float64. `eos_ref.eos.laws` holds the law itself; the forms here are alternatives that are in use elsewhere
(textbooks, LAMMPS, tables). They are measured, and used where a tolerance allows
(`eos_ref.methods.choice`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eos_ref.eos import lammps_rounding
from eos_ref.eos.table import EOS, FloatArray

Evaluate = Callable[[FloatArray, FloatArray | None], FloatArray]
NODES = 4096  # of a table: 32 kB of values and slopes each


@dataclass(frozen=True)
class LawMethod:
    """One way to evaluate a law.

    Attributes
    ----------
    function : of a law and the ends of an interval of densities; prepares and returns ``evaluate(rho_n, e_n)``
    applies : function of a law; returns whether the method can evaluate it
    reason : what it is and why one would take it, in a line
    conditioning : rank among the methods that cost the same, 0 the best conditioned one
    """

    name: str
    reason: str
    function: Callable[[EOS, float, float], Evaluate]
    applies: Callable[[EOS], bool] = lambda law: True
    conditioning: int = 1


def _compiled(law: EOS, low: float, high: float) -> Evaluate:
    return law.pressure


def _numpy(law: EOS, low: float, high: float) -> Evaluate:
    return lambda rho_n, e_n: np.asarray(law.evaluate(rho_n, e_n))


def _textbook(law: EOS, low: float, high: float) -> Evaluate:
    textbook = law.law.textbook
    assert textbook is not None, f"{law.style} has no other form"

    def evaluate(rho_n: FloatArray, e_n: FloatArray | None) -> FloatArray:
        with np.errstate(all="ignore"):
            return np.asarray(textbook(rho_n, e_n, law.rho0, law.cs, law.parameter) + law.background)

    return evaluate


def _as_lammps(law: EOS, low: float, high: float) -> Evaluate:
    return lambda rho_n, e_n: lammps_rounding.pressure_of_law(law, rho_n, e_n, np.ones(1))


def _polynomial(law: EOS, low: float, high: float) -> Evaluate:
    r"""Expand :math:`(1+d)^\gamma - 1 = d\,(\gamma + \binom\gamma2 d + \dots)` in :math:`d = \rho/\rho_0 - 1`."""
    gamma = int(law.gamma)
    coefficients = [math.comb(gamma, k) for k in range(1, gamma + 1)]
    scale = law.cs**2 * law.rho0 / gamma

    def evaluate(rho_n: FloatArray, e_n: FloatArray | None) -> FloatArray:
        d_n = (rho_n - law.rho0) / law.rho0
        sum_n = np.full_like(d_n, coefficients[-1])
        for c in coefficients[-2::-1]:
            sum_n *= d_n
            sum_n += c
        return np.asarray(scale * (sum_n * d_n) + law.background)

    return evaluate


def _has_polynomial(law: EOS) -> bool:
    return law.exponent is not None and law.exponent == round(law.exponent) and 2 <= law.exponent <= 64


def _series(law: EOS, low: float, high: float) -> Evaluate:
    from eos_ref.methods import series

    coefficient_k = series.coefficients(law, max(abs(low / law.rho0 - 1), abs(high / law.rho0 - 1)))
    return lambda rho_n, e_n: series.pressure(law, coefficient_k, rho_n)


def _expm1(law: EOS, low: float, high: float) -> Evaluate:
    scale = law.cs**2 * law.rho0 / law.gamma

    def evaluate(rho_n: FloatArray, e_n: FloatArray | None) -> FloatArray:
        with np.errstate(all="ignore"):
            return np.asarray(scale * np.expm1(law.gamma * np.log1p((rho_n - law.rho0) / law.rho0)) + law.background)

    return evaluate


def _cubic_table(law: EOS, low: float, high: float) -> Evaluate:
    from eos_ref.methods.table import Table

    return Table(law, low, high, NODES).pressure


def _is_tait(law: EOS) -> bool:
    return law.exponent is not None


METHODS: tuple[LawMethod, ...] = (
    LawMethod(
        "compiled", "the reference's compiled loop: a vectorised power, one pass over memory", _compiled, conditioning=0
    ),
    LawMethod("numpy", "the reference's formula in numpy: nothing to compile or load", _numpy, conditioning=0),
    LawMethod("expm1/log1p", "any gamma: expm1(gamma log1p(d)), no cancellation near rho0", _expm1, _is_tait),
    LawMethod(
        "series", "any gamma near rho0: binomial series in d, compiled, as many terms as needed", _series, _is_tait
    ),
    LawMethod("polynomial", "whole gamma: binomial series in d = rho/rho0 - 1", _polynomial, _has_polynomial),
    LawMethod(
        "textbook",
        "the formula as textbooks print it, with numpy's power",
        _textbook,
        lambda law: law.law.textbook is not None,
        3,
    ),
    LawMethod(
        "in LAMMPS' order",
        "the formula with LAMMPS' order of operations, from which the verdict exact follows",
        _as_lammps,
        conditioning=3,
    ),
    LawMethod(
        "table, cubic",
        f"interpolated between {NODES} values and slopes on either side of rho0",
        _cubic_table,
        lambda law: not law.needs_energy,
        4,
    ),
)


def methods_of(law: EOS) -> list[LawMethod]:
    """Return the methods that can evaluate a law."""
    return [method for method in METHODS if method.applies(law)]
