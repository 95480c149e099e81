"""EOS and EOSTable: parameters, inverse, stiffness, intervals, and many particles of many types."""

from __future__ import annotations

import doctest
import math
import pickle
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import eos_ref
from eos_ref import EOS, STYLES, EOSTable, InputError
from eos_ref.eos import bounds, rigorous
from eos_ref.eos.table import examples
from tests.support.eos_cases import (
    BACKGROUNDS,
    CS,
    EPS,
    LAWS,
    RHO0,
    SCALE,
    TAIT,
    FloatArray,
    allowed,
    densities,
    energies,
    exact,
    has_value,
    law_terms,
    whole,
    with_backgrounds,
)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("tait",), "pressure style: must be one of linear, .*found 'tait'"),
        (("background",), "pressure style"),
        (("linear", 1.0, 1.0, 2.0), "linear: takes no argument, found 2.0"),
        (("tait/water", 1.0, 1.0, 7.0), "takes no argument"),
        (("cubic",), "cubic: needs the argument A3"),
        (("tait/general",), "needs the argument gamma"),
        (("ideal/gas",), "needs the argument gamma"),
        (("linear", 0.0), "rho0: must be positive, found 0.0"),
        (("linear", -1.0), "rho0: must be positive"),
        (("linear", 1.0, 0.0), "cs: must be positive"),
        (("linear", math.nan), "rho0: must be a finite number"),
        (("linear", 1.0, math.inf), "cs: must be a finite number"),
        (("linear", "1"), "rho0: must be a finite number, found '1'"),
        (("linear", 10**400), "rho0: must be a finite number"),
        (("linear", None), "rho0: must be a finite number"),
        (("linear", 1.0, 1.0, None, math.nan), "background: must be a finite number"),
        (("cubic", 1.0, 1.0, math.inf), "A3: must be a finite number"),
        (("tait/general", 1.0, 1.0, math.nan), "gamma: must be a finite number"),
        (("tait/general", 1.0, 1.0, 0.0), "gamma of tait/general: must not be 0"),
        (("ideal/gas", 1.0, 1.0, 1.0), "gamma of ideal/gas: must exceed 1"),
        (("ideal/gas", 1.0, 1.0, 0.9), "gamma of ideal/gas"),
    ],
)
def test_bad_parameters_are_refused(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        EOS(*arguments)
    assert "\n" not in str(caught.value)


def test_defaults_are_those_of_fix_rheo() -> None:
    assert EOS("linear") == EOS("linear", 1.0, 1.0, None, 0.0)
    assert EOS("tait/water").gamma == 7
    for law in (EOS("linear"), EOS("cubic", parameter=2.0)):  # A3 is no gamma
        with pytest.raises(AttributeError, match=f"{law.style} has no gamma"):
            _ = law.gamma


@pytest.mark.parametrize("number", [int, np.int32, np.float32, np.float64, np.longdouble, np.array])
def test_parameters_become_plain_floats(number: Any) -> None:
    """In integers c*c overflows and in float32 it rounds, before any law is evaluated."""
    law = EOS("cubic", number(3), number(5), number(2), number(1))
    assert law == EOS("cubic", 3.0, 5.0, 2.0, 1.0)
    assert all(type(x) is float for x in (law.rho0, law.cs, law.parameter, law.background))
    assert EOS("linear", 1, 10**10).pressure(3.0) == 2e20
    assert EOSTable((EOS("linear", 1, 10**10), EOS("linear"))).pressure([3.0, 3.0], [1, 2]).tolist() == [2e20, 2.0]


def test_laws_and_tables_travel_between_processes() -> None:
    """Frozen, hashable, and pickled without loss, the cached columns of a table included."""
    law = LAWS["tait/general 4.3"]
    assert pickle.loads(pickle.dumps(law)) == law
    assert hash(replace(law)) == hash(law)
    table = EOSTable((law,))
    table.pressure([1.0], [1])  # fills the cache of the table
    assert pickle.loads(pickle.dumps(table)) == table


@pytest.mark.parametrize("name", LAWS)
def test_shapes_in_a_notebook(name: str) -> None:
    """Scalars give scalars, lists and arrays of any shape give arrays of that shape; the energy as well."""
    law = replace(LAWS[name], background=3.0)
    one = {"e": 2.0} if law.needs_energy else {}
    two = {"e": [2.0, 2.0]} if law.needs_energy else {}
    for method in (law.pressure, law.density, law.stiffness, law.sound_speed):
        scalar = method(1000, **one)
        assert isinstance(scalar, float), method
        assert method([1000, 1000], **two).tolist() == [scalar, scalar]
        assert method([1000, 1000], **one).tolist() == [scalar, scalar]
        assert method(np.full((2, 3), 1000.0), **one).tolist() == [[scalar] * 3] * 2
        assert method(np.full((4, 6), 1000.0)[::2, ::2], **one).tolist() == [[scalar] * 3] * 2
        assert method([], **one).shape == (0,)
    assert law.is_defined(1000)
    assert law.is_defined([1000, math.nan]).tolist() == [True, False]


def test_energy_is_checked() -> None:
    gas = LAWS["ideal/gas"]
    for method in (gas.pressure, gas.density, gas.stiffness, gas.sound_speed, gas.evaluate):
        with pytest.raises(InputError, match="energy: ideal/gas needs"):
            method(1.0)
    with pytest.raises(InputError, match=r"energy: must be a scalar or of the density's shape \(3,\), found \(2,\)"):
        gas.pressure([1.0, 2.0, 3.0], [1.0, 2.0])
    assert np.isnan(gas.density(1.0, 0.0)), "without energy there is no pressure, so there is no root"
    assert replace(gas, parameter=1.5).density([1.0, 2.0], [0.0, 4.0])[1] == 1.0
    assert LAWS["linear"].pressure(1000.0, [1.0, 2.0]) == LAWS["linear"].pressure(1000.0), "ignored where unused"


@settings(deadline=None, derandomize=True, max_examples=200)
@given(
    st.sampled_from(examples(RHO0, CS)),
    st.lists(st.floats(0.2, 3), min_size=2, max_size=2).map(sorted),
    st.floats(0.5, 2),
    st.sampled_from(BACKGROUNDS),
)
def test_registered_law_is_monotone_invertible_and_within_its_bound(
    law: EOS, x: list[float], e: float, background: float
) -> None:
    """On its branch, whatever the law: against Arb, with no formula of this file."""
    law = replace(law, background=background)
    rho_n, e_n = RHO0 * np.array(x), np.full(2, e)
    assume(law.monotone.low < rho_n[0] and rho_n[1] < law.monotone.high and law.is_defined(rho_n).all())
    p_n, bound_n = law.pressure(rho_n, e_n), bounds.reference(law, rho_n, e_n)
    for rho, p, bound in zip(rho_n.tolist(), p_n.tolist(), bound_n.tolist(), strict=True):
        assert rigorous.error(p, rigorous.pressure(law, rho, e)) <= bound
    assert p_n[0] - p_n[1] <= bound_n.sum()
    back_n = law.density(p_n, e_n)
    slope_n = np.minimum(law.stiffness(rho_n, e_n), law.stiffness(back_n, e_n))
    # The inverse's own roundings are below 64 eps; see `inverse_bound` for what they are.
    assert (np.abs(back_n - rho_n) <= 2 * bound_n / slope_n + 64 * EPS * (rho_n + RHO0)).all()


def branch(law: EOS) -> FloatArray:
    """Densities >= 0 on the monotone branch: near equilibrium, in tension and compression, up to its ends."""
    low, high = max(law.monotone.low, 0.0), min(law.monotone.high, 1e30 * RHO0)
    rho_n = np.abs(densities(law))
    random = np.random.default_rng(5)
    inside = np.linspace(max(low, 0.01 * RHO0), min(high, 3 * RHO0), 40)[1:-1]
    rho_n = np.concatenate([rho_n, inside, random.uniform(low, min(high, 5 * RHO0), 30)])
    return rho_n[(rho_n > low) & (rho_n < high) & (rho_n > 1e-30)]


def inverse_bound(law: EOS, rho_n: FloatArray, back_n: FloatArray, e_n: FloatArray | None) -> FloatArray:
    r"""Error of density(pressure(rho)), by the mean value theorem: error of P / least slope in between + own roundings.

    Error of P: that of `EOS.pressure`, and the roundings of the inverse that act as a change of P: less the background
    1/2 eps (|P| + |P_b|); its scaling to a pure number, at most 8 u = 4 eps (cubic: y 3 u, the root of 3|A3| 1.5 u,
    two products; tait: gamma p, c*c, rho0, the quotient).
    Slope: monotone in between for the power laws; that of a cubic law is least at an end, or at rho0 in between.
    Own: elementary functions 2 eps each (two units of the last place). Cubic: 5.5 eps of |rho - rho0|, the 2.5 eps of
    w/3 = asinh(...)/3 magnified by w/3 in sinh, and half an eps of the sum; tait: 2.5 eps of the logarithm, and 3 eps;
    ideal gas and linear: 2 eps.
    """
    with np.errstate(all="ignore"):
        p_n = np.asarray(law.evaluate(rho_n, e_n))
        bound_p = np.array(
            [allowed(law, float(r), None if e_n is None else float(e_n[i])) for i, r in enumerate(rho_n)]
        )
        bound_p += EPS * (4 * np.abs(p_n - law.background) + 0.5 * (np.abs(p_n) + abs(law.background)))
        slope = np.minimum(law.stiffness(rho_n, e_n), law.stiffness(back_n, e_n))
        if law.style == "cubic":
            between = (rho_n - law.rho0) * (back_n - law.rho0) <= 0
            slope = np.where(between, np.minimum(slope, law.cs**2), slope)
            w = np.arcsinh(1.5 * math.sqrt(3 * abs(law.parameter)) * np.abs(p_n - law.background) / law.cs**2)
            own = (6 + w) * np.abs(back_n - law.rho0) + np.maximum(rho_n, law.rho0)
        elif law.style.startswith("tait"):
            own = (3 + 3 * np.abs(np.log(rho_n / law.rho0))) * np.maximum(rho_n, back_n)
        else:
            own = 2 * (rho_n + law.rho0)
        # the slope itself is good to a few eps only; 2^-40 is far above them and far below what could hide a fault
        return np.asarray(bound_p / slope * (1 + 2.0**-40) + EPS * own)


@pytest.mark.parametrize("law", with_backgrounds())
def test_density_undoes_pressure(law: EOS) -> None:
    rho_n = branch(law)
    e_n = energies(law, rho_n)
    with np.errstate(all="ignore"):
        p_n = law.pressure(rho_n, e_n)
        back_n = law.density(p_n, e_n)
    kept = np.isfinite(p_n)
    bound_n = inverse_bound(law, rho_n, back_n, e_n)
    # Where P has lost the density (tension, large gamma; the spinodal) P may lie beyond the end of the branch: there
    # NaN says so, and the bound, the slope being next to 0, exceeds the distance to the end.
    end = law.monotone.low if law.style == "cubic" else 0.0
    lost = np.isnan(back_n)
    with np.errstate(all="ignore"):
        to_end = np.minimum(np.abs(rho_n - end), np.abs(law.monotone.high - rho_n))
        reach = inverse_bound(law, rho_n, rho_n, e_n)
    flat = lost & (reach > 0.01 * to_end)
    checked = kept & ~flat
    assert np.count_nonzero(checked) > 0.6 * np.count_nonzero(kept)
    wrong = checked & ~(np.abs(back_n - rho_n) <= bound_n)
    assert not wrong.any(), [
        f"rho={r!r}: density(pressure)={b!r}, {abs(b - r) / a:.3g} bounds"
        for r, b, a in zip(rho_n[wrong], back_n[wrong], bound_n[wrong], strict=True)
    ]


CLOSE = (
    *("linear", "cubic nearly flat", "cubic A3 = 0", "tait/water"),
    *("tait/general 7", "tait/general 2", "tait/general 0.5", "tait/general 0.01"),
)


@pytest.mark.parametrize("name", CLOSE)
def test_the_inverse_keeps_its_digits_near_equilibrium(name: str) -> None:
    """The deviation rho - rho0 itself survives, down to the last place of rho; Cardano's formula would lose it.

    P is good to 9 eps of itself there at most (water, test_laws), the scaling to a pure number to 4, its elementary
    functions to 2.5: 16 eps of the deviation. Adding rho0, or the exponential near 1 times rho0: 2.5 eps of rho0.
    """
    law = LAWS[name]
    change = 10.0 ** np.linspace(-12, -2, 41)
    rho_n = RHO0 * np.concatenate([1 + change, 1 - change])
    back_n = law.density(law.pressure(rho_n))
    bound_n = EPS * (16 * np.abs(rho_n - RHO0) + 2.5 * RHO0)
    assert np.all(np.abs(back_n - rho_n) <= bound_n)


def test_no_root_is_nan() -> None:
    water, softening = LAWS["tait/water"], LAWS["cubic softening"]
    floor = -SCALE / 7  # the pressure of vacuum
    assert np.isnan(water.density(1.001 * floor))
    assert np.isnan(replace(water, background=5.0).density(5.0 + 1.001 * floor))
    assert 0 <= water.density(0.999 * floor) < RHO0
    spinodal = 1 / math.sqrt(3 * 2.3e-3)
    peak = 13.7**2 * (spinodal - 2.3e-3 * spinodal**3)
    assert np.isnan(softening.density([1.001 * peak, -1.001 * peak])).all()
    assert np.isfinite(softening.density([0.999 * peak, -0.999 * peak])).all()
    negative = LAWS["tait/general -1.3"]  # P is bounded from above
    assert np.isnan(negative.density(1.001 * SCALE / 1.3))
    for law in LAWS.values():
        assert np.isnan(law.density(math.nan, 1.0))


def derivative(law: EOS, rho: float, e: float | None) -> arb:
    """Central difference of the exact formula in 400 bits, of which the difference costs 40.

    (P(rho + h) - P(rho - h)) / 2h = P' + h^2 P'''/6 + ..., and P''' < gamma^2 P'/rho^2 for the power laws.
    """
    before, ctx.prec = ctx.prec, 400
    try:
        h = rho * 2.0**-40 if rho else 2.0**-40
        up, down = rho + h, rho - h  # rounded to floats; the quotient below is taken of what they then are
        # without the constant of Tait's law, next to which a high power of a small ratio would vanish
        varying = 1 if law.style.startswith("tait") else 3
        pressures = [sum(law_terms(law, x, e)[:varying], arb(0)) for x in (up, down)]
        return (pressures[0] - pressures[1]) / (arb(up) - arb(down))
    finally:
        ctx.prec = before


@pytest.mark.parametrize("name", LAWS)
def test_stiffness_is_the_derivative(name: str) -> None:
    """Against a central difference in Arb.

    Power laws: relative error |gamma - 1| (1 + |ln x|) u of the base and the exponent, 2 eps of pow, three products;
    cubic: 8 u of c^2 (1 + 3|A3| d^2). Truncation, and the step rounded in float64: (gamma^2 + 1) 2^-79 and the midpoint
    moved by 2^-53: gamma u more.
    """
    law = LAWS[name]
    rho_n = RHO0 * np.concatenate([np.linspace(-2, 3, 41), 10.0 ** np.linspace(-8, 4, 30), [1 + 1e-9, 1 - 1e-5]])
    rho_n = rho_n[[rho != 0 and has_value(law, float(rho)) for rho in rho_n]]
    e_n = energies(law, rho_n)
    for i, found in enumerate(law.stiffness(rho_n, e_n)):
        rho = float(rho_n[i])
        true = derivative(law, rho, None if e_n is None else float(e_n[i]))
        if abs(true) < 1e-290 or abs(true) > 1e300:  # subnormal: no relative accuracy
            continue
        if law.style == "cubic":
            d = rho - law.rho0
            terms = law.cs**2 * (1 + 3 * abs(law.parameter) * d * d)
            bound = 4 * EPS * terms + EPS * law.cs**2 * 6 * abs(law.parameter * d * rho) + terms * 2.0**-70
            bound += law.cs**2 * abs(law.parameter) * rho**2 * 2.0**-79
        else:
            g = abs(law.gamma - 1) if law.style.startswith("tait") else 1.0
            relative = EPS * (g * (1 + abs(math.log(abs(rho) / law.rho0))) + 5 + abs(g)) + (g * g + 1) * 2.0**-79
            bound = relative * float(abs(true))
        assert abs(arb(float(found)) - true) <= bound, f"rho={rho!r}: {found!r}, not {true.str(20)}"


def test_stiffness_at_vacuum() -> None:
    assert LAWS["tait/general 1"].stiffness([0.0, -1.0, RHO0]).tolist() == [13.7**2] * 3
    assert LAWS["tait/water"].stiffness(0.0) == 0
    assert LAWS["tait/general 0.5"].stiffness(0.0) == math.inf
    assert LAWS["ideal/gas"].stiffness([1.0, 2.0], 3.0).shape == (2,)


@pytest.mark.parametrize("name", LAWS)
def test_sound_speed_is_the_root_of_the_stiffness(name: str) -> None:
    law = LAWS[name]
    rho_n = RHO0 * np.linspace(0.05, 3, 60)
    c_n = law.sound_speed(rho_n, 2.0)
    stiffness_n = law.stiffness(rho_n, 2.0)
    assert np.array_equal(np.isnan(c_n), stiffness_n < 0)
    real = stiffness_n >= 0
    assert np.array_equal(c_n[real], np.sqrt(stiffness_n[real]))
    if not law.needs_energy:
        # c itself at equilibrium: c*c and the root round once each, half an eps
        assert abs(law.sound_speed(RHO0) - law.cs) <= EPS * law.cs
    else:
        assert abs(law.sound_speed(1.0, 2.0) ** 2 - 0.4 * 2.0) <= 3 * EPS


@pytest.mark.parametrize("name", LAWS)
def test_intervals_against_the_exact_formula(name: str) -> None:
    """`defined`, `is_defined` and `monotone` against the values and the slope on a dense grid."""
    law = LAWS[name]
    rho_n = RHO0 * np.concatenate([np.linspace(-3, 4, 141), 1 + np.linspace(-0.03, 0.03, 61), [1e-9, -1e-9]])
    assert law.is_defined(rho_n).tolist() == [has_value(law, float(rho)) for rho in rho_n]
    assert not law.is_defined([math.nan, math.inf, -math.inf]).any()
    low, high = law.defined
    for rho in rho_n[np.abs(rho_n) > 1e-12]:
        assert (low <= rho <= high) == has_value(law, float(rho))
    low, high = law.monotone
    assert low < law.rho0 < high
    for rho in rho_n:
        if abs(rho) < 1e-12 or not has_value(law, float(rho)) or min(abs(rho - low), abs(rho - high)) < 1e-6:
            continue
        slope = derivative(law, float(rho), 2.0 if law.needs_energy else None)
        if low < rho < high:
            assert slope > 0, f"rho={rho!r} lies in {law.monotone}"
        elif not (law.style == "tait/general" and law.gamma < 0):  # those grow again beyond the pole at 0
            assert slope < 0, f"rho={rho!r} lies outside {law.monotone}"


def test_interval_of_whole_powers() -> None:
    everywhere = (-math.inf, math.inf)
    assert {name: tuple(law.defined) for name, law in TAIT.items()} == {
        name: everywhere if whole(law) else (0.0, math.inf) for name, law in TAIT.items()
    }
    assert {name for name, law in TAIT.items() if tuple(law.monotone) == everywhere} == {
        "tait/water",
        "tait/general 7",
        "tait/general 3",
        "tait/general 1",
    }


def test_every_style_is_sampled() -> None:
    assert {law.style for law in LAWS.values()} == set(STYLES)
    assert float(exact(LAWS["tait/water"], 2 * RHO0)) == pytest.approx(SCALE / 7 * 127, rel=4 * EPS)  # 4 roundings


@pytest.mark.parametrize("module", [eos_ref, eos_ref.eos.table], ids=lambda module: module.__name__)
def test_examples_of_the_documentation(module: ModuleType) -> None:
    failed, attempted = doctest.testmod(module)
    assert attempted > 0
    assert failed == 0
