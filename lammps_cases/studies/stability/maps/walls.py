"""Walls of solid particles under the impact of fluid: the speed from which fluid passes through.

A block of fluid lies on the wall and moves towards it. Without interface/reconstruct a solid particle keeps its own
density and so, at rho0, has no pressure whatever its law: only the pressure of the fluid itself holds the fluid back.
With it the pressure of the fluid is extended into the wall and turned into a density by the law of the wall, so that
its stiffness counts; solids that lie deep in their own phase repel besides.

All masses are rho0 and the spacing is 1, so that volumes are 1 until the fluid is compressed.
"""

from __future__ import annotations

import math

import numpy as np

from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.layout import fluid, forces, rows, start, time_step
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap

WIDTH, ROWS = 8, 6  # of the block of fluid, periodic along the wall
NU = 0.1  # kinematic viscosity; sound grows with the time step unless dt < 2 nu/c^2
BELOW = 5.0  # empty space behind the wall
STORED, RECONSTRUCT = "stored", "interface/reconstruct"
SPEED = Axis("speed of impact / c", 0.05, 3.0, 0.04, log=True)


def _impact(cell: MapCell, layers: int = 3, artificial_visc: float = 0.0, sound: float = 1.0) -> Start:
    x_nc = rows(-layers, ROWS, WIDTH)
    fluid_n = x_nc[:, 1] > 0
    kind = fluid(viscosity=NU)
    faster = max(1.0, sound)
    return start(
        "impact",
        {
            "types": [kind, {**kind, "phase": "solid", "cs": sound}],
            "rheo": {"interface_reconstruct": cell.layer == RECONSTRUCT},
            "pair": {"artificial_visc": artificial_visc},
            "forces": forces(),
        },
        x_nc,
        (WIDTH, 3.0 * ROWS),
        (0.0, -layers - BELOW),
        options=Options(),
        # The block falls by half of its height, or sound crosses it and comes back.
        times=[max(ROWS / (2 * cell.x), 2.0 * ROWS)],
        timestep=min(time_step(Options(), faster + cell.x, NU), 2 * NU / faster**2),
        type_n=np.where(fluid_n, 1, 2),
        v_nc=np.where(fluid_n[:, None], (0.0, -cell.x), 0.0),
        periodic=(True, False),
    )


def _into(cell: MapCell) -> FailureCriteria:
    """Watch for fluid beyond the centres of the first row."""
    return FailureCriteria(every=10, behind=(1, -0.5))


THICKNESS = StabilityMap(
    "wall-thickness",
    "Fluid through a wall: speed and rows of the wall",
    "Penetration: fluid comes out behind the last row.",
    SPEED,
    Axis("rows of the wall", 1.0, 4.0, 1.0),
    (1.0, 2.0, 3.0),
    lambda cell: _impact(cell, layers=math.floor(cell.y)),
    lambda cell: FailureCriteria(every=10, behind=(1, -float(cell.y))),
    (STORED, RECONSTRUCT),
    tags=("quick",),
    quick_lines=(2.0,),
)
STIFFNESS = StabilityMap(
    "wall-stiffness",
    "Fluid into a wall: speed and stiffness of the wall",
    "Penetration: fluid passes the centres of the first row. The speed of sound of the wall makes no difference "
    "without interface/reconstruct.",
    SPEED,
    Axis("speed of sound of the wall / c", 0.5, 2.0, 0.1),
    (0.5, 1.0, 2.0),
    lambda cell: _impact(cell, sound=cell.y),
    _into,
    (STORED, RECONSTRUCT),
)
VISCOSITY = StabilityMap(
    "wall-viscosity",
    "Fluid into a wall: speed and artificial viscosity",
    "Penetration: fluid passes the centres of the first row. Artificial viscosity acts between fluid and wall only "
    "without interface/reconstruct.",
    SPEED,
    Axis("artificial viscosity", 0.0, 2.0, 0.1),
    (0.0, 0.5, 2.0),
    lambda cell: _impact(cell, artificial_visc=cell.y),
    _into,
    (STORED, RECONSTRUCT),
)

MAPS = (THICKNESS, STIFFNESS, VISCOSITY)
