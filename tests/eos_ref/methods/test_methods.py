"""Methods to evaluate a law: each against Arb, within the error of its form; series, table, the search."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref import EOS, EOSTable, InputError
from eos_ref.eos import bounds, rigorous
from eos_ref.methods import choice, series
from eos_ref.methods.laws import METHODS, NODES, LawMethod, methods_of
from eos_ref.methods.table import Table
from eos_ref.methods.worst import SAMPLES, Regime, certain_error, worst_case

# --- methods

LAWS = [
    EOS("linear", 1.2345, 7.89),
    EOS("cubic", 1.2345, 7.89, 2.5),
    EOS("tait/water", 1.2345, 7.89),
    EOS("tait/general", 1.2345, 7.89, 1.4),
    EOS("tait/general", 1.2345, 7.89, 4.0),
    EOS("ideal/gas", parameter=1.4),
    EOS("tait/water", 1.2345, 7.89, background=3.21),
]
ENERGY = 1.7


def worst(method: LawMethod, law: EOS, regime: Regime) -> float:
    evaluate = method.function(law, *regime.ends(law))
    e = ENERGY if law.needs_energy else None
    return worst_case(evaluate, law, regime.densities(law, 512), lambda rho_n: regime.holds(law, rho_n), e).error


def cases() -> list[tuple[LawMethod, EOS]]:
    return [(method, law) for law in LAWS for method in methods_of(law)]


def named(name: str) -> LawMethod:
    return next(method for method in METHODS if method.name == name)


def steepness(law: EOS) -> float:
    """Exponent, or else the parameter."""
    return law.exponent or law.parameter or 0.0


@pytest.mark.parametrize(("method", "law"), cases(), ids=lambda v: getattr(v, "name", getattr(v, "style", "")))
def test_every_method_agrees_with_the_law_far_from_rho0(method: LawMethod, law: EOS) -> None:
    """At 0.1 to 2 times rho0 no form cancels by more than some 2**5: the error is that of its working precision.

    A cubic table is off by less than a linear one, h^2/8 |P''|.
    """
    converges = method.name != "series"  # a power series converges within |d| < 1 only
    regime = Regime(0.1, 2.0 if converges else 0.5)
    limit = 256 * bounds.EPS
    if method.name.startswith("table"):
        rho_n = np.sort(regime.densities(law, 4096))
        h, size_n = np.ptp(rho_n) / (NODES - 1), np.abs(law.evaluate(rho_n) - law.background) + abs(law.background)
        # In a gap of the densities, around rho0, the difference of slopes is still between those of its ends.
        limit += 1.1 * h**2 / 8 * float(np.max(np.abs(np.gradient(law.stiffness(rho_n), rho_n)) / size_n))
    assert worst(method, law, regime) < limit


@pytest.mark.parametrize(("method", "law"), cases(), ids=lambda v: getattr(v, "name", getattr(v, "style", "")))
def test_best_conditioned_methods_keep_their_digits_everywhere(method: LawMethod, law: EOS) -> None:
    if method.conditioning <= 1:
        for regime in (Regime(1e-12, 1e-9), Regime(1e-6, 1e-3), Regime(1e-2, 5.0)):
            if method.name == "series" and regime.high > 1 and steepness(law) % 1:
                continue  # it diverges
            # The reference's own bound is 4 eps (1 + |gamma ln(rho/rho0)|) of the terms; one background more.
            factor = 16 * (1 + abs(steepness(law) * np.log(6.0))) if regime.high > 1 else 16
            assert worst(method, law, regime) < factor * bounds.EPS


@pytest.mark.parametrize("law", [law for law in LAWS if law.style.startswith("tait") and not law.background])
def test_printed_power_form_loses_digits_at_small_compression(law: EOS) -> None:
    """(rho/rho0)^gamma - 1 has an absolute error of some eps: relative to gamma d it grows as 1/d."""
    for d in (1e-9, 1e-6):
        error = worst(named("textbook"), law, Regime(d, 2 * d))
        assert 0.01 * bounds.EPS / d < error < 16 * bounds.EPS / d


def test_series_uses_the_terms_it_needs_and_diverges_beyond() -> None:
    law = EOS("tait/general", 1.2345, 7.89, 1.4)
    counts = [len(series.coefficients(law, reach)) for reach in (1e-9, 1e-3, 0.1, 0.5)]
    assert counts == sorted(counts)
    assert counts[0] < 4 < counts[-1] <= series.MOST
    for reach in (1e-9, 1e-3, 0.1, 0.3):  # half an eps for each of the seven operations outside the sum, and the sum
        assert worst(named("series"), law, Regime(reach / 10, reach)) < 8 * bounds.EPS
    assert worst(named("series"), law, Regime(1.5, 2.0)) > 1
    water = EOS("tait/water", 1.2345, 7.89)
    assert len(series.coefficients(water, 2.0)) <= 7  # a polynomial: the series ends


@pytest.mark.parametrize("law", [law for law in LAWS if not law.needs_energy])
@pytest.mark.parametrize(("low", "high"), [(0.999, 1.001), (0.5, 3.0), (1.1, 1.2), (0.8, 0.9)])
def test_table_stays_within_its_interpolation_bound(law: EOS, low: float, high: float) -> None:
    """h^4/384 max|P''''|, the fourth derivative by Arb's own differences, plus rounding."""
    rho_n = np.linspace(low * law.rho0, high * law.rho0, 1001)
    table = Table(law, rho_n[0], rho_n[-1], NODES)
    exact_n = np.asarray(law.evaluate(rho_n.astype(np.longdouble)))
    steps = table.step_s.max()
    fourth = _fourth_derivative(law, rho_n)
    rounding_n = 16 * bounds.EPS * (np.abs(exact_n - law.background).astype(float) + abs(law.background))
    assert (np.abs(table.pressure(rho_n) - exact_n) <= steps**4 / 384 * fourth + rounding_n).all()


def _fourth_derivative(law: EOS, rho_n: np.ndarray) -> float:
    """Largest one on the interval of the densities, from Tait's own formula; 0 for polynomials up to the third."""
    if not law.style.startswith("tait"):
        return 0.0
    g = law.gamma
    x_n = rho_n[[0, -1]] / law.rho0
    return float(np.abs(law.cs**2 / law.rho0**3 * (g - 1) * (g - 2) * (g - 3) * x_n ** (g - 4)).max()) * 1.01


def test_coarser_table_is_worse() -> None:
    law, rho_n = EOS("tait/water", 1.0, 1.0), np.linspace(0.7, 1.5, 501)
    exact_n = law.evaluate(rho_n)
    errors = [np.abs(Table(law, 0.7, 1.5, nodes).pressure(rho_n) - exact_n).max() for nodes in (17, 65, 257)]
    assert errors[0] > 50 * errors[1] > 2500 * errors[2]  # 4^4 per refinement, in powers of two


# --- the search


def test_search_finds_worse_cases_than_samples() -> None:
    law, regime = EOS("tait/general", 1.2345, 7.89, 1.4), Regime(1e-9, 1e-6)
    evaluate = named("textbook").function(law, *regime.ends(law))
    rho_n = regime.densities(law, SAMPLES)
    sampled = max(certain_error(evaluate, law, float(rho)) for rho in rho_n[:: SAMPLES // 64])
    found = worst_case(evaluate, law, rho_n, lambda rho: regime.holds(law, rho))
    assert found.error > sampled > found.median
    assert found.error == certain_error(evaluate, law, found.rho)
    error_n = [certain_error(evaluate, law, float(rho)) for rho in rho_n[:: SAMPLES // 64]]
    assert np.quantile(error_n, 0.25) < found.median < np.quantile(error_n, 0.75) < found.p99 < found.error


def test_search_finds_a_fault_between_samples() -> None:
    """A method that is wrong within 1e-9 of one density; the nearest sample lies just outside."""
    law, regime = EOS("linear", 1.2345, 7.89), Regime(0.1, 0.2)
    wrong = 1.2345 * 1.15

    def evaluate(rho_n, e_n):  # type: ignore[no-untyped-def]
        return law.evaluate(rho_n) * np.where(np.abs(rho_n - wrong) < 1e-9, 1 + 1e-6, 1.0)

    samples = np.array([wrong + 1.1e-9, wrong + 1e-3])
    found = worst_case(evaluate, law, samples, lambda rho: regime.holds(law, rho))
    # The law's own roundings, some U over the excess of 0.15 (rho0), add to the fault.
    assert abs(found.error - 1e-6) < 64 * 2.0**-53 / 0.15


def test_error_of_nan_is_infinite() -> None:
    law, regime = EOS("linear", 1.2345, 7.89), Regime(0.1, 0.2)
    found = worst_case(lambda rho_n, e_n: np.full(rho_n.shape, np.nan), law, regime.densities(law, 9), lambda r: r > 0)
    assert found.error == np.inf


def test_regime_outside_the_domain_is_refused() -> None:
    with pytest.raises(InputError, match="none of the interval"):
        worst_case(lambda r, e: r, EOS("tait/general", 1.0, 1.0, 1.4), np.array([-1.0]), lambda r: r < 0)


# --- choice


def laws() -> st.SearchStrategy[EOS]:
    rho0, cs = st.floats(0.2, 20.0), st.floats(0.1, 100.0)
    background = st.sampled_from([0.0, 0.5])
    return st.one_of(
        st.builds(EOS, st.just("linear"), rho0, cs, st.none(), background),
        st.builds(EOS, st.just("cubic"), rho0, cs, st.floats(0.0, 5.0), background),
        st.builds(EOS, st.just("tait/water"), rho0, cs, st.none(), background),
        st.builds(EOS, st.just("tait/general"), rho0, cs, st.one_of(st.floats(0.3, 9.0), st.just(3.0)), background),
    )


@settings(max_examples=60, deadline=None)
@given(laws(), st.floats(-14, 0), st.floats(0.1, 3.0), st.floats(-13.5, -2.0), st.integers(0, 2**32 - 1))
def test_chosen_method_meets_the_tolerance(law: EOS, at: float, wide: float, tolerance: float, seed: int) -> None:
    """The promise: at random states of the interval, certified with Arb, the error is below the tolerance."""
    d_n = np.random.default_rng(seed).uniform(10**at, min(10 ** (at + wide), 3.0), 400)
    d_n[::2] *= -0.25
    rho_n = law.rho0 * (1 + d_n)
    p_n = law.pressure(rho_n, method="auto", tolerance=10**tolerance)
    for rho, p in zip(rho_n[:40].tolist(), p_n[:40].tolist(), strict=True):
        exact = rigorous.pressure(law, rho)
        size = float(abs(exact - law.background).lower()) + abs(law.background)
        assert rigorous.error(p, exact) <= 10**tolerance * size


def test_looser_tolerance_chooses_a_cheaper_method_and_names_those_refused() -> None:
    law, rho_n = EOS("tait/water", 1.2345, 7.89), np.linspace(1.2, 1.3, 1000)
    loose, tight = (choice.choose(law, rho_n, None, tolerance) for tolerance in (1e-3, 2e-15))
    costs = choice.measured()["tait/water"]
    assert loose.seconds == costs[loose.method.name].of(1000) < tight.seconds == costs[tight.method.name].of(1000)
    assert tight.error <= 2e-15 < loose.error <= 1e-3
    cheaper = {name for name, cost in costs.items() if cost.of(1000) < tight.seconds}
    assert {name for name, _ in tight.refused} == cheaper and all(error > 2e-15 for _, error in tight.refused)
    assert loose.refused == ()
    words = str(tight)
    assert words.startswith(f"{tight.method.name}: error {tight.error:.2g} of 2e-15 allowed, {tight.seconds:.2g} s")
    assert f"not accurate enough: {loose.method.name} ({dict(tight.refused)[loose.method.name]:.2g})" in words
    p_n = law.pressure(rho_n, method="auto", tolerance=2e-15)
    assert np.array_equal(p_n, law.pressure(rho_n, method=tight.method.name))


def test_law_without_measured_costs_uses_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    law, rho_n = EOS("tait/water", 1.2345, 7.89), np.linspace(1.2, 1.3, 50)
    monkeypatch.setattr(choice, "measured", dict)
    chosen = choice.choose(law, rho_n, None, 1e-3)
    assert chosen.method.name == "compiled"
    assert str(chosen).endswith("the reference's own, as no cost was measured for this law")


def test_tolerance_below_double_precision_is_refused() -> None:
    with pytest.raises(InputError, match="tolerance: must be at least"):
        EOS("tait/water", 1.2345, 7.89).pressure(np.linspace(1.2, 1.3, 50), method="auto", tolerance=1e-17)


def test_costs_cover_every_selectable_method() -> None:
    for law in LAWS:
        for method in methods_of(law):
            cost = choice.measured()[law.style][method.name]
            assert cost.ns > 0
            assert cost.startup >= 0


# --- EOS.pressure


@pytest.mark.parametrize(("method", "law"), [(m, law) for law in LAWS for m in methods_of(law)])
def test_named_method_gives_the_same_bits_in_any_shape(method: LawMethod, law: EOS) -> None:
    rho_nc = law.rho0 * np.linspace(0.9, 1.1, 12).reshape(3, 4)
    e_n = np.full(12, ENERGY) if law.needs_energy else None
    expected_n = method.function(law, float(rho_nc.min()), float(rho_nc.max()))(rho_nc.ravel(), e_n)
    assert np.array_equal(law.pressure(rho_nc, ENERGY, method.name), expected_n.reshape(3, 4))


def test_default_pressure_is_that_of_the_compiled_loops() -> None:
    for law in LAWS:
        rho_n = law.rho0 * np.linspace(0.5, 1.5, 50)
        assert np.array_equal(law.pressure(rho_n, ENERGY), law.pressure(rho_n, ENERGY, method="compiled"))


@pytest.mark.parametrize("arguments", [("series",), ("auto", 1e-9), ("table, cubic",)])
def test_every_method_gives_nan_where_the_law_is_undefined(arguments: tuple[Any, ...]) -> None:
    law = EOS("tait/general", parameter=1.4)
    p_n = law.pressure([-0.5, 1.1, np.nan, 0.9], None, *arguments)
    assert np.isnan(p_n).tolist() == [True, False, True, False]
    assert np.isnan(law.pressure(-0.5, None, *arguments))
    assert law.pressure([], None, *arguments).shape == (0,)


def test_table_of_laws_chooses_separately_for_every_type() -> None:
    table, rho_n = EOSTable((LAWS[0], LAWS[2], LAWS[5])), np.linspace(1.0, 1.5, 9)
    type_n, e_n = np.arange(9) % 3 + 1, np.full(9, ENERGY)
    for arguments in (("numpy",), ("auto", 1e-3)):
        p_n = table.pressure(rho_n, type_n, e_n, *arguments)
        for t, law in enumerate(table, 1):
            of_type = type_n == t
            assert np.array_equal(p_n[of_type], law.pressure(rho_n[of_type], e_n[of_type], *arguments))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fast",), "method: must, for linear, be auto or one of compiled, .*found 'fast'"),
        (("polynomial",), "method: must, for linear, be auto or one of"),  # a method, of other laws
        (("auto",), 'tolerance: must be given with method="auto"'),
        (("numpy", 1e-9), 'tolerance: must be given with method="auto", and with no other, found 1e-09'),
        ((None, 1e-9), "tolerance: must be given with"),
        (("auto", "loose"), "tolerance: must be a finite number, found 'loose'"),
    ],
)
@pytest.mark.parametrize("laws", [(LAWS[0],), (LAWS[0], LAWS[0])])
def test_invalid_method_or_tolerance_is_refused(
    laws: tuple[EOS, ...], arguments: tuple[Any, ...], message: str
) -> None:
    for pressure in (
        lambda: laws[0].pressure([1.2], None, *arguments),
        lambda: EOSTable(laws).pressure([1.2], [1], None, *arguments),
    ):
        with pytest.raises(InputError, match=message):
            pressure()


# --- series


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
