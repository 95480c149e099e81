"""Equations of state of arrays that carry their rounding error, and of any other kind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from eos_ref.eos import bounds
from eos_ref.eos.table import EOS, EOSTable
from eos_ref.numbers.columns import Number
from eos_ref.numbers.rounded import Rounded, error, value


def by_type(
    law: Callable[[EOS, Number, Number], Number],
    table: EOSTable,
    type_n: npt.NDArray[np.integer],
    argument_n: Number,
    e_n: Number,
) -> Number:
    """`pressure` or `density` of every particle by the law of its type; ``e_n`` energy per mass, or None."""
    found, errors = np.empty(len(type_n), value(argument_n).dtype), np.zeros(len(type_n))
    for t, eos in enumerate(table, 1):
        at = type_n == t
        part = law(eos, argument_n[at], None if e_n is None else e_n[at])
        found[at], errors[at] = value(part), error(part)
    return Rounded(found, errors) if isinstance(argument_n, Rounded) else found


def pressure(eos: EOS, rho: Number, e: Number) -> Number:
    """Pressure; of a `Rounded` density with the law's own rounding bound and the density's error carried over."""
    if not isinstance(rho, Rounded):
        return eos.evaluate(rho, e)
    energy = None if e is None else value(e)
    p = eos.evaluate(rho.value, energy)
    own = bounds.engine(eos, rho.value, energy) + bounds.reference(eos, rho.value, energy)
    with np.errstate(all="ignore"):
        carried = np.abs(eos.stiffness(rho.value, energy)) * rho.error
    if terms := eos.law.energy:
        slope = terms.slope(rho.value, energy, eos.rho0, eos.cs, eos.parameter)
        carried = carried + np.abs(slope) * error(e)
    return Rounded(p, own + carried)


def density(eos: EOS, p: Number, e: Number) -> Number:
    r"""Density of a pressure; the error of a `Rounded` pressure divided by :math:`\partial P/\partial\rho`."""
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
