"""Summed densities tolerate a small density ratio only; self/mass and continuity tolerate a large one."""

from __future__ import annotations

import numpy as np
import pytest

from lammps_cases.studies.stability.maps import tension
from lammps_cases.studies.stability.model import ENGINES, Engine, MapCell
from lammps_cases.studies.stability.runs import open_run
from tests.support.roundings import rounded
from tests.support.stability_cells import living, outcome

pytestmark = pytest.mark.slow

MAP = tension.PHASES_MAPS[0]


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
def test_density_ratio_of_ten(side: Engine) -> None:
    assert outcome(MAP, 10.0, 1.0, "continuity", side).kind == "stable"
    assert outcome(MAP, 10.0, 1.0, "harmonic/means", side).kind == "stable"
    assert outcome(MAP, 10.0, 1.0, "rho/sum", side).kind == "clumping"


def test_harmonic_means_tolerate_less() -> None:
    """They deprive the light particles of the heavy ones' viscosity, which damps them."""
    assert outcome(MAP, 80.0, 1.0, "continuity").kind == "stable"
    assert outcome(MAP, 80.0, 1.0, "harmonic/means").kind == "clumping"


@pytest.mark.lammps
def test_only_the_reference_has_self_mass() -> None:
    assert outcome(MAP, 10.0, 1.0, "rho/sum self/mass").kind == "stable"
    found = outcome(MAP, 10.0, 1.0, "rho/sum self/mass", "lammps")
    assert found.kind == "error"
    assert "self/mass" in found.message


@pytest.mark.parametrize("layer", ["continuity", "rho/sum self/mass"])
def test_large_ratios_fail(layer: str) -> None:
    assert outcome(MAP, 1000.0, 1.0, layer).kind != "stable"


def test_tension_of_summed_densities() -> None:
    """In the heavy fluid at the interface it agrees with the line of theory, which assumes an infinite ratio."""
    cell = MapCell(MAP.id, 1000.0, 1.0, "rho/sum")
    start = MAP.start(cell)
    run = open_run(start, MAP.watch(cell), "reference", living())
    look, heavy_n = run.snapshot(), start.atoms.type_n == 1
    depth_n = tension.SIZE / 4 - np.abs(start.atoms.x_nc[:, 0] - tension.SIZE / 2)
    face_n = heavy_n & (depth_n < 0.7)
    deep_n = heavy_n & (depth_n > 2.2)
    assert look.pressure_n[face_n].max() < 0 < tension.BACKGROUND
    assert abs(np.mean(look.pressure_n[deep_n]) - tension.BACKGROUND) < 0.05
    # On the interface half of the mass is missing; the first particles lie half a spacing inside.
    assert -0.5 < np.mean(look.pressure_n[face_n]) - tension.BACKGROUND < -0.2


def test_boundary_lies_beyond_the_viscous_limit() -> None:
    limit = tension.viscous_limit(1.0)
    assert limit == rounded(11.5, 8)  # 2 h^2/8 over nu dt = 0.1 x 0.2, less 1
    assert outcome(MAP, limit, 1.0, "continuity").kind == "stable"
