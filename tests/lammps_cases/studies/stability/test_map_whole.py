"""Whole scenes are stable at a small time step and Mach number, and fail at large ones."""

from __future__ import annotations

import numpy as np
import pytest

from lammps_cases.studies.stability.kinds import kinetic_energy
from lammps_cases.studies.stability.maps import walls
from lammps_cases.studies.stability.model import ENGINES, Engine, MapCell
from lammps_cases.studies.stability.runs import open_run
from tests.support.stability_cells import living, outcome

pytestmark = pytest.mark.slow


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
def test_column(side: Engine) -> None:
    """Viscosity limits the step as in a shear wave, where the measured limit is 4.18 times Morris'."""
    assert outcome(walls.COLUMN, 1.0, 1.0, side=side).kind == "stable"
    assert outcome(walls.COLUMN, 3.8, 1.0, side=side).kind == "stable"
    assert outcome(walls.COLUMN, 4.6, 1.0, side=side).kind == "energy growth"


def test_column_swings_about_its_weight() -> None:
    """Sound travels down and up twice in one period of the lowest mode; the mean pressure at the bottom is g H."""
    cell = MapCell(walls.COLUMN.id, 1.0, 0.2, "")
    start = walls.COLUMN.start(cell)
    run = open_run(start, walls.COLUMN.watch(cell), "reference", living())
    bottom_n = (start.atoms.type_n == 1) & (start.atoms.x_nc[:, 1] < 1)
    energies, pressures = [], []
    while run.step < start.steps[-1]:
        run.advance(1)
        look = run.snapshot()
        energies.append(kinetic_energy(start.atoms.mass_n, look.v_nc))
        pressures.append(np.mean(look.pressure_n[bottom_n]))
    supplied = walls.COLUMN.watch(cell).energy
    assert supplied is not None
    assert 0.1 * supplied < max(energies) < supplied  # the scale of the criterion has the right size
    weight = walls.COMPRESSION * (walls.TALL - 0.5) / walls.TALL
    # Except for the compression, of the fluid above and of the oscillating fluid.
    assert np.mean(pressures) == pytest.approx(weight, rel=2 * walls.COMPRESSION)


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
def test_dam_break(side: Engine) -> None:
    assert outcome(walls.DAM_BREAK, 0.3, 0.3, side=side).kind == "stable"
    assert outcome(walls.DAM_BREAK, 1.5, 0.3, side=side).kind == "wall penetration"


def test_dam_reaches_the_opposite_wall() -> None:
    cell = MapCell(walls.DAM_BREAK.id, 0.3, 0.3, "")
    start = walls.DAM_BREAK.start(cell)
    run = open_run(start, walls.DAM_BREAK.watch(cell), "reference", living())
    assert run.snapshot().x_nc[start.atoms.type_n == 1, 0].max() < walls.DAM
    run.advance(start.steps[-1])
    front = run.snapshot().x_nc[start.atoms.type_n == 1, 0].max()
    assert walls.SPAN - 2 < front < walls.SPAN


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
def test_falling_drop(side: Engine) -> None:
    assert outcome(walls.DROP, 1.0, 0.2, side=side).kind == "stable"
    assert outcome(walls.DROP, 9.0, 0.2, side=side).kind not in ("stable", "wall penetration")
    assert outcome(walls.DROP, 1.0, 0.4, side=side).kind == "wall penetration"


def test_only_the_time_step_changes_along_x() -> None:
    """So that the map gives limits of the time step."""
    for of in (walls.COLUMN, walls.DROP):
        a, b = (of.start(MapCell(of.id, x, 0.2, "")) for x in (0.5, 2.0))
        assert 3.5 < b.timestep / a.timestep < 4.5
        assert np.array_equal(a.atoms.x_nc, b.atoms.x_nc)
        assert a.case.scene.types == b.case.scene.types
