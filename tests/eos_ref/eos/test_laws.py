"""The laws against the manual's formulas in exact arithmetic, in every number type; records, bounds and roundings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

from eos_ref import EOS, EOSTable, InputError
from eos_ref.eos import bounds, lammps_rounding, laws, rigorous
from eos_ref.eos.registry import LAWS as RECORDS
from tests.support.eos_cases import (
    BACKGROUNDS,
    CS,
    EPS,
    LAWS,
    RHO0,
    TAIT,
    FloatArray,
    allowed,
    densities,
    energies,
    exact,
    has_value,
    near,
    violations,
    with_backgrounds,
)

UNDEFINED = {name: law for name, law in TAIT.items() if not has_value(law, -1.0) or not has_value(law, 0.0)}
every_law = pytest.mark.parametrize("name", LAWS)
every_way = pytest.mark.parametrize("method", ["pressure", "evaluate"])  # compiled, numpy


def arguments(law: EOS, rho_n: Any, e_n: Any, i: int) -> tuple[float, float | None]:
    return float(rho_n[i]), None if e_n is None else float(e_n[i])


@pytest.mark.parametrize("law", with_backgrounds())
@pytest.mark.parametrize("method", [pytest.param("pressure", marks=pytest.mark.slow), "evaluate"])
def test_pressure_is_within_its_bound(method: str, law: EOS) -> None:
    assert violations(law, getattr(law, method)) == []


# Roundings on the path near rho0, where every term but (rho - rho0), exact there, has a relative error (u = eps/2):
# linear: c*c, product. cubic: c*c, product, a3*d, *d, *d and the sum; for A3 > 0 nothing cancels, so 6 u at most;
# for A3 < 0 the five of the sum are magnified by (1 + 2|A3|d^2) / (1 - |A3|d^2), see below.
# water: 2 u of x = rho*(1/rho0), times the elasticity of the bracket, 3 (3.3 at x = 1.1); seven in the bracket;
# c*c, /7 and two products: 18 u.
# general: the logarithm, 1 + |y| times the relative error of y, expm1 and the prefactor: 4 eps (1 + |y|) + 2 eps.
# ideal gas: gamma - 1 and two products.
def relative_bound(law: EOS, rho: float) -> float:
    match law.style:
        case "linear":
            roundings = 2.0
        case "cubic":
            term = float(law.parameter) * (rho - law.rho0) ** 2
            roundings = 2 + 5 * (1 + 2 * abs(term)) / abs(1 + term)
        case "tait/water":
            roundings = 18
        case "tait/general":
            roundings = 8 * (1 + abs(law.gamma * np.log(rho / law.rho0))) + 4
        case _:
            roundings = 3
    return roundings * EPS / 2


@every_way
@every_law
def test_digits_are_kept_near_equilibrium(name: str, method: str) -> None:
    """The textbook form of a power law loses every digit at a compression of 1e-12; these keep all but a few."""
    law, rho_n = LAWS[name], near()
    if name == "cubic softening":  # nearer to the zero of the bracket than the first density beyond it
        rho_n = rho_n[np.abs(np.abs(rho_n - RHO0) * np.sqrt(2.3e-3) - 1) > 0.01]
    e_n = energies(law, rho_n)
    for i, p in enumerate(getattr(law, method)(rho_n, e_n)):
        true = exact(law, *arguments(law, rho_n, e_n, i))
        relative = float((abs(arb(float(p)) - true) / abs(true)).upper())
        assert relative <= relative_bound(law, float(rho_n[i])), f"rho={rho_n[i]!r}: {relative / EPS:.3g} eps"


@every_law
@pytest.mark.parametrize("background", [0.0, 50000.0, -50000.0])
def test_float32_stays_float32_and_within_its_bound(name: str, background: float) -> None:
    # Parameters that float32 holds exactly: rounding those of another law is not an error of evaluation.
    parameter = None if LAWS[name].parameter is None else float(np.float32(LAWS[name].parameter))
    law = replace(LAWS[name], rho0=997.25, cs=13.75, background=background, parameter=parameter)
    with np.errstate(over="ignore", under="ignore"):
        rho_n = densities(law).astype(np.float32)
        rho_n = rho_n[[has_value(law, float(rho)) for rho in rho_n]]
    e_n = energies(law, rho_n.astype(float))

    def pressure(rho: Any, e: Any = None) -> Any:
        p = law.evaluate(rho, e)
        assert p.dtype == np.float32
        return p

    narrow_n = None if e_n is None else e_n.astype(np.float32)
    assert violations(law, pressure, rho_n, narrow_n, 2.0**-23, 2.0**-149, float(np.finfo(np.float32).max)) == []


@pytest.mark.skipif(bool(np.finfo(np.longdouble).eps >= EPS), reason="long double is double here")
@every_law
def test_longdouble_has_its_own_digits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law, wide = LAWS[name], np.longdouble
    rho_n = densities(law)
    rho_n = rho_n[(np.abs(rho_n) > 1e-30) & (np.abs(rho_n) < 1e30)]
    e_n = energies(law, rho_n)
    p_n = law.evaluate(rho_n.astype(wide), None if e_n is None else e_n.astype(wide))
    assert p_n.dtype == wide
    monkeypatch.setattr(ctx, "prec", 200)
    for i, p in enumerate(p_n):
        true = exact(law, *arguments(law, rho_n, e_n, i))
        if np.isfinite(float(p)) and float(abs(true)) <= 1e300:
            high = float(p)  # a long double is the sum of two doubles
            error = abs(arb(high) + arb(float(p - wide(high))) - true)
            bound = allowed(law, *arguments(law, rho_n, e_n, i), float(np.finfo(wide).eps))
            assert error <= bound, f"rho={rho_n[i]!r}: {float(error) / bound:.3g} bounds"


@every_law
def test_nan_and_infinity_stay_visible(name: str) -> None:
    law = LAWS[name]
    e = np.array([2.5]) if law.needs_energy else None
    for pressure in (law.pressure, law.evaluate):
        with np.errstate(all="ignore"):
            assert np.isnan(pressure(np.array([np.nan]), e))[0]
            p = pressure(np.array([np.inf]), e)[0]
        if law.style == "tait/general" and law.gamma < 0:  # the power vanishes
            assert p == pytest.approx(-(law.cs**2) * law.rho0 / law.gamma, rel=4 * EPS)  # 4 products, half eps each
        elif law.style == "cubic" and law.parameter <= 0:  # inf - inf, or 0 times inf
            assert p == -np.inf or np.isnan(p)
        else:
            assert p == np.inf


@pytest.mark.parametrize("name", UNDEFINED)
@every_way
def test_no_real_power_is_nan_or_infinite(name: str, method: str) -> None:
    law = UNDEFINED[name]
    rho_n = np.array([rho for rho in (-1e-300, -0.3, -997.3, -1e300, 0.0) if not has_value(law, rho)])
    p_n, pole = getattr(law, method)(rho_n), rho_n == 0  # a negative power of nothing: P -> -inf, as gamma divides
    assert np.all(np.isnan(p_n[~pole])) and np.all(p_n[pole] == -np.inf), dict(zip(rho_n, p_n, strict=True))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (EOS("tait/general", RHO0, CS, 7.0), EOS("tait/water", RHO0, CS)),
        (EOS("tait/general", RHO0, CS, 1.0), EOS("linear", RHO0, CS)),
        (EOS("cubic", RHO0, CS, 0.0), EOS("linear", RHO0, CS)),
    ],
)
def test_equivalent_laws(one: EOS, other: EOS) -> None:
    for rho in map(float, densities(one)):
        a, b = rigorous.pressure(one, rho), rigorous.pressure(other, rho)
        assert a.overlaps(b), f"rho={rho!r}: {a} and {b}"
        assert abs(a - b) <= abs(b) * arb(2) ** -50, f"rho={rho!r}: a ball is so wide that it overlaps everything"


# --- faults: a law of `laws`, and a body that differs from it in one point

FUNCTIONS = {style: style.replace("/", "_") for style in RECORDS}
FAULTS: dict[str, tuple[str, Callable[..., Any]]] = {
    "linear without rho0": ("linear", lambda rho, rho0, cs: cs * cs * rho),
    "linear with c": ("linear", lambda rho, rho0, cs: cs * (rho - rho0)),
    "linear swapped": ("linear", lambda rho, rho0, cs: laws.linear_stiffness(0 * rho, 0, rho0) * (rho - cs)),
    "cubic squared": ("cubic", lambda rho, rho0, cs, a: cs * cs * (rho - rho0 + a * (rho - rho0) ** 2)),
    "cubic sign": ("cubic", lambda rho, rho0, cs, a: cs * cs * (rho - rho0 - a * (rho - rho0) ** 3)),
    "cubic of the ratio": ("cubic", lambda rho, r, cs, a: cs * cs * (rho - r + a * ((rho - r) / r) ** 3)),
    "water to the sixth": ("tait_water", lambda rho, r, cs: cs * cs * r / 7 * ((rho / r) ** 6 - 1)),
    "water less nothing": ("tait_water", lambda rho, r, cs: cs * cs * r / 7 * (rho / r) ** 7),
    "water with c": ("tait_water", lambda rho, r, cs: cs * r / 7 * ((rho / r) ** 7 - 1)),
    "water off by 1e-13": ("tait_water", lambda rho, r, cs: (1 + 1e-13) * cs * cs * r / 7 * ((rho / r) ** 7 - 1)),
    "general undivided": ("tait_general", lambda rho, r, cs, g: cs * cs * r * ((rho / r) ** g - 1)),
    "general inverted": ("tait_general", lambda rho, r, cs, g: cs * cs * r / g * ((r / rho) ** g - 1)),
    "general exponent off by 1e-13": (
        *("tait_general", lambda rho, r, cs, g: cs * cs * r / g * ((rho / r) ** (g * (1 + 1e-13)) - 1)),
    ),
    "gas with gamma": ("ideal_gas", lambda rho, e, g: g * rho * e),
    "gas without gamma": ("ideal_gas", lambda rho, e, g: rho * e),
    "gas off by 1e-14": ("ideal_gas", lambda rho, e, g: (1 + 1e-14) * (g - 1) * rho * e),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_wrong_formula_is_detected(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The comparison of this file, with a fault planted in the law, must fail for every law of that style."""
    function, wrong = FAULTS[fault]
    monkeypatch.setattr(laws, function, wrong)
    hit = [law for law in LAWS.values() if FUNCTIONS[law.style] == function and law.parameter not in (0.0, 1.0)]
    assert hit and all(violations(law, law.evaluate) for law in hit)


