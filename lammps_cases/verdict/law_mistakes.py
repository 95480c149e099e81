"""Plausible mistakes in an equation of state, to find out what a scene can tell apart.

Each takes the laws and the state and returns the pressure that the mistaken formula gives, or None where the scene
has nothing the mistake could change. The lint uses them to name scenes in which a mistake would go unseen; the tests
plant them to prove that some case sees each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from eos_ref import EOS, EOSTable
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import EosState, evaluate, excess

Mutant = Callable[[EOSTable, EosState], FloatArray | None]


def _each_law(change: Callable[[EOS], EOS | None]) -> Mutant:
    """Return a mistake in the parameters of the laws it applies to."""

    def mutant(table: EOSTable, state: EosState) -> FloatArray | None:
        changed = [change(law) for law in table.laws]
        if all(law is None for law in changed):
            return None
        laws = tuple(new or old for new, old in zip(changed, table.laws, strict=True))
        return evaluate(EOSTable(laws), state)

    return mutant


def _with_cs(law: EOS, cs: float) -> EOS | None:
    return None if law.needs_energy else replace(law, cs=cs)


def _with_rho0(law: EOS, rho0: float) -> EOS | None:
    return None if law.needs_energy else replace(law, rho0=rho0)


def _as_linear(law: EOS) -> EOS | None:
    linear = EOS("linear", law.rho0, law.cs, None, law.background)
    return None if law.needs_energy or law == linear or law.exponent == 1 else linear


def _exchanged_types(table: EOSTable, state: EosState) -> FloatArray | None:
    if len(table) == 1:
        return None
    rolled = EOSTable((*table.laws[1:], table.laws[0]))
    if rolled.needs_energy and state.e_n is None:
        return None
    return evaluate(rolled, state)


def _energy_of_particle(table: EOSTable, state: EosState) -> FloatArray | None:
    if not table.needs_energy or state.energy_n is None:
        return None
    return evaluate(table, replace(state, mass_n=np.ones_like(state.mass_n)))


def _float32_density(table: EOSTable, state: EosState) -> FloatArray | None:
    return evaluate(table, replace(state, rho_n=state.rho_n.astype(np.float32).astype(float)))


def _float32_pressure(table: EOSTable, state: EosState) -> FloatArray | None:
    p_n = evaluate(table, state)
    with np.errstate(over="ignore"):
        return p_n.astype(np.float32).astype(float)


def _sign(table: EOSTable, state: EosState) -> FloatArray | None:
    return -evaluate(table, state)


MUTANTS: dict[str, Mutant] = {
    "cs instead of cs^2": _each_law(lambda law: _with_cs(law, law.cs**0.5)),
    "cs ignored": _each_law(lambda law: _with_cs(law, 1.0)),
    "rho0 ignored": _each_law(lambda law: _with_rho0(law, 1.0)),
    "rho0 and cs exchanged": _each_law(
        lambda law: None if law.needs_energy else replace(law, rho0=law.cs, cs=law.rho0)
    ),
    "cs off by 1e-6": _each_law(lambda law: _with_cs(law, law.cs * (1 + 1e-6))),
    "sign of the pressure": _sign,
    "background dropped": _each_law(lambda law: replace(law, background=0.0) if law.background else None),
    "background subtracted": _each_law(
        lambda law: replace(law, background=-law.background) if law.background else None
    ),
    "A3 dropped": _each_law(
        lambda law: replace(law, parameter=0.0) if law.law.parameter == "A3" and law.parameter else None
    ),
    "A3 of the wrong sign": _each_law(
        lambda law: replace(law, parameter=-law.parameter) if law.law.parameter == "A3" and law.parameter else None
    ),
    "exponent 7 for every Tait law": _each_law(
        lambda law: replace(law, parameter=7.0) if law.exponent is not None and law.parameter is not None else None
    ),
    "exponent off by one": _each_law(
        lambda law: (
            None
            if law.exponent is None
            else EOS("tait/general", law.rho0, law.cs, law.exponent + 1 or 0.5, law.background)
        )
    ),
    "linear instead of Tait or cubic": _each_law(_as_linear),
    "gamma instead of gamma - 1": _each_law(
        lambda law: replace(law, parameter=law.gamma + 1) if law.needs_energy and law.law.parameter == "gamma" else None
    ),
    "energy not per unit mass": _energy_of_particle,
    "types exchanged": _exchanged_types,
    "density in float32": _float32_density,
    "pressure in float32": _float32_pressure,
}


def unseen(table: EOSTable, state: EosState, reference_n: FloatArray, bound_n: FloatArray) -> list[str]:
    """Return the names of the mistakes that stay within the bound on every particle: the scene is blind to them."""
    blind = []
    for name, mutant in MUTANTS.items():
        with np.errstate(all="ignore"):
            p_n = mutant(table, state)
            if p_n is not None and bool(np.all(excess(p_n, reference_n, bound_n)[1] <= 1)):
                blind.append(name)
    return blind
