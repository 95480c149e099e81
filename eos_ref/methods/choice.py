r"""The cheapest method that is accurate enough.

Costs come from a chart that was measured (`costs.json`, written by ``eos-ref chart --save-costs``): nanoseconds per
state, and the seconds that the first call takes (loading compiled code). Accuracy is not read from a chart but searched
for, with the law and the densities at hand, so that it holds for them and not only for what was charted.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eos_ref import EOS, EOSTable, InputError
from eos_ref.eos.table import FloatArray
from eos_ref.methods.laws import METHODS, LawMethod, methods_of
from eos_ref.methods.worst import SAMPLES, Worst, worst_case
from eos_ref.model.parameters import IntArray

COSTS = Path(__file__).with_name("costs.json")


@dataclass(frozen=True)
class Cost:
    """What a method costs: nanoseconds per state, and seconds before the first one."""

    ns: float
    startup: float

    def of(self, n: int) -> float:
        """Seconds for n states."""
        return self.startup + 1e-9 * self.ns * n


@dataclass(frozen=True)
class Choice:
    """How a law is evaluated.

    Attributes
    ----------
    method : LawMethod
    error : worst relative error found, see `eos_ref.methods.worst`; None: not asked for
    allowed : relative error that the scene accepts, to be added to bounds
    why : in words
    """

    method: LawMethod
    error: float | None = None
    allowed: float = 0.0
    why: str = "the best conditioned method that costs no more"


@cache
def measured() -> dict[str, Any]:
    """The costs as measured; see `COSTS`."""
    found: dict[str, Any] = json.loads(COSTS.read_text(encoding="utf-8"))
    return found


def cost(method: LawMethod, law: EOS) -> Cost:
    """Measured cost of a method for laws of a style."""
    return Cost(**measured()["laws"][law.style][method.name])


def default(law: EOS, n: int) -> LawMethod:
    """Of the best conditioned methods the cheapest for n states."""
    return min(_usable(law), key=lambda m: (m.conditioning, cost(m, law).of(n)))


def choose(law: EOS, rho_n: FloatArray, e_n: FloatArray | None, tolerance: float) -> Choice:
    """The cheapest method whose pressures of some states have a relative error below a tolerance.

    The error is relative as in `eos_ref.methods.worst`. It is searched for over the interval of the densities
    given, and screened at the densities themselves; the best conditioned methods come last, and are taken if no other
    is accurate enough.

    Raises
    ------
    InputError
        A tolerance that no method meets.
    """
    n, best, least = len(rho_n), None, np.inf
    for method in sorted(_usable(law), key=lambda m: (cost(m, law).of(n), m.conditioning)):
        error = worst_error(method, law, rho_n, e_n)
        least = min(least, error)
        if error <= tolerance:
            best = method
            break
    if best is None:
        raise InputError("tolerance", f"must be at least {least:.2g}, what the best method reaches here", tolerance)
    ns, startup = cost(best, law).ns, cost(best, law).startup
    why = (
        f"worst error {error:.1e} over rho from {rho_n.min():g} to {rho_n.max():g}, tolerance {tolerance:g}; "
        f"{ns:.3g} ns a state and {startup:.2g} s to start are the least for {n} states"
    )
    return Choice(best, error, tolerance, why)


def of_types(
    table: EOSTable,
    type_n: IntArray,
    rho_n: FloatArray,
    e_n: FloatArray | None,
    method: str = "default",
    tolerance: float | None = None,
) -> tuple[Choice, ...]:
    """How the law of every type is evaluated for the states of its particles.

    Parameters
    ----------
    method : "default", "auto", or the name of a method
    tolerance : of "auto"; None: as default

    Raises
    ------
    InputError
        A tolerance that no method meets; a name that is none, or not of a method for this law.
    """
    found = []
    for t, law in enumerate(table.laws, 1):
        of_type = type_n == t
        rho, e = rho_n[of_type], None if e_n is None else e_n[of_type]
        if not rho.size or method == "default" or (method == "auto" and tolerance is None):
            found.append(Choice(default(law, rho.size)))
        elif method == "auto":
            assert tolerance is not None
            found.append(choose(law, rho, e, tolerance))
        else:
            given = named(method, law)
            error = worst_error(given, law, rho, e)
            found.append(Choice(given, error, error, f"as the scene says; worst error {error:.1e}"))
    return tuple(found)


def stages(evaluations: int) -> Literal["plain", "compiled"]:
    """The cheaper stages for a number of evaluations of one particle."""
    found = {name: Cost(**each).of(evaluations) for name, each in measured()["stages"].items()}
    return "plain" if found["plain"] <= found["compiled"] else "compiled"


def worst_error(method: LawMethod, law: EOS, rho_n: FloatArray, e_n: FloatArray | None) -> float:
    """Worst relative error of a method over the interval that some densities span.

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
    found: list[Worst] = [worst_case(evaluate, law, start_n, inside, e) for e in energies]
    return max(worst.error for worst in found)


def named(name: str, law: EOS) -> LawMethod:
    """A method by its name.

    Raises
    ------
    InputError
        No such method, or not for this law.
    """
    if name not in {method.name for method in METHODS}:
        raise InputError("method", f"must be auto or one of {', '.join(m.name for m in METHODS)}", name)
    found = [method for method in _usable(law) if method.name == name]
    if not found:
        raise InputError("method", f"cannot evaluate {law.style} (parameter {law.parameter}) of doubles", name)
    return found[0]


def _usable(law: EOS) -> list[LawMethod]:
    """Methods for states that are doubles already, as LAMMPS' are."""
    return [method for method in methods_of(law) if method.store is None]
