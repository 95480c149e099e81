r"""Walls of solid particles: under the impact of fluid, and below a column at rest, a dam break, a falling drop.

Impact: the speed from which fluid passes through. A block of fluid lies on the wall and moves towards it. Without
interface/reconstruct a solid particle keeps its own density and so, at rho0, has no pressure whatever its law: only the
pressure of the fluid itself holds the fluid back. With it the pressure of the fluid is extrapolated into the wall and
turned into a density by the law of the wall, so that its stiffness counts; solids deep in their own phase repel too.
All masses are rho0 and the spacing is 1, so that volumes are 1 until the fluid is compressed.

Whole flows: particles at spacing 1 with m = rho0, so that volumes are 1 except for compression; c = 1; walls of three
rows, with interface/reconstruct. Time steps are given over :math:`\min(h/4(c+U),\,h^2/8\nu)` (Morris, Fox & Zhu,
J. Comput. Phys. 136, 214 (1997)), h = cut/3 and U the largest speed of the scene. Penetration: fluid passes the centres
of the first row of the floor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.studies.flows.flow import Options, Start, fluid, forces, rows, start, time_step
from lammps_cases.studies.flows.surfaces import disc
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

BLOCK_WIDTH, ROWS = 8, 6  # of the block of fluid, periodic along the wall
BLOCK_NU = 0.1  # kinematic viscosity; sound grows with the time step unless dt < 2 nu/c^2
BELOW = 5.0  # empty space behind the wall
STORED, RECONSTRUCT = "stored", "interface/reconstruct"
SPEED = Axis("speed of impact / c", 0.05, 3.0, 0.04, log=True)


def _impact(cell: MapCell, layers: int = 3, artificial_visc: float = 0.0, sound: float = 1.0) -> Start:
    x_nc = rows(-layers, ROWS, BLOCK_WIDTH)
    fluid_n = x_nc[:, 1] > 0
    kind = fluid(viscosity=BLOCK_NU)
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
        (BLOCK_WIDTH, 3.0 * ROWS),
        (0.0, -layers - BELOW),
        options=Options(),
        # The block falls by half of its height, or sound crosses it and returns.
        times=[max(ROWS / (2 * cell.x), 2.0 * ROWS)],
        timestep=min(time_step(Options(), faster + cell.x, BLOCK_NU), 2 * BLOCK_NU / faster**2),
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


LAYERS = 3  # rows of a wall
FLOOR = -0.5  # centres of the first row
STEP = Axis("time step / limit of Morris, Fox & Zhu", 0.3, 10.0, 0.04, log=True)
MORRIS = Theory("Morris, Fox & Zhu", lambda _: 1.0)
DAMPED: Mapping[str, float] = {"artificial_visc": 0.1, "rho_damp": 0.1}


def _every(cell: MapCell) -> int:
    """Return the steps between observations where x is the time step: beyond the limit particles soon scatter."""
    return max(1, round(10 / cell.x))


def _scene(
    name: str,
    fluid_nc: FloatArray,
    solid_nc: FloatArray,
    corners: tuple[Sequence[float], Sequence[float]],
    *,
    gravity: float,
    nu: float,
    time: float,
    timestep: float,
    pair: Mapping[str, float] | None = None,
    speed: float = 0.0,
    periodic: bool = True,
) -> Start:
    """Return fluid (type 1) that moves down at a speed, and solid particles (type 2) that stay."""
    type_n = np.repeat([1, 2], [len(fluid_nc), len(solid_nc)])
    kind = fluid(viscosity=nu)
    return start(
        name,
        {
            "types": [kind, {**kind, "phase": "solid"}],
            "rheo": {"interface_reconstruct": True},
            "pair": pair or {},
            "forces": forces(gravity=(0.0, -gravity)),
        },
        np.vstack([fluid_nc, solid_nc]),
        corners[1],
        corners[0],
        options=Options(),
        times=[time],
        timestep=timestep,
        type_n=type_n,
        v_nc=np.where((type_n == 1)[:, None], (0.0, -speed), 0.0),
        periodic=(periodic, False),
    )


# --- column

WIDTH, TALL = 8, 12
COMPRESSION = 0.05  # g H/c^2


def _column(cell: MapCell) -> Start:
    return _scene(
        "column",
        rows(0, TALL, WIDTH),
        rows(-LAYERS, 0, WIDTH),
        ((0.0, -LAYERS - 1.0), (WIDTH, 2.0 * TALL)),
        gravity=COMPRESSION / TALL,
        nu=cell.y,
        time=4.0 * TALL,
        timestep=cell.x * time_step(Options(), 1.0, cell.y),
    )


def _falls_by_its_weight(cell: MapCell) -> FailureCriteria:
    """Watch for twice the energy of the wave excited by the sudden weight, which moves the fluid at g H/c."""
    return FailureCriteria(
        every=_every(cell), growth=2.0, energy=0.5 * WIDTH * TALL * COMPRESSION**2, behind=(1, FLOOR)
    )


COLUMN = StabilityMap(
    "column",
    "Hydrostatic column: time step and viscosity",
    "A column of uniform density takes up its own weight, while sound goes down and up twice. Below 2 nu/c^2 sound is "
    "damped, above it grows, the slower the closer to it.",
    STEP,
    Axis("kinematic viscosity / c h", 0.01, 1.0, 0.1, log=True),
    (0.01, 0.05, 0.2, 1.0),
    _column,
    _falls_by_its_weight,
    theory=(MORRIS, Theory("dt = 2 nu/c^2", lambda nu: 2 * nu / time_step(Options(), 1.0, nu))),
    tags=("quick",),
    quick_lines=(0.2,),
)


# --- dam break

DAM = 10  # height and width of the fluid
SPAN = 22  # of the tank
RIM = 6  # height of the walls above the dam
NU = 0.02


def _dam(cell: MapCell) -> Start:
    tank_nc = rows(-LAYERS, DAM + RIM, SPAN + 2 * LAYERS) - (LAYERS, 0)
    x_n, y_n = tank_nc.T
    solid_n = (y_n < 0) | (x_n < 0) | (x_n > SPAN)
    edge = LAYERS + 1.0
    return _scene(
        "dam-break",
        rows(0, DAM, DAM),
        tank_nc[solid_n],
        ((-edge, -edge), (SPAN + edge, 3.0 * DAM)),
        gravity=cell.x**2 / (2 * DAM),
        nu=NU,
        time=SPAN / cell.x,
        timestep=time_step(Options(), 1.0 + cell.x, NU),
        pair={"artificial_visc": cell.y, "rho_damp": 0.1},
        periodic=False,
    )


def _falls_from_the_dam(cell: MapCell) -> FailureCriteria:
    """Watch for more than the potential energy over the floor, m g H/2, and a fifth of it for compression."""
    return FailureCriteria(every=10, growth=1.2, energy=DAM**2 * cell.x**2 / 4, behind=(1, FLOOR))


DAM_BREAK = StabilityMap(
    "dam-break",
    "Dam break: Mach number and artificial viscosity",
    "A block of fluid, released in a corner of a tank, runs to the other wall. The usual rule is a Mach number of at "
    "most 0.1; fluid enters the floor where it stops being weakly compressible.",
    Axis("(2 g H)^(1/2) / c", 0.05, 2.0, 0.06, log=True),
    Axis("artificial viscosity", 0.0, 1.0, 0.1),
    (0.0, 0.3, 1.0),
    _dam,
    _falls_from_the_dam,
    theory=(Theory("weakly compressible", lambda _: 0.1),),
)


# --- falling drop

ACROSS = 10
GAP = 2.0  # between drop and floor


def _disc() -> FloatArray:
    """Return the sites of a square lattice in a circle above the floor."""
    disc_nc = disc(ACROSS)
    return np.asarray(disc_nc + np.array([0.0, GAP - disc_nc[:, 1].min()]))


def _drop(cell: MapCell) -> Start:
    return _scene(
        "falling-drop",
        _disc(),
        rows(-LAYERS, 0, 4 * ACROSS) - (2 * ACROSS, 0),
        ((-2.0 * ACROSS, -LAYERS - 1.0), (2.0 * ACROSS, 3.0 * ACROSS)),
        gravity=cell.y**2 / (2 * ACROSS),
        nu=0.05,
        time=ACROSS / cell.y,
        timestep=cell.x * time_step(Options(), 1.0 + cell.y, 0.05),
        pair=DAMPED,
        speed=cell.y,
    )


def _falls_as_a_drop(cell: MapCell) -> FailureCriteria:
    r"""Watch for more than the initial kinetic energy and the gain of the fall, :math:`g` times gap and diameter."""
    first = 0.5 * len(_disc()) * cell.y**2
    return FailureCriteria(
        every=_every(cell), growth=1.0, energy=first * (1 + (GAP + ACROSS) / ACROSS), behind=(1, FLOOR)
    )


DROP = StabilityMap(
    "falling-drop",
    "Falling drop: time step and Mach number",
    "A round drop falls onto a floor and spreads. Beyond a limit of the time step its energy grows; a fast drop "
    "enters the floor at any time step.",
    STEP,
    Axis("speed / c", 0.05, 0.4, 0.1, log=True),
    (0.05, 0.2, 0.3, 0.4),
    _drop,
    _falls_as_a_drop,
    theory=(MORRIS,),
)

WHOLE_MAPS = (COLUMN, DAM_BREAK, DROP)
