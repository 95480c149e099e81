"""Laws in LAMMPS' order of operations: each rounding where a scalar evaluation in that order has it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eos_ref.eos import bounds, lammps_rounding
from eos_ref.eos.table import EOS, EOSTable

RHO = np.random.default_rng(1).uniform(0.6, 1.3, 500)
ENERGY, MASS = np.random.default_rng(2).uniform(0.5, 3.0, (2, 500))
RHO0, CS, A = 0.93, 3.1, 2.3
EVERY_LAW = [
    EOS("linear", RHO0, CS),
    EOS("cubic", RHO0, CS, A),
    EOS("tait/water", RHO0, CS),
    EOS("tait/general", RHO0, CS, A),
    EOS("ideal/gas", RHO0, CS, A),
]


def scalar(law: EOS, rho: float, energy: float, mass: float) -> float:
    """One particle, one operation after the other."""
    if law.style == "linear":
        return CS * CS * (rho - RHO0)
    if law.style == "cubic":
        d = rho - RHO0
        return CS * CS * (d + A * d * d * d)
    if law.style == "tait/water":
        x = rho * (1.0 / RHO0)
        cube = x * x * x
        return CS * CS * RHO0 * (1.0 / 7.0) * (cube * cube * x - 1.0)
    if law.style == "tait/general":
        return CS * CS * RHO0 * (math.pow(rho * (1.0 / RHO0), A) - 1.0) / A
    return (A - 1.0) * rho * energy / mass


@pytest.mark.parametrize("law", EVERY_LAW, ids=lambda law: str(law.style))
def test_bits_are_those_of_scalars_in_the_same_order(law: EOS) -> None:
    expected = [scalar(law, *values) for values in zip(RHO.tolist(), ENERGY.tolist(), MASS.tolist(), strict=True)]
    np.testing.assert_array_equal(lammps_rounding.pressure_of_law(law, RHO, ENERGY, MASS), expected)


@pytest.mark.parametrize("law", EVERY_LAW, ids=lambda law: str(law.style))
def test_law_agrees_with_the_reference_within_the_bound(law: EOS) -> None:
    e = ENERGY / MASS
    own = lammps_rounding.pressure_of_law(law, RHO, ENERGY, MASS)
    table, type_n = EOSTable([law]), np.ones(RHO.size, int)
    bound_n = bounds.comparison(table, RHO, type_n, e)
    assert (np.abs(own - law.evaluate(RHO, e if law.needs_energy else None)) <= bound_n).all()
    assert bound_n.max() < 1e-12 * np.abs(own).max()


def test_the_background_is_added_last() -> None:
    law = EOS("linear", RHO0, CS, background=0.1)
    np.testing.assert_array_equal(lammps_rounding.pressure_of_law(law, RHO, None, None), CS * CS * (RHO - RHO0) + 0.1)


def test_every_particle_uses_the_law_of_its_type() -> None:
    table, type_n = EOSTable([EVERY_LAW[0], EVERY_LAW[4]]), np.arange(RHO.size) % 2 + 1
    p_n = lammps_rounding.pressure(table, RHO, type_n, ENERGY, MASS)
    for t, law in enumerate(table.laws, 1):
        of_type = type_n == t
        expected = lammps_rounding.pressure_of_law(law, RHO[of_type], ENERGY[of_type], MASS[of_type])
        np.testing.assert_array_equal(p_n[of_type], expected)


@pytest.mark.parametrize(("rho", "gamma"), [(-1.0, 2.5), (0.0, -1.0), (1e200, 9.0)])
def test_undefined_powers_follow_the_c_library(rho: float, gamma: float) -> None:
    """Where `math.pow` raises: a root of a negative number, a pole, an overflow."""
    law = EOS("tait/general", 1.0, 1.0, gamma)
    p = lammps_rounding.pressure_of_law(law, np.array([rho]), None, None)[0]
    assert math.isnan(p) if rho < 0 else math.isinf(p)
