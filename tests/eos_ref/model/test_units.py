"""Systems of units: the factors against constants of nature, and the unit of each quantity."""

from __future__ import annotations

import pytest

from eos_ref.model.quantities import QUANTITIES
from eos_ref.model.units import KINDS, UNITS
from tests.support.roundings import rounded

CALORIE, CHARGE, MOLE = 4.184, 1.602176634e-19, 6.02214076e23  # J, C, 1/mol (SI since 2019)
UNIT_OF_ENERGY = {"real": 1000 * CALORIE / MOLE, "metal": CHARGE}
UNIT_OF_PRESSURE = {"real": 101325.0, "metal": 1e5}
# How far constants of any age may lie from today's: Avogadro's constant and the charge of CODATA 1986, added.
SINCE_1986 = abs(6.0221367e23 / MOLE - 1) + abs(1.60217733e-19 / CHARGE - 1)


@pytest.mark.parametrize("name", ["real", "metal"])
def test_factors_are_ratios_of_units(name: str) -> None:
    """To the accuracy of LAMMPS' constants, which predate today's definitions."""
    u = UNITS[name]
    energy = u.mass * u.length**2 / u.time**2
    assert u.mass == pytest.approx(1e-3 / MOLE, rel=SINCE_1986, abs=0)
    assert u.energy == pytest.approx(UNIT_OF_ENERGY[name] / energy, rel=SINCE_1986, abs=0)
    assert u.pressure == pytest.approx(UNIT_OF_PRESSURE[name] / (energy / u.length**3), rel=SINCE_1986, abs=0)
    assert u.density == pytest.approx(1000.0 / (u.mass / u.length**3), rel=SINCE_1986, abs=0)
    assert u.viscosity == pytest.approx(0.1 / (energy * u.time / u.length**3), rel=SINCE_1986, abs=0)


def test_other_systems_have_no_factors() -> None:
    assert {name for name, u in UNITS.items() if not u.consistent} == {"real", "metal"}
    assert all(UNITS["si"].of(name) == 1 for name in QUANTITIES)


def test_every_quantity_with_mass_has_a_kind() -> None:
    """Mass comes in through energy, pressure, density and viscosity alone; so a new field cannot be forgotten."""
    u = UNITS["metal"]
    with_mass = {name for name, q in QUANTITIES.items() if q.dimension.mass}
    assert {name for name in QUANTITIES if u.of(name) != 1} == with_mass | {"cv"}
    shapes = {kind: {QUANTITIES[n].dimension.volume for n in names if n in QUANTITIES} for kind, names in KINDS.items()}
    assert shapes["density"] == shapes["viscosity"] == {-1}
    assert shapes["pressure"] == {-1, 0}  # stress/atom is a pressure times a volume


def test_unit_of_a3_follows_from_the_formula() -> None:
    assert UNITS["real"].of("A3") == rounded(UNITS["real"].density ** -2, 3)
