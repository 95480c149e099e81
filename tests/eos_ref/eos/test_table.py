"""Many particles of many types, and the compiled loops: the bits of each law, in any order and block."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref import EOS, STYLES, EOSTable, InputError, jit
from eos_ref.eos import bounds, compiled
from tests.support.eos_cases import EPS, LAWS, RHO0, FloatArray

# --- tables


def sample_table() -> EOSTable:
    """Seven types, no two of which share a parameter."""
    return EOSTable(
        tuple(
            replace(law, rho0=RHO0 + 10 * i, background=100.0 * i)
            for i, law in enumerate(
                LAWS[name]
                for name in (
                    "linear",
                    "cubic stiffening",
                    "tait/water",
                    "tait/general 4.3",
                    "ideal/gas",
                    "tait/general 7",
                    "tait/general 2",
                )
            )
        )
    )


def states(n: int, ntypes: int = 7) -> tuple[FloatArray, Any, FloatArray]:
    """Densities, types and energies of n particles, a few of them negative or NaN."""
    random = np.random.default_rng(n)
    rho_n = random.uniform(300, 3000, n)
    rho_n[::97] *= -1
    rho_n[5::501] = np.nan
    return rho_n, random.integers(1, ntypes + 1, n), random.uniform(1, 5, n)


@pytest.mark.parametrize("n", [1, 7, 2047, 2048, 2049, 5000])
@pytest.mark.parametrize("order", ["interleaved", "contiguous", "one type", "one stranger"])
def test_table_gives_the_bits_of_each_law(n: int, order: str) -> None:
    table = sample_table()
    rho_n, type_n, e_n = states(n)
    if order == "contiguous":
        type_n = np.sort(type_n)
    elif order != "one type":
        type_n = type_n.copy()
    if order in ("one type", "one stranger"):
        type_n[:] = 4
    if order == "one stranger":
        type_n[n // 2] = 1
    p_n = table.pressure(rho_n, type_n, e_n)
    assert p_n.shape == (n,)
    for t in range(1, 8):
        mine = type_n == t
        np.testing.assert_array_equal(p_n[mine], table[t].pressure(rho_n[mine], e_n[mine]))


@settings(deadline=None, derandomize=True, max_examples=40)
@given(n=st.integers(1, 4500), seed=st.integers(0, 2**31))
def test_table_is_independent_of_the_order(n: int, seed: int) -> None:
    table = sample_table()
    rho_n, type_n, e_n = states(n)
    order = np.random.default_rng(seed).permutation(n)
    np.testing.assert_array_equal(
        table.pressure(rho_n[order], type_n[order], e_n[order]), table.pressure(rho_n, type_n, e_n)[order]
    )


@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int32, np.int64, np.uint64, list])
def test_types_of_any_integer_dtype(dtype: Any) -> None:
    table = sample_table()
    rho_n, type_n, e_n = states(100)
    types = type_n.tolist() if dtype is list else type_n.astype(dtype)
    np.testing.assert_array_equal(
        table.pressure(rho_n.tolist(), types, e_n.tolist()), table.pressure(rho_n, type_n, e_n)
    )


def test_table_refuses_arrays_that_do_not_fit() -> None:
    table = EOSTable((EOS("linear"), EOS("ideal/gas", parameter=1.4)))
    for rho, types, e, message in (
        ([1.0, 2.0], [1], None, "one value per particle"),
        ([1.0, 2.0], [1, 1], [1.0], "one value per particle"),
        ([[1.0, 2.0]], [[1, 1]], [[1.0, 1.0]], "one value per particle"),
        ([1.0, 2.0], [1, 3], [1.0, 1.0], "must lie within 1 to 2, found '1 to 3'"),
        ([1.0, 2.0], [0, 1], [1.0, 1.0], "must lie within 1 to 2, found '0 to 1'"),
        ([1.0, 2.0], [-1, 1], [1.0, 1.0], "must lie within 1 to 2"),
        ([1.0, 2.0], np.array([2**63 + 1, 1], np.uint64), [1.0, 1.0], "must lie within 1 to 2"),
        ([1.0, 2.0], [1.0, 2.0], [1.0, 1.0], "must be a whole number, found 'float64'"),
        ([1.0, 2.0], [True, True], [1.0, 1.0], "must be a whole number, found 'bool'"),
        ([1.0, 2.0], [1, 2], None, "needs the internal energy"),
        ([1.0, 2.0], [1, 2], [], "needs the internal energy"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            table.pressure(rho, types, e)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="every atom type"):
        EOSTable(())
    for wrong in (0, 3, -1):
        with pytest.raises(InputError, match="must lie within 1 to 2"):
            table[wrong]


def test_table_is_a_sequence_from_type_one() -> None:
    laws = [EOS("linear"), EOS("tait/water")]
    table = EOSTable(laws)
    assert tuple(table) == tuple(laws)
    assert list(table) == laws == [table[1], table[2]]
    assert len(table) == 2
    assert not table.needs_energy
    assert sample_table().needs_energy


@pytest.mark.parametrize("table", [EOSTable((EOS("tait/water"),)), sample_table()])
def test_no_particles(table: EOSTable) -> None:
    assert table.pressure([], []).shape == (0,)
    assert table.pressure(np.empty(0), np.empty(0, int), np.empty(0)).dtype == np.float64


@pytest.mark.parametrize("negative", [False, True])
@pytest.mark.parametrize("function", ["pressure", "comparison"])
def test_memory_per_particle(function: str, negative: bool) -> None:
    """Below 400 bytes beyond the input at a million states: every type interleaved, or all left to numpy."""
    n = 1_000_000
    random = np.random.default_rng(1)
    rho_n = random.uniform(300, 3000, n) * (-1 if negative else 1)
    type_n = random.integers(1, 8, n) if not negative else np.full(n, 6)
    e_n = random.uniform(1, 5, n)
    table = sample_table()
    table.pressure(rho_n[:10], type_n[:10], e_n[:10])  # compiled before it is measured
    tracemalloc.start()
    try:
        if function == "pressure":
            table.pressure(rho_n, type_n, e_n)
        else:
            bounds.comparison(table, rho_n, type_n, e_n)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak >= 8 * n, "numpy's memory must be seen at all"
    assert peak < 400 * n, f"{peak / n:.0f} bytes per particle"


# --- compiled loops


@numba.njit(error_model="numpy")
def _logs(a_n: FloatArray, b: float) -> FloatArray:
    out_n = np.empty(a_n.size)
    for i in range(a_n.size):
        out_n[i] = compiled._log_ratio(a_n[i], b)
    return out_n


@numba.njit(error_model="numpy")
def _exps(y_n: FloatArray) -> FloatArray:
    out_n = np.empty(y_n.size)
    for i in range(y_n.size):
        out_n[i] = compiled._expm1(y_n[i])
    return out_n


@pytest.fixture(autouse=True)
def precision(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctx, "prec", 200)


@pytest.mark.parametrize("b", [1.0, 997.3, 1.9999999, 2.0**-1000, 2.0**1000, 1e-290])
def test_log_ratio_relative_error(b: float) -> None:
    """Below 2 eps over the whole range, next to 1 and where the exponent changes as well."""
    random = np.random.default_rng(1)
    change = 10.0 ** np.linspace(-15, -0.5, 80)
    ratios = np.concatenate(
        [
            1 + change,
            1 - change,
            2.0 ** random.uniform(-1, 1, 200),
            math.sqrt(2) * (1 + 4 * EPS * np.arange(-5, 6)),
            math.sqrt(0.5) * (1 + 4 * EPS * np.arange(-5, 6)),
            2.0 ** random.uniform(-60, 60, 200),
            2.0 ** random.uniform(-999, 999, 100),
        ]
    )
    with np.errstate(over="ignore", under="ignore"):
        a_n = b * ratios
    low, high = compiled.power_range(b)
    a_n = a_n[(a_n >= low) & (a_n <= high)]
    assert a_n.size > 200
    for a, value in zip(a_n, _logs(a_n, b), strict=True):
        true = (arb(a) / arb(b)).log()
        assert abs(arb(value) - true) <= 2 * EPS * abs(true), f"a={a!r} b={b!r}: {value!r}"


def test_expm1_relative_error() -> None:
    """Below 2 eps for every argument, down to the smallest and up to overflow."""
    random = np.random.default_rng(2)
    y_n = np.concatenate(
        [
            random.uniform(-1, 1, 400),
            10.0 ** np.linspace(-300, 0, 100),
            -(10.0 ** np.linspace(-300, 0, 100)),
            random.uniform(-750, 709, 300),
            (np.arange(-20, 20) + 0.5) * math.log(2),  # where the exponent changes
            [709.7, 709.78, -36.7, -37.5, -1e300],
        ]
    )
    for y, value in zip(y_n, _exps(y_n), strict=True):
        true = arb(y).expm1() if y > -1e5 else arb(-1)
        assert abs(arb(value) - true) <= 2 * EPS * abs(true), f"y={y!r}: {value!r}"
    assert _exps(np.array([0.0, 709.79, 1e5, np.inf])).tolist() == [0.0, np.inf, np.inf, np.inf]
    assert _exps(np.array([-np.inf]))[0] == -1
    assert np.isnan(_exps(np.array([np.nan]))[0])


def test_split_of_ln2_is_exact_for_every_exponent() -> None:
    assert all(arb(k) * arb(compiled._LN2_HIGH) == arb(k * compiled._LN2_HIGH) for k in range(-(2**11) + 1, 2**11))
    assert abs(arb(compiled._LN2_HIGH) + arb(compiled._LN2_LOW) - arb.const_log2()) < arb(2) ** -97


@pytest.mark.parametrize("rho0", [1.0, 1e-30, 1e8, 2.0**-1000, 2.0**1000, 1e-305, 1e305, 2.0**-1074])
def test_power_range_holds_only_ratios_with_an_exponent(rho0: float) -> None:
    low, high = compiled.power_range(rho0)
    assert not low <= 0 <= high
    assert not low <= np.inf <= high
    if low <= high:
        assert low <= rho0 <= high
        assert math.isfinite(1 / rho0)
        assert low / rho0 >= 2.0**-1001
        assert high / rho0 <= 2.0**1001


@pytest.mark.parametrize("rho0", [1e-30, 1e8, 1e-305, 1e305])
@pytest.mark.parametrize("gamma", [0.01, 7.0])
def test_extreme_equilibrium_densities(rho0: float, gamma: float) -> None:
    """0 and infinity reach the same value as everywhere else, however small or large rho0 is."""
    law = EOS("tait/general", rho0, 1.0, gamma)
    with np.errstate(all="ignore"):
        assert law.pressure([0.0])[0] == -(rho0 / gamma)
        assert law.pressure([np.inf])[0] == np.inf
        assert law.pressure([rho0])[0] == 0


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("n", [1, 2, 3, 5, 7, 2047, 2048, 2049, 4097])
def test_same_bits_alone_and_in_a_block(name: str, n: int) -> None:
    """Vector registers, their remainders and the ends of blocks must not affect the bits."""
    law = LAWS[name]
    rho_n = law.rho0 * np.random.default_rng(n).uniform(0.3, 3, n)
    e_n = np.random.default_rng(3).uniform(1, 2, n) if law.needs_energy else None
    together = law.pressure(rho_n, e_n)
    for i in {0, n // 2, n - 1, n - 2 if n > 1 else 0}:
        alone = law.pressure(rho_n[i], None if e_n is None else e_n[i])
        assert alone == together[i]


def test_index_without_a_law_has_no_pressure() -> None:
    """Not that of the last law in the chain."""
    p_n = np.zeros(3)
    compiled.pressure_of_one_type(np.ones(3), np.empty(0), len(STYLES), 1.0, 1.0, 0.0, 0.0, p_n)
    assert np.isnan(p_n).all()


def test_cache_depends_on_the_laws(monkeypatch: pytest.MonkeyPatch) -> None:
    """A changed law must not be evaluated by an old compiled loop."""
    before = jit.cache_directory()
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + (b"#" if path.name == "laws.py" else b""))
    assert jit.cache_directory() != before
