"""Tait's law by its series: coefficients in closed form, and the truncation error."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from eos_ref import EOS
from eos_ref.methods import series


@pytest.mark.parametrize("gamma", [1.0, 2.0, 3.0, 4.0, 7.0])
def test_series_of_a_whole_exponent_is_the_polynomial(gamma: float) -> None:
    """Binomial coefficients over gamma, finitely many; for numbers this small only the quotient is rounded."""
    coefficient_k = series.coefficients(EOS("tait/general", 1.0, 1.0, gamma), 0.5)
    binomial = [Fraction(1)]
    for k in range(1, int(gamma)):
        binomial.append(binomial[-1] * (int(gamma) - k) / (k + 1))
    assert coefficient_k.tolist() == [float(each) for each in binomial]


@pytest.mark.parametrize(("gamma", "reach"), [(1.4, 0.05), (7.15, 0.1), (-2.5, 0.02), (0.5, 1e-6)])
def test_truncation_error_is_below_half_an_ulp(gamma: float, reach: float) -> None:
    kept = len(series.coefficients(EOS("tait/general", 1.0, 1.0, gamma), reach))
    terms, exponent = [Fraction(1)], Fraction(gamma)
    for k in range(1, 200):
        terms.append(terms[-1] * (exponent - k) / (k + 1))
    left = sum(abs(term) * Fraction(reach) ** k for k, term in enumerate(terms) if k >= kept)
    assert 0 < left < Fraction(2) ** -54
    assert kept < series.MOST and abs(terms[kept - 1]) * Fraction(reach) ** (kept - 1) > Fraction(2) ** -60, "few"


def test_number_of_terms_is_limited_by_the_cost_of_a_power() -> None:
    assert len(series.coefficients(EOS("tait/general", 1.0, 1.0, 1.4), 0.999)) == series.MOST


def test_pressure_of_a_parabola_is_exact() -> None:
    """P = c^2 rho0 d (1 + d/2) + P_b for gamma = 2, in numbers of few digits."""
    law = EOS("tait/general", 2.0, 4.0, 2.0, background=3.0)
    rho_n = np.array([2.0, 2.5, 1.5, 3.0])
    d_n = (rho_n - 2.0) / 2.0
    assert np.array_equal(series.pressure(law, series.coefficients(law, 0.5), rho_n), 32 * d_n * (1 + d_n / 2) + 3.0)
    assert series.pressure(law, np.ones(1), np.empty(0)).shape == (0,)
