"""The verdict on one field: bounds, NaN and infinity, signed zeros, vectors, digits lost."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds, lammps_rounding, rigorous
from eos_ref.eos.bounds import EPS
from lammps_cases.comparison.compare import (
    Comparison,
    EosState,
    compare_field,
    compare_pressure,
    digits_lost,
    evaluate,
    same_bits,
    worst_component,
)
from lammps_cases.records.case_parts import DigitsLost, Verdict, digest
from tests.support.roundings import rounded

Array = npt.NDArray[np.float64]
NAN, INF = float("nan"), float("inf")
TABLE = EOSTable([EOS("linear", rho0=1.0, cs=2.0), EOS("tait/general", rho0=1.2, cs=3.1, parameter=2.3)])
GAS = EOSTable([EOS("ideal/gas", parameter=1.4)])


def array(*values: float) -> Array:
    return np.array(values, float)


def compared(lammps_n: Array, reference_n: Array, bound_n: Array, same_order_n: Array | None = None) -> Comparison:
    return compare_field("f", "pair", np.arange(11, 11 + len(lammps_n)), lammps_n, reference_n, bound_n, same_order_n)


# --- one field


@pytest.mark.parametrize(
    ("lammps", "reference", "bound", "verdict", "ratio"),
    [
        (2.0, 1.0, 1.0, "pass", 1.0),  # the bound itself is inside
        (1.5, 1.0, 0.0, "differs", INF),
        (0.0, -0.0, 0.0, "pass", 0.0),  # equal, but not the same bits
        (NAN, 1.0, 1.0, "differs", INF),
        (1.0, NAN, 1.0, "differs", INF),
        (NAN, NAN, 1.0, "differs", INF),
        (INF, INF, 1.0, "differs", INF),
        (-INF, 1.0, INF, "differs", INF),
        (1.5, 1.0, INF, "differs", INF),  # no bound proves nothing
        (1.5, 1.0, NAN, "differs", INF),
        (1.0, 1.0, NAN, "differs", INF),
    ],
)
def test_value_is_judged_by_its_bound(
    lammps: float, reference: float, bound: float, verdict: Verdict, ratio: float
) -> None:
    """Alone, and among others that are right."""
    for around in (0, 1):
        lammps_n, reference_n, bound_n = (np.r_[[1.0] * around, x, [1.0] * around] for x in (lammps, reference, bound))
        record = compared(lammps_n, reference_n, bound_n).record
        assert (record.verdict, record.max_over_bound) == (verdict, ratio)
        assert record.outside == (verdict == "differs")
        assert record.first_id == (11 + around if verdict == "differs" else None)
        assert not record.outside or record.worst_id == record.first_id


NUMBERS = st.floats(-1e9, 1e9, allow_subnormal=False)
BOUNDS = st.just(0.0) | st.floats(1e-9, 1e9)
SIDES = st.lists(st.tuples(NUMBERS, NUMBERS, BOUNDS), min_size=1, max_size=9)


@given(SIDES, st.permutations(range(9)))
def test_verdict_agrees_with_fractions(values: list[tuple[float, float, float]], order: list[int]) -> None:
    """For atoms in any order; next to a bound itself the rounding of the ratio decides."""
    lammps_n, reference_n, bound_n = (np.array(side) for side in zip(*values, strict=True))
    id_n = np.array(order[: len(values)]) + 1
    record = compare_field("f", "pair", id_n, lammps_n, reference_n, bound_n).record
    far = [abs(Fraction(a) - Fraction(b)) for a, b, _ in values]
    bounds_n = [Fraction(bound) for *_, bound in values]
    outside = [f > b for f, b in zip(far, bounds_n, strict=True)]
    assume(not any(b and 0 < abs(f / b - 1) < Fraction(1, 10**15) for f, b in zip(far, bounds_n, strict=True)))
    bits = all(np.float64(a).tobytes() == np.float64(b).tobytes() for a, b, _ in values)
    assert record.verdict == ("differs" if any(outside) else "exact" if bits else "pass")
    assert record.outside == sum(outside)
    assert record.first_id == min((int(atom) for atom, out in zip(id_n, outside, strict=True) if out), default=None)
    assert record.max_abs == rounded(float(max(far)), 1)
    ratios = [f / b if b else (INF if f else 0) for f, b in zip(far, bounds_n, strict=True)]
    assert record.max_over_bound == rounded(float(max(ratios)), 2)


@pytest.mark.parametrize("shape", [(0,), (0, 3)])
def test_field_without_values_differs(shape: tuple[int, ...]) -> None:
    record = compared(*(np.zeros(shape) for _ in range(3))).record
    assert (record.verdict, record.max_abs, record.max_over_bound, record.outside) == ("differs", 0.0, 0.0, 0)
    assert record.bound is record.worst_id is record.first_id is None


def test_record_names_the_worst_atom_and_the_first_outside() -> None:
    lammps_n, bound_n = array(0.0, 3.0, 0.5, 8.0), array(1.0, 2.0, 1.0, 4.0)
    comparison = compared(lammps_n, np.zeros(4), bound_n)
    record = comparison.record
    assert (record.worst_id, record.first_id, record.bound, record.digest) == (14, 12, 4.0, digest(lammps_n))
    assert comparison.lammps_n is lammps_n and comparison.bound_n is bound_n
    np.testing.assert_array_equal(comparison.reference_n, np.zeros(4))


def test_counts_are_stored_as_floats() -> None:
    counts_n = np.array([3, 5])
    comparison = compare_field("count", "pair", np.array([1, 2]), counts_n, counts_n, np.zeros(2))
    assert (comparison.lammps_n.dtype, comparison.reference_n.dtype) == (float, float)
    assert (comparison.record.digest, comparison.record.derivation) == (digest(array(3.0, 5.0)), "")


@pytest.mark.parametrize(("bound", "verdict"), [(0.2, "differs"), (0.3, "pass")])
def test_one_component_outside_puts_the_particle_outside(bound: float, verdict: str) -> None:
    lammps_nc = np.array([[0.1, -0.2, 0.0], [0.0, 0.0, 0.3]])
    record = compared(lammps_nc, np.zeros((2, 3)), np.array([[1.0] * 3, [1.0, 1.0, bound]])).record
    assert (record.verdict, record.outside, record.worst_id, record.bound) == (verdict, verdict == "differs", 12, bound)
    assert record.max_over_bound == rounded(0.3 / bound, 3)


def test_lammps_order_of_operations_gives_exact_only_inside_the_bound() -> None:
    lammps_n, reference_n = array(1.0, 2.0 + 4 * EPS), array(1.0, 2.0)
    assert compared(lammps_n, reference_n, np.full(2, 1e-12), lammps_n.copy()).record.verdict == "exact"
    assert compared(lammps_n, reference_n, np.full(2, 1e-12), reference_n.copy()).record.verdict == "pass"
    assert compared(lammps_n, reference_n, np.full(2, 1e-18), lammps_n.copy()).record.verdict == "differs"


def test_bit_equality_includes_signs_and_excludes_nan() -> None:
    assert same_bits(array(1.0, -0.0), array(1.0, -0.0))
    for one, other in ((0.0, -0.0), (1.0, np.nextafter(1.0, 2.0)), (NAN, NAN)):
        assert not same_bits(array(one), array(other))


def test_particle_is_represented_by_its_component_of_largest_ratio() -> None:
    values_nc, ratio_nc = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[0.9, 0.1], [0.1, 0.9]])
    np.testing.assert_array_equal(worst_component(values_nc, ratio_nc), [1.0, 4.0])
    values_ncc, ratio_ncc = np.arange(8.0).reshape(2, 2, 2), np.zeros((2, 2, 2))
    ratio_ncc[0, 1, 0] = ratio_ncc[1, 0, 1] = 1.0
    np.testing.assert_array_equal(worst_component(values_ncc, ratio_ncc), [2.0, 5.0])
    np.testing.assert_array_equal(worst_component(array(1.0, 2.0), array(5.0, 6.0)), [1.0, 2.0])


# --- pressure


def state(n: int = 8) -> EosState:
    types_n = np.arange(n) % 2 + 1
    return EosState(np.arange(1, n + 1), types_n, np.linspace(0.9, 1.4, n), np.ones(n))


def values_of(scene: EosState) -> tuple[list[float], ...]:
    """Type, density and, if given, energy of every particle."""
    return tuple(side_n.tolist() for side_n in (scene.type_n, scene.rho_n, scene.e_n) if side_n is not None)


def gas(n: int = 8) -> EosState:
    ids_n = np.arange(1, n + 1)
    return EosState(ids_n, np.ones(n, int), np.linspace(0.9, 1.4, n), np.full(n, 1.3), np.linspace(2.1, 0.7, n))


def test_every_particle_is_evaluated_by_the_law_of_its_type() -> None:
    scene = state()
    linear = scene.type_n == 1
    p_n = evaluate(TABLE, scene)
    bound_n = bounds.comparison(TABLE, scene.rho_n, scene.type_n, scene.e_n)  # derived for any order of operations
    assert (np.abs(p_n[linear] - 4.0 * (scene.rho_n[linear] - 1.0)) <= bound_n[linear]).all()
    tait = 3.1**2 * 1.2 / 2.3 * ((scene.rho_n[~linear] / 1.2) ** 2.3 - 1)
    assert (np.abs(p_n[~linear] - tait) <= bound_n[~linear]).all()


def test_energy_is_per_unit_mass() -> None:
    scene = EosState(np.array([1]), np.array([1]), array(2.0), array(4.0), array(6.0))
    assert scene.e_n is not None
    np.testing.assert_array_equal(scene.e_n, [1.5])
    table = EOSTable([EOS("ideal/gas", parameter=1.4)])
    bound_n = bounds.comparison(table, scene.rho_n, scene.type_n, scene.e_n)
    assert np.abs(evaluate(table, scene) - 0.4 * 2.0 * 1.5) <= bound_n


def test_pressure_of_the_reference_is_exact_and_a_wrong_law_differs() -> None:
    scene = state()
    right = compare_pressure(TABLE, scene, evaluate(TABLE, scene)).record
    assert (right.verdict, right.stage) == ("exact", "eos")
    swapped = evaluate(EOSTable([TABLE[2], TABLE[1]]), scene)
    wrong = compare_pressure(TABLE, scene, swapped).record
    assert (wrong.verdict, wrong.outside) == ("differs", len(scene.id_n))


@pytest.mark.parametrize(("table", "scene"), [(TABLE, state()), (GAS, gas())], ids=["TABLE", "GAS"])
def test_law_is_evaluated_in_the_requested_precision(table: EOSTable, scene: EosState) -> None:
    p_n = evaluate(table, scene, np.longdouble)
    assert p_n.dtype == np.longdouble and evaluate(table, scene).dtype == np.float64
    exact = [rigorous.pressure(table[t], *values) for t, *values in zip(*values_of(scene), strict=True)]
    errors = [rigorous.error(float(p - float(p)), value - float(p)) for p, value in zip(p_n, exact, strict=True)]
    assert max(errors) < EPS / 100, "what a double cannot hold"


def test_undefined_pressure_is_nan_and_overflow_is_infinite() -> None:
    """Neither gives a warning: the comparison shows it."""
    laws = EOSTable([TABLE[2], EOS("cubic", 1.2, parameter=0.5)])
    scene = EosState(np.arange(1, 4), np.array([1, 1, 2]), array(-1.0, 1.2, 1e200), np.ones(3))
    np.testing.assert_array_equal(evaluate(laws, scene), [NAN, 0.0, INF])


def test_pressure_with_the_roundings_of_lammps_is_exact() -> None:
    scene = gas()
    theirs_n = lammps_rounding.pressure(GAS, scene.rho_n, scene.type_n, scene.energy_n, scene.mass_n)
    assert not same_bits(theirs_n, evaluate(GAS, scene))
    assert compare_pressure(GAS, scene, theirs_n).record.verdict == "exact"


def test_record_of_a_pressure_has_the_derivation_of_its_bound_and_digits_lost() -> None:
    scene = state()
    record = compare_pressure(TABLE, scene, evaluate(TABLE, scene)).record
    laws = [f"type {t}: {bounds.comparison_derivation(TABLE[t])}" for t in (1, 2)]
    assert record.derivation == "; ".join(laws)
    assert (record.field, record.digits_lost.lammps) == ("pressure", record.digits_lost.reference)
    assert record.digits_lost.lammps is not None
    used = compare_pressure(TABLE, replace(scene, type_n=np.full(8, 2)), scene.rho_n, "used", digits=False).record
    assert (used.field, used.derivation, used.digits_lost) == ("used", laws[1], DigitsLost())


# Digits are given in hundredths; a pressure's own error, a hundred EPS at most, is negligible against 1e-9.
HUNDREDTH = 0.005 + 100 * EPS / 1e-9


@pytest.mark.parametrize(("n", "row", "factor"), [(8, slice(None), 1e-9), (1001, 377, 1e-6)])
def test_digits_lost_are_those_of_the_worst_atom(n: int, row: Any, factor: float) -> None:
    """Among many only some atoms are certified: the worst is one of them."""
    for table, scene in ((TABLE, state(n)), (GAS, gas(n))):
        p_n = evaluate(table, scene)
        wrong_n = p_n.copy()
        wrong_n[row] *= 1 + factor
        lost = digits_lost(table, scene, wrong_n, p_n)
        assert lost.lammps == pytest.approx(np.log10(factor / EPS), rel=0, abs=HUNDREDTH)
        assert lost.reference is not None and lost.reference < (2 if n == 8 else 8)


def test_no_digits_are_lost_without_evaluation() -> None:
    empty = EosState(*(np.zeros(0, int) for _ in range(2)), *(np.zeros(0) for _ in range(2)))
    assert digits_lost(TABLE, empty, np.zeros(0), np.zeros(0)).lammps is None


@pytest.mark.parametrize(
    ("rho", "value", "lost"),
    [
        (1.5, 2.0, 0.0),
        (1.5, 2.0 * (1 + 3 * EPS), 0.48),
        (1.5, 2.0 * (1 + 1.5 * EPS), 0.3),  # 1 + 1.5 eps is rounded to 1 + 2 eps
        (1.5, 0.0, 15.65),
        (1.5, NAN, 99.0),
        (1.5, INF, 99.0),
        (1.0, 0.0, 0.0),
        (1.0, 1e-300, 15.65),  # only zero is close to zero
    ],
)
def test_digits_lost_of_one_value(rho: float, value: float, lost: float) -> None:
    scene = EosState(np.array([1]), np.array([1]), array(rho), np.ones(1))
    both = array(value), array(4.0 * (rho - 1.0))
    assert digits_lost(TABLE, scene, *both) == DigitsLost(lammps=lost, reference=0.0)
    assert digits_lost(TABLE, scene, *both[::-1]) == DigitsLost(lammps=0.0, reference=lost)


def test_digits_lost_are_counted_only_where_the_law_is_defined() -> None:
    scene = EosState(np.array([1, 2]), np.array([2, 1]), array(-1.0, 1.5), np.ones(2))
    assert digits_lost(TABLE, scene, array(7.0, 0.0), array(NAN, 2.0)) == DigitsLost(lammps=15.65, reference=0.0)


def test_the_worst_of_either_side_and_evenly_spaced_atoms_are_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, certified = replace(state(1001), type_n=np.ones(1001, int)), set()
    right_n = evaluate(TABLE, scene)
    lammps_n, reference_n = right_n.copy(), right_n.copy()
    lammps_n[[377, 501]] *= 1 + 1e-6
    lammps_n[700] = NAN  # no distance
    reference_n[[11, 22]] *= 1 - 1e-9
    pressure = rigorous.pressure

    def certify(law: EOS, rho: float, e: float | None) -> object:
        certified.add(int(np.searchsorted(scene.rho_n, rho)))
        return pressure(law, rho, e)

    monkeypatch.setattr(rigorous, "pressure", certify)
    digits_lost(TABLE, scene, lammps_n, reference_n, certified=8)
    assert certified == {0, 333, 666, 1000} | {377, 501} | {11, 22}


def test_doubles_are_screened_in_extended_precision() -> None:
    """The reference never differs from itself: only extended precision shows where cancellation costs digits."""
    scene = replace(state(1000), type_n=np.full(1000, 2))
    scene.rho_n[505] = 1.2 * (1 + 1e-7)
    p_n = evaluate(TABLE, scene)
    assert digits_lost(TABLE, scene, p_n, p_n) == digits_lost(TABLE, scene, p_n, p_n, certified=4000)
