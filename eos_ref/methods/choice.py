r"""The cheapest method that is accurate enough, for `eos_ref.EOS.pressure`.

Costs come from a chart that was measured (`costs.json`, written by ``eos-ref chart --save-costs``): nanoseconds per
state, and the seconds that the first call takes (loading compiled code). Accuracy is not read from a chart but searched
for, with the given law and densities, so that it holds for them and not only for what was charted.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref.eos.table import EOS, FloatArray
from eos_ref.errors import InputError
from eos_ref.methods.laws import LawMethod, methods_of
from eos_ref.methods.worst import SAMPLES, worst_case

COSTS = Path(__file__).with_name("costs.json")
AUTO = "auto"


@dataclass(frozen=True)
class Cost:
    """Cost of a method: nanoseconds per state, and seconds before the first one."""

    ns: float
    startup: float

    def of(self, n: int) -> float:
        """Return the seconds that n states take."""
        return self.startup + 1e-9 * self.ns * n


@dataclass(frozen=True)
class MethodChoice:
    """The method that ``method="auto"`` takes for some densities, and why; `str` says it in a sentence.

    Attributes
    ----------
    error : worst relative error found, over the interval of the densities
    seconds : of all densities, the first call included; NaN where no cost was measured
    refused : cheaper methods with their errors, above the tolerance
    """

    method: LawMethod
    error: float
    tolerance: float
    states: int
    seconds: float
    refused: tuple[tuple[str, float], ...] = ()

    def __str__(self) -> str:
        if np.isnan(self.seconds):
            why = "the reference's own, as no cost was measured for this law"
        else:
            why = f"{self.seconds:.2g} s for {self.states:,} states, the cheapest that is accurate enough"
        worse = ", ".join(f"{name} ({error:.2g})" for name, error in self.refused)
        cheaper = f"; cheaper, but not accurate enough: {worse}" if worse else ""
        return f"{self.method.name}: error {self.error:.2g} of {self.tolerance:.2g} allowed, {why}{cheaper}"


@cache
def measured() -> dict[str, dict[str, Cost]]:
    """Return the measured cost of every method by style of law; see `COSTS`."""
    laws: dict[str, dict[str, dict[str, float]]] = json.loads(COSTS.read_text(encoding="utf-8"))["laws"]
    return {style: {name: Cost(**cost) for name, cost in costs.items()} for style, costs in laws.items()}


def pressure(
    law: EOS, rho_n: FloatArray, e_n: FloatArray | None, method: str | None, tolerance: float | None
) -> FloatArray:
    """Return the pressure (n,) by a method; see `eos_ref.EOS.pressure`.

    Raises
    ------
    InputError
        Unknown method, a tolerance without "auto" or "auto" without one, a tolerance that no method meets.
    """
    if method is None or (tolerance is None) == (method == AUTO):
        raise InputError("tolerance", f'must be given with method="{AUTO}", and with no other', tolerance)
    chosen = named(method, law) if tolerance is None else None
    defined_n = law.is_defined(rho_n) & (True if e_n is None else np.isfinite(e_n))
    rho_d, e_d = rho_n[defined_n], None if e_n is None else e_n[defined_n]
    with np.errstate(all="ignore"):
        p_n = np.array(law.evaluate(rho_n, e_n))
    if not rho_d.size:
        return p_n
    if tolerance is not None:
        chosen = choose(law, rho_d, e_d, tolerance).method
    assert chosen is not None
    p_n[defined_n] = chosen.function(law, float(rho_d.min()), float(rho_d.max()))(rho_d, e_d)
    return p_n


def named(name: str, law: EOS) -> LawMethod:
    """Return a method by its name.

    Raises
    ------
    InputError
        No method of this name evaluates the law.
    """
    for method in methods_of(law):
        if method.name == name:
            return method
    names = ", ".join(method.name for method in methods_of(law))
    raise InputError("method", f"must, for {law.style}, be {AUTO} or one of {names}", name)


def choose(law: EOS, rho_n: FloatArray, e_n: FloatArray | None, tolerance: float) -> MethodChoice:
    """Return the cheapest method whose pressures of some states have a relative error of at most a tolerance, and why.

    The error is relative as in `eos_ref.methods.worst`. It is searched for over the interval of the densities
    given, and screened at the densities themselves. Of a law whose costs were not measured the reference's own
    methods alone are candidates.

    Raises
    ------
    InputError
        A tolerance that no method meets.
    """
    costs = measured().get(law.style, {})
    seconds = {method: costs[method.name].of(len(rho_n)) for method in methods_of(law) if method.name in costs}
    candidates = sorted(seconds, key=lambda m: (seconds[m], m.conditioning)) or [methods_of(law)[0]]
    refused: list[tuple[str, float]] = []
    for method in candidates:
        error = worst_error(method, law, rho_n, e_n)
        if error <= tolerance:
            return MethodChoice(method, error, tolerance, len(rho_n), seconds.get(method, np.nan), tuple(refused))
        refused.append((method.name, error))
    least = min(error for _, error in refused)
    raise InputError("tolerance", f"must be at least {least:.2g}, what the best method reaches here", tolerance)


def worst_error(method: LawMethod, law: EOS, rho_n: FloatArray, e_n: FloatArray | None) -> float:
    """Return the worst relative error of a method over the interval that some densities span.

    Distances to rho0 below the least one given are left out: no state is there.
    """
    d_n = np.abs(rho_n / law.rho0 - 1)
    low, high, nearest = float(rho_n.min()), float(rho_n.max()), float(d_n.min())
    even_n = np.linspace(low, high, SAMPLES)
    start_n = np.concatenate([rho_n[:: max(1, len(rho_n) // SAMPLES)], even_n])
    evaluate = method.function(law, low, high)

    def inside(rho: FloatArray) -> Any:
        return (rho >= low) & (rho <= high) & (np.abs(rho / law.rho0 - 1) >= nearest)

    energies: Sequence[float | None] = [None] if e_n is None else [float(e_n.min()), float(e_n.max())]
    return max(worst_case(evaluate, law, start_n, inside, e).error for e in energies)
