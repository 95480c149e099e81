r"""Whole scenes under gravity, over a floor of solid particles: a column at rest, a dam break, a falling drop.

Particles at spacing 1 with m = rho0, so that volumes are 1 but for the compression, and that LAMMPS'
forces lack the volume does not hide all else; c = 1; walls of three rows, with interface/reconstruct. Time steps are
given over :math:`\min(h/4(c+U),\,h^2/8\nu)` (Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997)), h = cut/3 and U the
largest speed of the scene. Penetration: fluid passes the centres of the first row of the floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.layout import fluid, forces, rows, start, time_step
from lammps_cases.studies.flows.surfaces import disc
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

LAYERS = 3  # rows of a wall
FLOOR = -0.5  # centres of the first row
STEP = Axis("time step / limit of Morris, Fox & Zhu", 0.3, 10.0, 0.04, log=True)
MORRIS = Theory("Morris, Fox & Zhu", lambda _: 1.0)
DAMPED: Mapping[str, float] = {"artificial_visc": 0.1, "rho_damp": 0.1}


def _every(cell: MapCell) -> int:
    """Return the steps between observations where x is the time step: beyond the limit particles scatter soon."""
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
    """Watch for twice the energy of the wave that the sudden weight sets off, which moves the fluid at g H/c."""
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
RIM = 6  # by which the walls are higher than the dam
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
    """Watch for more than the potential energy over the floor, m g H/2, and a fifth of it for the compression."""
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
    r"""Watch for more than the first kinetic energy and the gain on the way down, :math:`g` times gap and diameter."""
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

MAPS = (COLUMN, DAM_BREAK, DROP)
