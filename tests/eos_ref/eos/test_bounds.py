"""The derived bounds: wide enough for every order of operations of the documented formula, but not much wider."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from flint import arb

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds
from tests.support.eos_cases import BACKGROUNDS, EPS, LAWS, RHO0, FloatArray, allowed, densities, energies, exact

Order = Callable[[EOS, float, float], float]


def power(x: float, g: float) -> float:
    """``pow`` as C has it: infinite where Python's raises."""
    try:
        return math.pow(x, g)
    except (OverflowError, ValueError):  # beyond the largest float; a negative power of 0
        return math.inf


# The manual's formula as a programmer might write it: other orders, hoisted quotients, expanded brackets.
ORDERS: dict[str, list[Order]] = {
    "linear": [
        lambda law, rho, e: law.cs * law.cs * (rho - law.rho0),
        lambda law, rho, e: law.cs * (law.cs * (rho - law.rho0)),
        lambda law, rho, e: law.cs * law.cs * rho - law.cs * law.cs * law.rho0,
        lambda law, rho, e: (rho - law.rho0) / (1 / (law.cs * law.cs)),
    ],
    "cubic": [
        lambda law, rho, e: law.cs**2 * ((rho - law.rho0) + law.parameter * power(rho - law.rho0, 3)),
        lambda law, rho, e: law.cs**2 * (rho - law.rho0) * (1 + law.parameter * (rho - law.rho0) * (rho - law.rho0)),
        lambda law, rho, e: (
            law.cs * law.cs * (rho - law.rho0)
            + law.cs * law.cs * law.parameter * (rho - law.rho0) * (rho - law.rho0) * (rho - law.rho0)
        ),
        lambda law, rho, e: (law.parameter * power(rho - law.rho0, 3) + rho - law.rho0) * law.cs * law.cs,
    ],
    "tait": [
        lambda law, rho, e: law.cs**2 * law.rho0 / law.gamma * (power(rho / law.rho0, law.gamma) - 1),
        lambda law, rho, e: law.cs * law.cs * law.rho0 * (1 / law.gamma) * (power(rho * (1 / law.rho0), law.gamma) - 1),
        lambda law, rho, e: (power(rho / law.rho0, law.gamma) - 1) / law.gamma * law.rho0 * law.cs * law.cs,
        lambda law, rho, e: (
            law.cs**2 * law.rho0 / law.gamma * power(rho / law.rho0, law.gamma) - law.cs**2 * law.rho0 / law.gamma
        ),
    ],
    "ideal/gas": [
        lambda law, rho, e: (law.gamma - 1) * rho * e,
        lambda law, rho, e: (law.gamma - 1) * (rho * e),
        lambda law, rho, e: law.gamma * rho * e - rho * e,
        lambda law, rho, e: (law.gamma - 1) * (e * 3.7) * rho / 3.7,  # energy of a particle of mass 3.7
    ],
}


def orders(law: EOS) -> list[Order]:
    return ORDERS["tait" if law.style.startswith("tait") else law.style]


def ratios(law: EOS, order: Order, rho_n: FloatArray) -> FloatArray:
    """Error over `bounds.engine`, per density."""
    e_n = energies(law, rho_n)
    bound_n = bounds.engine(law, rho_n, e_n)
    ratio_n = np.zeros(rho_n.size)
    for i, rho in enumerate(rho_n):
        e = 0.0 if e_n is None else float(e_n[i])
        value = order(law, float(rho), e) + law.background
        if math.isfinite(value) and math.isfinite(bound_n[i]):
            true = exact(law, float(rho), e if law.needs_energy else None)
            ratio_n[i] = float((abs(arb(value) - true) / arb(float(bound_n[i]))).upper())
    return ratio_n


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("background", BACKGROUNDS)
def test_every_order_of_operations_is_inside(name: str, background: float) -> None:
    law = replace(LAWS[name], background=background)
    rho_n = densities(law)
    for k, order in enumerate(orders(law)):
        ratio_n = ratios(law, order, rho_n)
        worst = int(np.argmax(ratio_n))
        assert ratio_n[worst] <= 1, f"order {k}, rho={rho_n[worst]!r}: {ratio_n[worst]:.3g} bounds"


@pytest.mark.parametrize("name", LAWS)
def test_the_bound_is_not_absurdly_loose(name: str) -> None:
    """A worst case of k roundings, all of one sign: measured errors come within 1/1000 of it, mostly a few per cent."""
    law = LAWS[name]
    worst = max(ratios(law, order, densities(law)).max() for order in orders(law))
    assert worst > 1e-3, f"{worst:.2g} of the bound"


