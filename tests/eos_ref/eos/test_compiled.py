"""The compiled loops: their power function against Arb, the same bits in every block, and cases left to numpy."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from pathlib import Path

import numba
import numpy as np
import pytest
from flint import arb, ctx

from eos_ref import STYLES, jit
from eos_ref.eos import compiled, registry
from tests.support.eos_cases import EPS, LAWS, FloatArray


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
    from eos_ref import EOS

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


def test_compiled_bodies_are_the_laws() -> None:
    assert [compiled._BODIES[style].py_func for style in STYLES] == [law.pressure for law in registry.LAWS.values()]


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
