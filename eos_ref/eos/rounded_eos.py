"""Equations of state of arrays that carry their rounding error, and of any other kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos import bounds
from eos_ref.eos.table import EOS, EOSTable
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Rounded, error, value


def by_type(
    law: Callable[[EOS, Any, Any], Any],
    table: EOSTable,
    type_n: npt.NDArray[np.integer],
    argument_n: Array,
    e_n: Array | None,
) -> Array:
    """Return the `pressure` or `density` of every particle by the law of its type, (n,); ``e_n`` energy per mass."""
    if len(table) == 1:  # as in most scenes: nothing is to be picked
        part = law(table[1], argument_n, e_n)
        return part if isinstance(part, Rounded) else value(part).astype(value(argument_n).dtype, copy=False)
    values, errors = np.empty(len(type_n), value(argument_n).dtype), np.zeros(len(type_n))
    for t, eos in enumerate(table, 1):
        at = type_n == t
        part = law(eos, argument_n[at], None if e_n is None else e_n[at])
        values[at], errors[at] = value(part), error(part)
    return Rounded(values, errors) if isinstance(argument_n, Rounded) else values


def pressure(eos: EOS, rho: Any, e: Any) -> Any:
    """Return the pressure; that of a `Rounded` density has the law's own rounding bound and the density's error.

    Stiffnesses are largest at an end of an interval: they are monotonic or convex in the density.
    """
    if not isinstance(rho, Rounded):
        return eos.evaluate(rho, e)
    energy = None if e is None else value(e)
    p = eos.evaluate(rho.value, energy)
    own = bounds.engine(eos, rho.value, energy) + bounds.reference(eos, rho.value, energy)
    with np.errstate(all="ignore"):
        ends = [rho.value - rho.error, rho.value + rho.error]
        carried = np.maximum(*(np.abs(eos.stiffness(end, energy)) for end in ends)) * rho.error
    if terms := eos.law.energy:
        slopes = (terms.slope(end, energy, eos.rho0, eos.cs, eos.parameter) for end in ends)
        carried = carried + np.maximum(*map(np.abs, slopes)) * error(e)
    return Rounded(p, own + carried)


def density(eos: EOS, p: Any, e: Any) -> Any:
    r"""Return the density of a pressure; of a `Rounded` one with its error over :math:`\partial P/\partial\rho`."""
    if not isinstance(p, Rounded):
        return np.asarray(eos.density(p, e))
    energy = None if e is None else value(e)
    rho = np.asarray(eos.density(p.value, energy))
    with np.errstate(all="ignore"):
        own = bounds.engine(eos, rho, energy) + bounds.reference(eos, rho, energy)
        carried = (own + p.error) / np.abs(eos.stiffness(rho, energy))
        if terms := eos.law.energy:
            slope = terms.inverse_slope(rho, energy, eos.rho0, eos.cs, eos.parameter)
            carried = carried + np.abs(slope) * error(e)
    return Rounded(rho, carried + 8 * bounds.EPS * np.abs(rho))