@pytest.mark.parametrize("name", LAWS)
def test_lost_digit_is_outside(name: str) -> None:
    """An engine in single precision, or with the product of its parameters in it, leaves the bound."""
    law = LAWS[name]
    rho_n = RHO0 * np.linspace(1.2, 1.5, 30)
    e_n = energies(law, rho_n)
    single = law.evaluate(rho_n.astype(np.float32), None if e_n is None else e_n.astype(np.float32))
    error_n = np.array(
        [
            float(abs(arb(float(p)) - exact(law, float(rho), None if e_n is None else float(e_n[i]))))
            for i, (rho, p) in enumerate(zip(rho_n, single, strict=True))
        ]
    )
    outside = error_n > bounds.engine(law, rho_n, e_n)
    assert outside.mean() > 0.5


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("background", BACKGROUNDS)
def test_reference_is_the_documented_bound(name: str, background: float) -> None:
    """`bounds.reference` against the same bound in exact arithmetic; its own few roundings are 2^-40 at most here.

    The largest come from the terms themselves, good to 4 eps (1 + |gamma ln x|), |gamma ln x| < 2^11.
    """
    law = replace(LAWS[name], background=background)
    rho_n = densities(law)
    e_n = energies(law, rho_n)
    for i, bound in enumerate(bounds.reference(law, rho_n, e_n)):
        true = allowed(law, float(rho_n[i]), None if e_n is None else float(e_n[i]))
        if not math.isfinite(bound):  # the terms overflow, or nearly so
            assert true / (5 * EPS) > 1e300, f"rho={rho_n[i]!r}"
        elif bound > 1e-290:
            # the condition goes through ln(rho) - ln(rho0), good to 2^-43 of 1: gamma up to 150 magnifies that
            assert abs(bound - true) <= true * 2.0**-35, f"rho={rho_n[i]!r}: {bound} and {true}"


def test_bounds_at_the_edges() -> None:
    for law in LAWS.values():
        with np.errstate(all="ignore"):
            assert np.isnan(bounds.engine(law, np.array([np.nan]), np.array([1.0])))
            assert np.isnan(bounds.reference(law, np.array([np.nan]), np.array([1.0])))
    water = LAWS["tait/water"]
    assert np.isinf(bounds.engine(water, np.array([1e300])))
    zero = bounds.reference(water, np.array([0.0]))[0]  # the logarithm is infinite there, the power exact
    assert zero == pytest.approx(4 * EPS * RHO0 * 13.7**2 / 7, rel=8 * EPS)  # a few products, half eps each


def test_near_overflow_the_bound_stays_finite() -> None:
    """eps times the terms is far below the largest float even where terms times condition are not."""
    law = LAWS["tait/general -1.3"]
    rho_n = np.array([3.95693e-230])
    bound = bounds.reference(law, rho_n)[0]
    assert math.isfinite(bound)
    assert float(abs(arb(float(law.pressure(rho_n)[0])) - exact(law, float(rho_n[0])))) <= bound


def test_derivation_is_printed() -> None:
    assert str(bounds.derivation(EOS("linear"))) == "3 roundings x 2^-53 x (c^2 (|rho| + rho0))"
    with_background = bounds.derivation(EOS("tait/water", background=2.0))
    assert with_background.operations == 27
    assert str(with_background).endswith("+ |P_b|)")


def test_comparison_adds_both_sides_per_type() -> None:
    table = EOSTable((EOS("linear", 2.0), EOS("ideal/gas", parameter=1.4), EOS("tait/water", 3.0, 4.0)))
    rho_n, e_n = np.linspace(1, 5, 9), np.linspace(1, 2, 9)
    type_n = np.array([1, 2, 3, 3, 2, 1, 1, 9, 0])
    bound_n = bounds.comparison(table, rho_n, type_n, e_n)
    for t in (1, 2, 3):
        of_type = type_n == t
        expected = bounds.engine(table[t], rho_n[of_type], e_n[of_type])
        expected = expected + bounds.reference(table[t], rho_n[of_type], e_n[of_type])
        assert np.array_equal(bound_n[of_type], expected)
    assert np.isnan(bound_n[7:]).all(), "a type without a law is never close"
    assert bounds.comparison(table, np.empty(0), np.empty(0, int)).shape == (0,)
