"""The laws against the manual's formulas in exact arithmetic, over the whole domain and in every number type."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

from eos_ref import EOS
from eos_ref.eos import laws, rigorous
from tests.support.eos_cases import (
    EPS,
    LAWS,
    RHO0,
    TAIT,
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


@pytest.mark.parametrize("law", with_backgrounds())
def test_numpy_pressure_within_the_bound(law: EOS) -> None:
    assert violations(law, law.evaluate) == []


@pytest.mark.slow
@pytest.mark.parametrize("law", with_backgrounds())
def test_compiled_pressure_within_the_bound(law: EOS) -> None:
    assert violations(law, law.pressure) == []


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


@pytest.mark.parametrize("method", ["pressure", "evaluate"])
@pytest.mark.parametrize("name", LAWS)
def test_digits_are_kept_near_equilibrium(name: str, method: str) -> None:
    """The textbook form of a power law loses every digit at a compression of 1e-12; these keep all but a few."""
    law = LAWS[name]
    rho_n = near()
    if name == "cubic softening":  # nearer to the zero of the bracket than the first density beyond it
        rho_n = rho_n[np.abs(np.abs(rho_n - RHO0) * np.sqrt(2.3e-3) - 1) > 0.01]
    e_n = energies(law, rho_n)
    for i, p in enumerate(getattr(law, method)(rho_n, e_n)):
        true = exact(law, float(rho_n[i]), None if e_n is None else float(e_n[i]))
        relative = float((abs(arb(float(p)) - true) / abs(true)).upper())
        assert relative <= relative_bound(law, float(rho_n[i])), f"rho={rho_n[i]!r}: {relative / EPS:.3g} eps"


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("background", [0.0, 50000.0, -50000.0])
def test_float32_stays_float32_and_within_its_bound(name: str, background: float) -> None:
    # Parameters that float32 holds exactly: rounding those of another law is not an error of evaluation.
    exact_parameter = LAWS[name].parameter
    if exact_parameter is not None:
        exact_parameter = float(np.float32(exact_parameter))
    law = replace(LAWS[name], rho0=997.25, cs=13.75, background=background, parameter=exact_parameter)
    with np.errstate(over="ignore", under="ignore"):
        rho_n = densities(law).astype(np.float32)
        rho_n = rho_n[[has_value(law, float(rho)) for rho in rho_n]]
    e_n = energies(law, rho_n.astype(float))
    narrow_n = None if e_n is None else e_n.astype(np.float32)

    def pressure(rho: Any, e: Any = None) -> Any:
        p = law.evaluate(rho, e)
        assert p.dtype == np.float32
        return p

    assert violations(law, pressure, rho_n, narrow_n, 2.0**-23, 2.0**-149, float(np.finfo(np.float32).max)) == []


@pytest.mark.parametrize("name", LAWS)
def test_scalars_keep_their_type(name: str) -> None:
    law = LAWS[name]
    for number in (np.float32, np.float64, np.longdouble):
        e = number(2.5) if law.needs_energy else None
        assert type(law.evaluate(number(1000), e)) is number


@pytest.mark.skipif(bool(np.finfo(np.longdouble).eps >= EPS), reason="long double is double here")
@pytest.mark.parametrize("name", LAWS)
def test_longdouble_has_its_own_digits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law = LAWS[name]
    rho_n = densities(law)
    rho_n = rho_n[(np.abs(rho_n) > 1e-30) & (np.abs(rho_n) < 1e30)]
    e_n = energies(law, rho_n)
    wide = np.longdouble
    p_n = law.evaluate(rho_n.astype(wide), None if e_n is None else e_n.astype(wide))
    assert p_n.dtype == wide
    monkeypatch.setattr(ctx, "prec", 200)
    eps = float(np.finfo(wide).eps)
    for i, p in enumerate(p_n):
        true = exact(law, float(rho_n[i]), None if e_n is None else float(e_n[i]))
        if not np.isfinite(float(p)) or float(abs(true)) > 1e300:
            continue
        high = float(p)  # a long double is the sum of two doubles
        error = abs(arb(high) + arb(float(p - wide(high))) - true)
        bound = allowed(law, float(rho_n[i]), None if e_n is None else float(e_n[i]), eps)
        assert error <= bound, f"rho={rho_n[i]!r}: {float(error) / bound:.3g} bounds"


@pytest.mark.parametrize("name", LAWS)
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
@pytest.mark.parametrize("method", ["pressure", "evaluate"])
def test_no_real_power_is_nan_or_infinite(name: str, method: str) -> None:
    law = UNDEFINED[name]
    rho_n = np.array([rho for rho in (-1e-300, -0.3, -997.3, -1e300, 0.0) if not has_value(law, rho)])
    p_n = getattr(law, method)(rho_n)
    pole = rho_n == 0  # a negative power of nothing: P -> -inf, because gamma divides
    assert np.all(np.isnan(p_n[~pole])), dict(zip(rho_n, p_n, strict=True))
    assert np.all(p_n[pole] == -np.inf)


@pytest.mark.parametrize("law", with_backgrounds())
def test_rigorous_agrees_with_the_manual(law: EOS, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shared body in balls against an independent formula: equal to 100 bits, of the terms where P is 0."""
    rho_n = densities(law)[::3]
    e_n = energies(law, rho_n)
    monkeypatch.setattr(ctx, "prec", 300)
    for i, rho in enumerate(rho_n):
        e = None if e_n is None else float(e_n[i])
        ours, true = rigorous.pressure(law, float(rho), e), exact(law, float(rho), e)
        assert ours.overlaps(true), f"rho={rho!r}"
        if rho != law.rho0 or law.background:  # where the pressure is 0, no digit of it can be required
            assert ours.rad() <= abs(true) * arb(2) ** -99, f"rho={rho!r}"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (EOS("tait/general", RHO0, 13.7, 7.0), EOS("tait/water", RHO0, 13.7)),
        (EOS("tait/general", RHO0, 13.7, 1.0), EOS("linear", RHO0, 13.7)),
        (EOS("cubic", RHO0, 13.7, 0.0), EOS("linear", RHO0, 13.7)),
    ],
)
def test_equivalent_laws(one: EOS, other: EOS) -> None:
    for rho in densities(one):
        a, b = rigorous.pressure(one, float(rho)), rigorous.pressure(other, float(rho))
        assert a.overlaps(b), f"rho={rho!r}: {a} and {b}"
        assert abs(a - b) <= abs(b) * arb(2) ** -50, (
            f"rho={rho!r}"
        )  # and neither ball is so wide that it overlaps everything


