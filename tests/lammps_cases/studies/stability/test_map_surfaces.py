"""Summed densities contract a free surface; wrong thresholds misclassify; and counts by theory."""

from __future__ import annotations

import numpy as np
import pytest

from lammps_cases.studies.stability.maps import matrices
from lammps_cases.studies.stability.model import ENGINES, Engine, MapCell
from lammps_cases.studies.stability.runs import open_run
from tests.support.stability_cells import living, outcome

pytestmark = pytest.mark.slow

WRONG = "misclassified surface"


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
def test_summed_densities_clump_at_a_surface(side: Engine) -> None:
    assert outcome(matrices.SUMMED, 20.0, 4.0, "rho/sum", side).kind == "clumping"
    assert outcome(matrices.SUMMED, 20.0, 4.0, "continuity", side).kind == "stable"
    assert outcome(matrices.SUMMED, 0.5, 4.0, "rho/sum", side).kind == "stable"


def test_clumping_begins_at_the_surface_under_tension() -> None:
    cell = MapCell(matrices.SUMMED.id, 20.0, 4.0, "rho/sum")
    start = matrices.SUMMED.start(cell)
    run = open_run(start, matrices.SUMMED.watch(cell), "reference", living())
    look = run.snapshot()
    row_n = np.arange(len(start.atoms)) // matrices.WIDTH
    outer_n = np.isin(row_n, (0, matrices.ROWS - 1))
    assert look.pressure_n[outer_n].max() < 2 * look.pressure_n[~outer_n].min() < 0
    atom = outcome(matrices.SUMMED, 20.0, 4.0, "rho/sum").atom
    assert atom is not None
    assert min(row_n[atom - 1], matrices.ROWS - 1 - row_n[atom - 1]) <= 1


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
@pytest.mark.parametrize("layer", matrices.DETECTION.layers)
def test_wrong_limits_misclassify(layer: str, side: Engine) -> None:
    low = outcome(matrices.DETECTION, 0.4, 0.05, layer, side)
    assert (low.kind, low.value, low.atom) == (WRONG, 0.0, 1)  # a surface particle is classified as bulk
    high = outcome(matrices.DETECTION, 1.25, 0.05, layer, side)
    assert (high.kind, high.value) == (WRONG, 1.0)  # a bulk particle as surface
    assert high.atom == matrices.DEEP * matrices.WIDTH + 1
    assert outcome(matrices.DETECTION, 0.8, 0.05, layer, side).kind == "stable"


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
def test_wrong_splash_limits_misclassify(side: Engine) -> None:
    n = matrices.LAYERS * matrices.WIDTH
    low = outcome(matrices.SPLASH, 0.0, 2.0, side=side)
    assert (low.kind, low.atom, low.value) == (WRONG, n + 1, 1.0)
    high = outcome(matrices.SPLASH, 0.8, 2.0, side=side)
    assert (high.kind, high.atom, high.value) == (WRONG, 1, 2.0)
    assert outcome(matrices.SPLASH, 0.35, 2.0, side=side).kind == "stable"


def test_share_of_the_circle_is_its_area() -> None:
    """Compare with strips of the circle, each as wide as the circle at its middle.

    Widths rise and fall once by 2 R at most: the error of their sum is at most half a strip times both.
    """
    R, strips = matrices.CUT, 100_000
    for height in (-2.0, -0.5, 0.0, 1.3):
        thick = (height + R) / strips
        y_n = -R + thick * (np.arange(strips) + 0.5)
        area = float((2 * np.sqrt(R**2 - y_n**2)).sum()) * thick
        assert matrices.share(height) == pytest.approx(area / (np.pi * R**2), rel=0, abs=2 * R * thick / (np.pi * R**2))
    assert (matrices.share(-4.0), matrices.share(4.0)) == (0.0, 1.0)


def test_expected_classes_follow_from_the_geometry() -> None:
    """Rows farther than the cutoff from the surface are bulk, the outermost ones surface, and no others are judged."""
    cell = MapCell(matrices.DETECTION.id, 0.8, 0.05, "coordination")
    known = matrices.DETECTION.watch(cell).surface
    y_n = matrices.DETECTION.start(cell).atoms.x_nc[:, 1]
    for atom, kind in known.items():
        depth = min(y_n[atom - 1], matrices.LAYERS - y_n[atom - 1])
        assert depth < 1 if kind else depth > matrices.CUT
    assert sorted(known.values()).count(1) == 2 * matrices.WIDTH
    assert sorted(known.values()).count(0) == 3 * matrices.WIDTH
