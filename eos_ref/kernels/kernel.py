"""One kernel: shape, slope, support and normalisation; both evaluators take it from here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Kernel:
    r"""A spherical kernel :math:`W(r) = \sigma\,w(q)` of :math:`q = r/h`, 0 from ``support`` on.

    Attributes
    ----------
    name : str
    support : float
        Support radius over smoothing length, cut/h.
    factor : function of dimension and h
        :math:`\sigma`, which makes the integral over space 1 (1/length**d).
    shape, slope : functions of q
        :math:`w` and its derivative :math:`w'`, in plain operators and `eos_ref.numbers.elementary` functions: the same
        bodies serve numpy arrays, compiled loops and numbers that carry their rounding error.
    """

    name: str
    support: float
    factor: Callable[[int, float], float]
    shape: Callable[[Any], Any]
    slope: Callable[[Any], Any]

    def normalisation(self, dimension: int, cut: float) -> float:
        r"""Return the factor :math:`\sigma` of a support radius (1/length**d)."""
        return self.factor(dimension, cut / self.support)

    def self_value(self, dimension: int, cut: float) -> float:
        """Return W(0) (1/length**d)."""
        return float(self.shape(0.0)) * self.normalisation(dimension, cut)
