"""Fluid thrown at a wall passes through if it is fast, and not if it is slow; settings that make walls tighter."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.setup import reference_side
from lammps_cases.studies.stability.maps import walls
from lammps_cases.studies.stability.model import ENGINES, Engine, MapCell, StabilityMap
from lammps_cases.studies.stability.runs import open_run
from tests.support.stability_cells import living, outcome

pytestmark = pytest.mark.slow

THROUGH = "wall penetration"


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
@pytest.mark.parametrize("of", walls.MAPS, ids=lambda of: of.id)
@pytest.mark.parametrize("layer", [walls.STORED, walls.RECONSTRUCT])
def test_speed(of: StabilityMap, layer: str, side: Engine) -> None:
    y = of.lines[1]
    assert outcome(of, 0.1, y, layer, side).kind == "stable"
    fast = outcome(of, 2.0, y, layer, side)
    assert fast.kind == THROUGH
    face = of.watch(MapCell(of.id, 2.0, y, layer)).behind
    assert face is not None and fast.value is not None
    assert fast.value < face[1]


def test_reconstruction_makes_walls_tighter() -> None:
    assert outcome(walls.THICKNESS, 0.36, 2.0, walls.STORED).kind == THROUGH
    assert outcome(walls.THICKNESS, 0.36, 2.0, walls.RECONSTRUCT).kind == "stable"


def test_stiffness_matters_only_with_reconstruction() -> None:
    assert outcome(walls.STIFFNESS, 0.5, 0.5, walls.RECONSTRUCT).kind == THROUGH
    assert outcome(walls.STIFFNESS, 0.5, 2.0, walls.RECONSTRUCT).kind == "stable"
    ends = []
    for sound in (0.5, 1.0):  # the same time step
        cell = MapCell(walls.STIFFNESS.id, 0.2, sound, walls.STORED)
        run = open_run(walls.STIFFNESS.start(cell), walls.STIFFNESS.watch(cell), "reference", living())
        run.advance(50)
        ends.append(run.snapshot().x_nc)
    assert np.array_equal(ends[0], ends[1])


def test_artificial_viscosity_matters_only_without_reconstruction() -> None:
    assert outcome(walls.VISCOSITY, 0.6, 0.0, walls.STORED).kind == THROUGH
    assert outcome(walls.VISCOSITY, 0.6, 2.0, walls.STORED).kind == "stable"
    assert outcome(walls.VISCOSITY, 0.6, 2.0, walls.RECONSTRUCT).kind == THROUGH


def test_rows_of_the_wall() -> None:
    assert outcome(walls.THICKNESS, 0.2, 1.0, walls.STORED).kind == THROUGH
    assert outcome(walls.THICKNESS, 0.2, 3.0, walls.STORED).kind == "stable"


@pytest.mark.lammps
def test_missing_volume_explains_tighter_walls_of_lammps() -> None:
    """Compressed fluid has volumes below 1, which LAMMPS' forces lack, so its walls push harder."""
    x, y, layer = 0.74, 2.0, walls.RECONSTRUCT
    assert outcome(walls.STIFFNESS, x, y, layer).kind == THROUGH
    assert outcome(walls.STIFFNESS, x, y, layer, "lammps").kind == "stable"
    start = walls.STIFFNESS.start(MapCell(walls.STIFFNESS.id, x, y, layer))
    scene, atoms = start.case.scene, start.atoms
    like_lammps = type("LikeLammps", (ForcePerVolume, ArrayEvaluator), {})
    model, box, state = (
        reference_side.model(scene, atoms, ""),
        reference_side.box(scene, atoms),
        reference_side.state(scene, atoms),
    )
    simulation = Simulation(model, box, state, (), like_lammps)
    lowest = 0.0
    for _ in range(0, start.steps[-1], 10):
        simulation.run(10, start.timestep)
        lowest = min(lowest, float(simulation.state.x_nc[atoms.type_n == 1, 1].min()))
    assert lowest > -0.5


def test_face_lies_behind_the_solids() -> None:
    for layers in (1.0, 2.0, 3.0):
        cell = MapCell(walls.THICKNESS.id, 0.2, layers, walls.STORED)
        start, watch = walls.THICKNESS.start(cell), walls.THICKNESS.watch(cell)
        solid_n = start.atoms.type_n == 2
        assert solid_n.sum() == layers * walls.BLOCK_WIDTH
        assert watch.behind == (1, start.atoms.x_nc[solid_n, 1].min() - 0.5)