LAW_OF_STYLE = {
    "linear": "linear",
    "cubic": "cubic",
    "tait/water": "tait_water",
    "tait/general": "tait_general",
    "ideal/gas": "ideal_gas",
}


@pytest.mark.parametrize("name", ["linear", "cubic softening", "tait/water", "tait/general 4.3", "ideal/gas"])
def test_all_number_types_share_one_body(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from eos_ref.eos import compiled

    law = LAWS[name]
    function = LAW_OF_STYLE[law.style]
    body = getattr(laws, function)
    assert compiled._BODIES[law.style].py_func is law.law.pressure
    assert function in law.law.pressure.__code__.co_names
    calls = []

    def watched(*arguments: Any) -> Any:
        calls.append(type(arguments[0]))
        return body(*arguments)

    monkeypatch.setattr(laws, function, watched)
    e = np.float64(2.5) if law.needs_energy else None
    for number in (np.float32, np.float64, np.longdouble):
        law.evaluate(number(1000), e)
    rigorous.pressure(law, 1000.0, e)
    assert calls == [np.float32, np.float64, np.longdouble, arb]


def _faults() -> dict[str, tuple[str, Callable[..., Any]]]:
    """A law of `laws` and a body that differs from it in one point."""
    return {
        "linear without rho0": ("linear", lambda rho, rho0, cs: cs * cs * rho),
        "linear with c": ("linear", lambda rho, rho0, cs: cs * (rho - rho0)),
        "linear swapped": ("linear", lambda rho, rho0, cs: laws.linear_stiffness(0 * rho, 0, rho0) * (rho - cs)),
        "cubic squared": ("cubic", lambda rho, rho0, cs, a3: cs * cs * (rho - rho0 + a3 * (rho - rho0) ** 2)),
        "cubic sign": ("cubic", lambda rho, rho0, cs, a3: cs * cs * (rho - rho0 - a3 * (rho - rho0) ** 3)),
        "cubic of the ratio": (
            "cubic",
            lambda rho, rho0, cs, a3: cs * cs * (rho - rho0 + a3 * ((rho - rho0) / rho0) ** 3),
        ),
        "water to the sixth": (
            "tait_water",
            lambda rho, rho0, cs: cs * cs * rho0 / 7 * ((rho / rho0) ** 6 - 1),
        ),
        "water less nothing": ("tait_water", lambda rho, rho0, cs: cs * cs * rho0 / 7 * (rho / rho0) ** 7),
        "water with c": ("tait_water", lambda rho, rho0, cs: cs * rho0 / 7 * ((rho / rho0) ** 7 - 1)),
        "water moved by 1e-13": (
            "tait_water",
            lambda rho, rho0, cs: (1 + 1e-13) * cs * cs * rho0 / 7 * ((rho / rho0) ** 7 - 1),
        ),
        "general undivided": ("tait_general", lambda rho, rho0, cs, g: cs * cs * rho0 * ((rho / rho0) ** g - 1)),
        "general inverted": (
            "tait_general",
            lambda rho, rho0, cs, g: cs * cs * rho0 / g * ((rho0 / rho) ** g - 1),
        ),
        "general exponent moved by 1e-13": (
            "tait_general",
            lambda rho, rho0, cs, g: cs * cs * rho0 / g * ((rho / rho0) ** (g * (1 + 1e-13)) - 1),
        ),
        "gas with gamma": ("ideal_gas", lambda rho, e, g: g * rho * e),
        "gas without gamma": ("ideal_gas", lambda rho, e, g: rho * e),
        "gas moved by 1e-14": ("ideal_gas", lambda rho, e, g: (1 + 1e-14) * (g - 1) * rho * e),
    }


@pytest.mark.parametrize("fault", _faults())
def test_wrong_formula_is_detected(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The comparison of this file, with a fault planted in the law, must fail for every law of that style."""
    function, wrong = _faults()[fault]
    monkeypatch.setattr(laws, function, wrong)
    hit = [law for law in LAWS.values() if LAW_OF_STYLE[law.style] == function and law.parameter not in (0.0, 1.0)]
    assert hit
    for law in hit:
        assert violations(law, law.evaluate), f"{fault} went unseen for {law}"


@pytest.mark.parametrize("name", LAWS)
def test_wrong_parameter_is_detected(name: str) -> None:
    """Compiled and numpy values with one parameter moved, against the exact pressure of the true one."""
    law = replace(LAWS[name], background=1e4)
    moved = [replace(law, background=-1e4), replace(law, background=0.0)]
    if not law.needs_energy:
        moved += [replace(law, rho0=law.cs, cs=law.rho0), replace(law, rho0=law.rho0 * (1 + 1e-12))]
        moved += [replace(law, cs=law.cs * (1 + 1e-12))]
    if law.parameter:
        moved += [replace(law, parameter=law.parameter * (1 + 1e-10))]
    for wrong in moved:
        assert violations(law, wrong.pressure), f"{wrong} passes as {law}"
        assert violations(law, wrong.evaluate), f"{wrong} passes as {law}"
