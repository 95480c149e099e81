"""Many particles of many types: the bits of each law, in any order and block, within a few bytes per particle."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref import EOS, EOSTable, InputError
from eos_ref.eos import bounds
from tests.support.eos_cases import LAWS, RHO0, FloatArray


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
