r"""Ways to evaluate an equation of state.

A method prepares, for one law and an interval of densities, a function of densities and energies that returns
pressures in float64. `eos_ref.eos.laws` holds the law itself; the forms here are alternatives that are in use elsewhere
(textbooks, LAMMPS, tables, single precision). They are measured, and used where a tolerance allows
(`eos_ref.methods.choice`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

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
    prepare : function of a law and the ends of an interval of densities; returns ``evaluate(rho_n, e_n)``
    applies : function of a law; returns whether the method can evaluate it
    reason : what it is and why one would take it, in a line
    conditioning : rank among the methods that cost the same, 0 the best conditioned one
    store : function of a law and float64 densities; returns what the method keeps of them, if not those
    """

    name: str
    reason: str
    prepare: Callable[[EOS, float, float], Evaluate]
    applies: Callable[[EOS], bool] = lambda law: True
    conditioning: int = 1
    store: Callable[[EOS, FloatArray], Any] | None = None

    def stored(self, law: EOS, rho_n: FloatArray) -> Any:
        """Return densities as the method keeps them between evaluations."""
        return rho_n if self.store is None else self.store(law, rho_n)

    def function(self, law: EOS, low: float, high: float) -> Evaluate:
        """Return the method as a function of float64 densities, whatever it keeps of them."""
        evaluate = self.prepare(law, low, high)
        return lambda rho_n, e_n: np.asarray(evaluate(self.stored(law, rho_n), e_n), float)


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


def _float32(law: EOS, low: float, high: float, excess: bool = False) -> Evaluate:
    from eos_ref.methods import single

    return partial(single.pressure, law, excess=excess)


def _single(law: EOS, rho_n: FloatArray) -> Any:
    return rho_n.astype(np.float32)


def _linear_table(law: EOS, low: float, high: float) -> Evaluate:
    rho_k = np.linspace(low, high, NODES)
    p_k = np.asarray(law.evaluate(rho_k))
    return lambda rho_n, e_n: np.interp(rho_n, rho_k, p_k)


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
        "float32 excess",
        "rho - rho0 stored in single precision, the law in double",
        partial(_float32, excess=True),
        conditioning=2,
        store=lambda law, rho_n: (rho_n - law.rho0).astype(np.float32),
    ),
    LawMethod(
        "float32 state",
        "the density stored in single precision, the law in double",
        _float32,
        conditioning=4,
        store=_single,
    ),
    LawMethod("float32", "density and law in single precision", _numpy, conditioning=5, store=_single),
    LawMethod(
        "table, cubic",
        f"interpolated between {NODES} values and slopes on either side of rho0",
        _cubic_table,
        lambda law: not law.needs_energy,
        6,
    ),
    LawMethod(
        "table, linear", f"interpolated between {NODES} values", _linear_table, lambda law: not law.needs_energy, 7
    ),
)


def methods_of(law: EOS) -> list[LawMethod]:
    """Return the methods that can evaluate a law."""
    return [method for method in METHODS if method.applies(law)]
