"""Tait's law as LAMMPS evaluates it and with the difference first: the numbers and bounds of docs/tait.md."""

from __future__ import annotations

import importlib.util
import math
import subprocess
import sys
from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import cache, partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from eos_ref import EOS
from eos_ref.methods.laws import METHODS
from eos_ref.methods.worst import Regime, Worst, worst_case
from lammps_cases.bugs.deck import environment
from lammps_cases.bugs.upstream.files import TAIT
from lammps_cases.engine import installations
from lammps_cases.records.files import DATA

PAGE = Path(__file__).parents[3] / "docs" / "tait.md"
TEST = DATA / "upstream" / Path(TAIT).name
U = 2.0**-53
WATER, GENERAL = EOS("tait/water", 1.2345, 7.89), EOS("tait/general", 1.2345, 7.89, 1.4)
REGIMES = tuple(Regime(low, high) for low, high in ((1e-12, 1e-9), (1e-9, 1e-6), (1e-6, 1e-3), (1e-3, 0.1), (0.1, 0.5)))
PRINTED, DIFFERENCE = "in LAMMPS' order", "numpy"  # by name among the methods of a law


@cache
def worst(law: EOS, method: str, regime: Regime) -> Worst:
    evaluate = next(m for m in METHODS if m.name == method).function(law, *regime.ends(law))
    return worst_case(evaluate, law, regime.densities(law, 1024), partial(regime.holds, law))


def digits(law: EOS, method: str, regime: Regime) -> str:
    return f"{-math.log10(worst(law, method, regime).error):.1f}"


def printed_bound(law: EOS, d: float) -> float:
    power = (1 + d) ** 7
    return (18 * power / abs(power - 1) + 6) * U


def factored_bound(law: EOS, d: float) -> float:
    return 26 * U


def general_bound(law: EOS, d: float) -> float:
    y = law.gamma * math.log1p(d)
    in_logarithm = abs(d / ((1 + d) * math.log1p(d)))
    in_exponential = abs(y * math.exp(y) / math.expm1(y))
    return (6 + in_exponential * (3 + 3 * in_logarithm)) * U


def test_page_has_the_digits_of_both_forms() -> None:
    page = PAGE.read_text(encoding="utf-8")
    forms = [(law, method) for law in (WATER, GENERAL) for method in (PRINTED, DIFFERENCE)]
    for regime in REGIMES:
        cells = (f"{regime.low:g} to {regime.high:g}", *(digits(*form, regime) for form in forms))
        assert f"| {' | '.join(cells)} |" in page
    first = REGIMES[0]
    lost = max(float(digits(law, DIFFERENCE, first)) - float(digits(law, PRINTED, first)) for law in (WATER, GENERAL))
    assert f"up to {lost:.1f} digits" in page
    assert f"up to {lost:.1f} digits" in (PAGE.parents[1] / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("regime", REGIMES, ids=str)
@pytest.mark.parametrize(
    ("law", "method", "bound", "reached"),
    [
        (WATER, PRINTED, printed_bound, 0.5),
        (WATER, DIFFERENCE, factored_bound, 0.2),
        (GENERAL, DIFFERENCE, general_bound, 0.2),
    ],
    ids=["printed", "factored", "expm1"],
)
def test_errors_are_below_their_bounds(
    law: EOS, method: str, bound: Callable[[EOS, float], float], reached: float, regime: Regime
) -> None:
    """At the worst density found; the printed form's bound is nearly reached where it matters."""
    found = worst(law, method, regime)
    limit = bound(law, (found.rho - law.rho0) / law.rho0)
    assert found.error <= limit
    if regime.high < 0.1:
        assert found.error >= reached * limit
    if method == PRINTED and regime is REGIMES[0]:
        assert f"{printed_bound(law, 1e-12):.1e}".replace("e-0", "e-") in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "law", [EOS("linear", 1.2345, 7.89), EOS("cubic", 1.2345, 7.89, 2.5)], ids=lambda law: law.style
)
def test_other_laws_have_nothing_to_gain(law: EOS) -> None:
    assert all(worst(law, PRINTED, regime).error < 2.5 * U for regime in REGIMES)


@pytest.mark.parametrize("law", [WATER, GENERAL], ids=lambda law: law.style)
def test_inverse_is_well_conditioned_except_for_the_compression(law: EOS) -> None:
    d_n = np.geomspace(1e-12, 0.1, 400) * np.where(np.arange(400) % 2, -1, 1)
    p_n = law.cs**2 * law.rho0 / law.gamma * np.expm1(law.gamma * np.log1p(d_n))
    y_n = law.gamma * p_n / (law.cs**2 * law.rho0)
    with localcontext(prec=60):
        scale = Decimal(law.cs) ** 2 * Decimal(law.rho0)
        exact_n = [(1 + Decimal(law.gamma) * Decimal(p) / scale) ** (1 / Decimal(law.gamma)) for p in p_n.tolist()]

        def error(ratio_n: np.ndarray, offset: int) -> float:
            pairs = zip(ratio_n.tolist(), exact_n, strict=True)
            return max(float(abs(Decimal(r) / (exact - offset) - 1)) for r, exact in pairs)

        assert error((1 + y_n) ** (1 / law.gamma), 0) < 4 * U
        assert error(np.exp(np.log1p(y_n) / law.gamma), 0) < 4 * U
        assert error(np.expm1(np.log1p(y_n) / law.gamma), 1) < 8 * U
        assert error((1 + y_n) ** (1 / law.gamma) - 1, 1) > 1e-5


def test_pressure_at_rest_as_lammps_evaluates_it() -> None:
    rho0_n = np.arange(1.0, 1001.0)
    wrong_n = rho0_n[[EOS("tait/water", r).law.lammps(np.array([r]), None, None, r, 1.0, None)[0] != 0 for r in rho0_n]]
    assert f"for {len(wrong_n)} of the whole numbers" in PAGE.read_text(encoding="utf-8") and wrong_n[0] == 49
    assert all(EOS("tait/water", r).pressure(r) == 0 for r in wrong_n)


# --- the test for LAMMPS' own tree


@pytest.fixture
def upstream(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The test as a module, in which a LAMMPS is not needed."""
    monkeypatch.setitem(sys.modules, "lammps", ModuleType("lammps"))
    monkeypatch.setattr(sys.modules["lammps"], "lammps", None, raising=False)
    spec = importlib.util.spec_from_file_location("python_rheo_tait", TEST)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("method", "passes"), [(DIFFERENCE, True), (PRINTED, False)])
def test_upstream_test_passes_with_the_difference_first(
    upstream: ModuleType, monkeypatch: pytest.MonkeyPatch, method: str, passes: bool
) -> None:
    def pressures(words: str, rho0: float, rho_n: list[float]) -> list[float]:
        style, *parameter = words.split()
        law = EOS(style, rho0, upstream.CS, *map(float, parameter))
        function = next(m for m in METHODS if m.name == method).function(law, 0.5 * rho0, 2 * rho0)
        return list(map(float, function(np.array(rho_n), None)))

    monkeypatch.setattr(upstream, "pressures", pressures)
    result = upstream.unittest.TestResult()
    upstream.unittest.defaultTestLoader.loadTestsFromTestCase(upstream.RheoTait).run(result)
    assert (result.testsRun, len(result.failures), result.errors) == (3, 0 if passes else 3, [])


@pytest.mark.lammps
def test_upstream_test_fails_on_lammps() -> None:
    done = subprocess.run(
        [sys.executable, str(TEST)], env=environment(installations.resolve("env")), capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "FAILED (failures=3)" in done.stderr
    assert "tait/water at a compression of" in done.stderr