@every_law
def test_wrong_parameter_is_detected(name: str) -> None:
    """Compiled and numpy values with one parameter moved, against the exact pressure of the true one."""
    law = replace(LAWS[name], background=1e4)
    moved = [replace(law, background=-1e4), replace(law, background=0.0)]
    if law.law.takes_cs:
        moved += [replace(law, rho0=law.cs, cs=law.rho0), replace(law, rho0=law.rho0 * (1 + 1e-12))]
        moved += [replace(law, cs=law.cs * (1 + 1e-12))]
    if law.parameter:
        moved += [replace(law, parameter=law.parameter * (1 + 1e-10))]
    for wrong in moved:
        assert violations(law, wrong.pressure) and violations(law, wrong.evaluate), f"{wrong} passes as {law}"


@pytest.mark.parametrize("name", ["linear", "cubic softening", "tait/water", "tait/general 4.3", "ideal/gas"])
def test_all_number_types_share_one_body(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law, calls = LAWS[name], []
    function = FUNCTIONS[law.style]
    body = getattr(laws, function)

    def watched(*given: Any) -> Any:
        calls.append(type(given[0]))
        return body(*given)

    monkeypatch.setattr(laws, function, watched)
    for number in (np.float32, np.float64, np.longdouble):
        assert type(law.evaluate(number(1000), number(2.5) if law.needs_energy else None)) is number
    rigorous.pressure(law, 1000.0, 2.5 if law.needs_energy else None)
    assert calls == [np.float32, np.float64, np.longdouble, arb]


# --- records, in rational numbers

RHO, E, R0, C0 = Fraction(13, 11), Fraction(5, 7), Fraction(9, 8), Fraction(3, 2)
POLYNOMIAL = ("linear", "cubic", "ideal/gas")  # which rational numbers go through
EXAMPLES = {style: Fraction(0 if law.example is None else law.example) for style, law in RECORDS.items()}


@pytest.mark.parametrize("style", RECORDS)
def test_example_is_valid_and_increases_with_density_about_rho0(style: str) -> None:
    law, example = RECORDS[style], float(EXAMPLES[style])
    assert law.style == style and (law.parameter is None) == (law.example is None)
    assert bool(law.rule) <= bool(law.parameter) and law.allows(example)
    low, high = law.monotone(float(R0), example)
    assert law.defined(example).low <= low < R0 < high <= law.defined(example).high
    of_cs = law.pressure(float(RHO), float(E), float(R0), 2 * float(C0), example)
    assert (of_cs != law.pressure(float(RHO), float(E), float(R0), float(C0), example)) == law.takes_cs


def test_laws_differ_at_the_examples() -> None:
    rho, e, rho0, cs = (float(number) for number in (RHO, E, R0, C0))
    pressures = {law.pressure(rho, e, rho0, cs, float(EXAMPLES[style])) for style, law in RECORDS.items()}
    assert len(pressures) == len(RECORDS)


@pytest.mark.parametrize("style", POLYNOMIAL)
def test_terms_bound_the_pressure_and_stiffness_is_its_slope(style: str) -> None:
    law, a, h = RECORDS[style], EXAMPLES[style], Fraction(1, 1000)
    p = law.pressure(RHO, E, R0, C0, a)
    assert isinstance(p, Fraction) and abs(p) <= law.terms(RHO, E, R0, C0, a)
    up, down = (law.pressure(RHO + sign * h, E, R0, C0, a) for sign in (1, -1))
    # A cubic's central difference is its slope and cs^2 A3 h^2.
    assert (up - down) / (2 * h) - (C0**2 * a * h**2 if style == "cubic" else 0) == law.stiffness(RHO, E, R0, C0, a)
    if law.energy:
        rise = law.pressure(RHO, E + h, R0, C0, a) - p
        assert rise / h == law.energy.slope(RHO, E, R0, C0, a), "linear in the energy"
        assert law.density(p, E, R0, C0, a) == RHO and law.energy.sound_squared(E, a) == law.stiffness(
            RHO, E, R0, C0, a
        )
        inverse = law.energy.inverse_slope(RHO, E, R0, C0, a)
        assert law.stiffness(RHO, E, R0, C0, a) * inverse == law.energy.slope(RHO, E, R0, C0, a)


# --- Arb


@pytest.mark.parametrize("law", with_backgrounds())
def test_rigorous_agrees_with_the_manual(law: EOS, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shared body in balls against an independent formula: equal to 100 bits, of the terms where P is 0."""
    rho_n = densities(law)[::3]
    e_n = energies(law, rho_n)
    monkeypatch.setattr(ctx, "prec", 300)
    for i, rho in enumerate(rho_n):
        given = arguments(law, rho_n, e_n, i)
        ours, true = rigorous.pressure(law, *given), exact(law, *given)
        assert ours.overlaps(true), f"rho={rho!r}"
        if rho != law.rho0 or law.background:  # where the pressure is 0, no digit of it can be required
            assert ours.rad() <= abs(true) * arb(2) ** -99, f"rho={rho!r}"


@pytest.mark.parametrize("bits", [20, 60, 100, 400])  # 20: less than the cancellation costs
@every_law
def test_relative_accuracy_survives_cancellation(name: str, bits: int) -> None:
    law = LAWS[name]
    for rho in (RHO0 * (1 + 1e-13), RHO0 * (1 - 1e-9), 2 * RHO0, 1e-200):
        assert rigorous.pressure(law, rho, 2.5 if law.needs_energy else None, bits).rel_accuracy_bits() >= bits


@pytest.mark.parametrize("law", TAIT.values(), ids=TAIT)
def test_zero_pressure_terminates_and_undefined_is_refused(law: EOS) -> None:
    """At rho0 no relative accuracy can be reached; a background that cancels to the last bit terminates, too."""
    assert rigorous.pressure(law, RHO0).contains(0)
    there = rigorous.pressure(law, RHO0 * 1.5)
    rest = rigorous.pressure(replace(law, background=-float(there)), RHO0 * 1.5)
    assert abs(rest) <= abs(there) * 2.0**-52
    for rho in (-1.0, 0.0, math.nan, math.inf):
        if has_value(law, rho):
            assert rigorous.pressure(law, rho).is_finite()
        else:
            with pytest.raises(InputError, match="must lie within"):
                rigorous.pressure(law, rho)


def test_precision_of_arb_is_left_alone_and_arguments_are_exact() -> None:
    before = ctx.prec
    rigorous.pressure(LAWS["tait/water"], 1.0, bits=500)
    with pytest.raises(InputError, match="energy"):
        rigorous.pressure(LAWS["ideal/gas"], 1.0)
    assert ctx.prec == before
    law, rho = EOS("linear", np.float32(0.1), np.float32(1.1)), np.float32(0.7)
    true = (arb(float(rho)) - arb(float(np.float32(0.1)))) * arb(float(np.float32(1.1))) ** 2
    assert rigorous.pressure(law, float(rho)).overlaps(true)


def test_error_is_never_below_the_truth() -> None:
    before, ctx.prec = ctx.prec, 300
    third = arb(1) / 3
    true = abs(arb(1 / 3) - third)
    ctx.prec = before
    found = arb(rigorous.error(1 / 3, third))
    assert true <= found <= true * (1 + arb(2) ** -50)  # the default precision, 53 bits, rounds twice
    assert rigorous.error(1.5, arb(1)) == 0.5
    assert rigorous.error(math.nan, third) == rigorous.error(math.inf, third) == math.inf


# --- bounds

Order = Callable[[EOS, float, float], float]


def power(x: float, g: float) -> float:
    """``pow`` as C has it: infinite where Python's raises."""
    try:
        return math.pow(x, g)
    except (OverflowError, ValueError):  # beyond the largest float; a negative power of 0
        return math.inf


# The manual's formula as a programmer might write it: other orders, hoisted quotients, expanded brackets.
TAIT_ORDERS: list[Order] = [
    lambda law, rho, e: law.cs**2 * law.rho0 / law.gamma * (power(rho / law.rho0, law.gamma) - 1),
    lambda law, rho, e: law.cs * law.cs * law.rho0 * (1 / law.gamma) * (power(rho * (1 / law.rho0), law.gamma) - 1),
    lambda law, rho, e: (power(rho / law.rho0, law.gamma) - 1) / law.gamma * law.rho0 * law.cs * law.cs,
    lambda law, rho, e: (
        law.cs**2 * law.rho0 / law.gamma * power(rho / law.rho0, law.gamma) - law.cs**2 * law.rho0 / law.gamma
    ),
]
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
    "tait/water": TAIT_ORDERS,
    "tait/general": TAIT_ORDERS,
    "ideal/gas": [
        lambda law, rho, e: (law.gamma - 1) * rho * e,
        lambda law, rho, e: (law.gamma - 1) * (rho * e),
        lambda law, rho, e: law.gamma * rho * e - rho * e,
        lambda law, rho, e: (law.gamma - 1) * (e * 3.7) * rho / 3.7,  # energy of a particle of mass 3.7
    ],
}


def ratios(law: EOS, order: Order, rho_n: FloatArray) -> FloatArray:
    """Error over `bounds.engine`, per density."""
    e_n, ratio_n = energies(law, rho_n), np.zeros(rho_n.size)
    bound_n = bounds.engine(law, rho_n, e_n)
    for i in range(rho_n.size):
        rho, e = arguments(law, rho_n, e_n, i)
        value = order(law, rho, e or 0.0) + law.background
        if math.isfinite(value) and math.isfinite(bound_n[i]):
            ratio_n[i] = float((abs(arb(value) - exact(law, rho, e)) / arb(float(bound_n[i]))).upper())
    return ratio_n


@every_law
@pytest.mark.parametrize("background", BACKGROUNDS)
def test_every_order_of_operations_is_inside(name: str, background: float) -> None:
    """A worst case of k roundings, all of one sign: measured errors come within 1/1000 of it, mostly a few per cent."""
    law = replace(LAWS[name], background=background)
    rho_n = densities(law)
    worst = [ratios(law, order, rho_n) for order in ORDERS[law.style]]
    for k, ratio_n in enumerate(worst):
        assert ratio_n.max() <= 1, f"order {k}, rho={rho_n[ratio_n.argmax()]!r}: {ratio_n.max():.3g} bounds"
    assert background or np.max(worst) > 1e-3, "the bound is absurdly loose"


@every_law
def test_lost_digit_is_outside(name: str) -> None:
    """An engine in single precision, or with the product of its parameters in it, leaves the bound."""
    law, rho_n = LAWS[name], RHO0 * np.linspace(1.2, 1.5, 30)
    e_n = energies(law, rho_n)
    single = law.evaluate(rho_n.astype(np.float32), None if e_n is None else e_n.astype(np.float32))
    true = [exact(law, *arguments(law, rho_n, e_n, i)) for i in range(30)]
    error_n = np.array([float(abs(arb(float(p)) - t)) for p, t in zip(single, true, strict=True)])
    assert (error_n > bounds.engine(law, rho_n, e_n)).mean() > 0.5


@every_law
@pytest.mark.parametrize("background", BACKGROUNDS)
def test_reference_is_the_documented_bound(name: str, background: float) -> None:
    """`bounds.reference` against the same bound in exact arithmetic; its own few roundings are 2^-40 at most here.

    The largest come from the terms themselves, good to 4 eps (1 + |gamma ln x|), |gamma ln x| < 2^11.
    """
    law = replace(LAWS[name], background=background)
    rho_n = densities(law)
    e_n = energies(law, rho_n)
    for i, bound in enumerate(bounds.reference(law, rho_n, e_n)):
        true = allowed(law, *arguments(law, rho_n, e_n, i))
        if not math.isfinite(bound):  # the terms overflow, or nearly so
            assert true / (5 * EPS) > 1e300, f"rho={rho_n[i]!r}"
        elif bound > 1e-290:
            # the condition goes through ln(rho) - ln(rho0), good to 2^-43 of 1: gamma up to 150 magnifies that
            assert abs(bound - true) <= true * 2.0**-35, f"rho={rho_n[i]!r}: {bound} and {true}"


def test_bounds_at_the_edges() -> None:
    for law in LAWS.values():
        with np.errstate(all="ignore"):
            for bound in (bounds.engine, bounds.reference):
                assert np.isnan(bound(law, np.array([np.nan]), np.array([1.0])))
    water, negative = LAWS["tait/water"], LAWS["tait/general -1.3"]
    assert np.isinf(bounds.engine(water, np.array([1e300])))
    zero = bounds.reference(water, np.array([0.0]))[0]  # the logarithm is infinite there, the power exact
    assert zero == pytest.approx(4 * EPS * RHO0 * CS**2 / 7, rel=8 * EPS)  # a few products, half eps each
    # eps times the terms is far below the largest float even where terms times condition are not
    rho_n = np.array([3.95693e-230])
    bound = bounds.reference(negative, rho_n)[0]
    assert math.isfinite(bound)
    assert float(abs(arb(float(negative.pressure(rho_n)[0])) - exact(negative, float(rho_n[0])))) <= bound


def test_derivation_is_printed() -> None:
    assert str(bounds.derivation(EOS("linear"))) == "3 roundings x 2^-53 x (c^2 (|rho| + rho0))"
    with_background = bounds.derivation(EOS("tait/water", background=2.0))
    assert with_background.operations == 27 and str(with_background).endswith("+ |P_b|)")


def test_comparison_adds_both_sides_per_type() -> None:
    table = EOSTable((EOS("linear", 2.0), EOS("ideal/gas", parameter=1.4), EOS("tait/water", 3.0, 4.0)))
    rho_n, e_n, type_n = np.linspace(1, 5, 9), np.linspace(1, 2, 9), np.array([1, 2, 3, 3, 2, 1, 1, 9, 0])
    bound_n = bounds.comparison(table, rho_n, type_n, e_n)
    for t in (1, 2, 3):
        given = table[t], rho_n[type_n == t], e_n[type_n == t]
        assert np.array_equal(bound_n[type_n == t], bounds.engine(*given) + bounds.reference(*given))
    assert np.isnan(bound_n[7:]).all(), "a type without a law is never close"
    assert bounds.comparison(table, np.empty(0), np.empty(0, int)).shape == (0,)


# --- LAMMPS' order of operations: each rounding where a scalar evaluation in that order has it

RHO_N = np.random.default_rng(1).uniform(0.6, 1.3, 500)
ENERGY_N, MASS_N = np.random.default_rng(2).uniform(0.5, 3.0, (2, 500))
R, C, A = 0.93, 3.1, 2.3
SCALARS: dict[str, Callable[[float, float, float], float]] = {
    "linear": lambda rho, energy, mass: C * C * (rho - R),
    "cubic": lambda rho, energy, mass: C * C * ((rho - R) + A * (rho - R) * (rho - R) * (rho - R)),
    "tait/water": lambda rho, energy, mass: (
        C * C * R * (1.0 / 7.0) * (cubed(rho * (1.0 / R)) * cubed(rho * (1.0 / R)) * (rho * (1.0 / R)) - 1.0)
    ),
    "tait/general": lambda rho, energy, mass: C * C * R * (math.pow(rho * (1.0 / R), A) - 1.0) / A,
    "ideal/gas": lambda rho, energy, mass: (A - 1.0) * rho * energy / mass,
}
ROUNDED = {style: EOS(style, R, C, A if RECORDS[style].parameter else None) for style in SCALARS}


def cubed(x: float) -> float:
    return x * x * x


@pytest.mark.parametrize("style", RECORDS)
def test_bits_are_those_of_scalars_in_the_same_order(style: str) -> None:
    """And the law agrees with the reference within the bound."""
    law, e_n = ROUNDED[style], ENERGY_N / MASS_N
    states = zip(RHO_N.tolist(), ENERGY_N.tolist(), MASS_N.tolist(), strict=True)
    own_n = lammps_rounding.pressure_of_law(law, RHO_N, ENERGY_N, MASS_N)
    np.testing.assert_array_equal(own_n, [SCALARS[style](*state) for state in states])
    bound_n = bounds.comparison(EOSTable([law]), RHO_N, np.ones(RHO_N.size, int), e_n)
    assert (np.abs(own_n - law.evaluate(RHO_N, e_n if law.needs_energy else None)) <= bound_n).all()
    assert bound_n.max() < 1e-12 * np.abs(own_n).max()
    moved_n = lammps_rounding.pressure_of_law(replace(law, background=0.1), RHO_N, ENERGY_N, MASS_N)
    np.testing.assert_array_equal(moved_n, own_n + 0.1)  # it is added last


def test_every_particle_uses_the_law_of_its_type() -> None:
    table, type_n = EOSTable([ROUNDED["linear"], ROUNDED["ideal/gas"]]), np.arange(RHO_N.size) % 2 + 1
    p_n = lammps_rounding.pressure(table, RHO_N, type_n, ENERGY_N, MASS_N)
    for t, law in enumerate(table.laws, 1):
        given = (values[type_n == t] for values in (RHO_N, ENERGY_N, MASS_N))
        np.testing.assert_array_equal(p_n[type_n == t], lammps_rounding.pressure_of_law(law, *given))


@pytest.mark.parametrize(("rho", "gamma"), [(-1.0, 2.5), (0.0, -1.0), (1e200, 9.0)])
def test_undefined_powers_follow_the_c_library(rho: float, gamma: float) -> None:
    """Where `math.pow` raises: a root of a negative number, a pole, an overflow."""
    p = lammps_rounding.pressure_of_law(EOS("tait/general", 1.0, 1.0, gamma), np.array([rho]), None, None)[0]
    assert math.isnan(p) if rho < 0 else math.isinf(p)
