r"""Free surfaces: summed densities, which lack half of their sum there, and the thresholds of surface/detection.

A density that is summed over neighbours falls towards a free surface, and the law makes a tension of it,
:math:`P=c^2(\rho-\rho_0)<0`: the surface is drawn in and particles clump there, which densities by continuity spare.

Detection counts neighbours or takes the divergence of position. Seen as a continuum, with a particle per unit of area
and f the share of the circle of the cutoff that lies in the fluid, a particle has :math:`\pi r_c^2f-1` neighbours.
"""

from __future__ import annotations

import math

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.layout import fluid, rows, start, time_step
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

WIDTH = 8  # of a layer of fluid, periodic
MARGIN = 5.0  # empty space above and below
NU = 0.2  # kinematic viscosity

# --- summed densities

ROWS = 10
TIME = 10.0


def _layer(name: str, number: int, disorder: float) -> FloatArray:
    """Return rows of fluid from y = 0 on, moved at random, shape (n, 2)."""
    x_nc = rows(0, number, WIDTH)
    x_nc += disorder * np.random.default_rng(seed(name)).uniform(-1, 1, x_nc.shape)
    x_nc[:, 0] %= WIDTH
    return x_nc


def _summed(cell: MapCell) -> Start:
    cs = cell.x / TIME
    options = Options(cut=cell.y, rho_sum=cell.layer == "rho/sum")
    # Sound grows with the time step unless dt < 2 nu/c^2.
    return start(
        "summed-surface",
        {"types": [fluid(cs=cs, viscosity=NU)]},
        _layer("summed-surface", ROWS, 0.05),
        (WIDTH, ROWS + MARGIN),
        (0.0, -MARGIN),
        options=options,
        times=[TIME],
        timestep=min(time_step(options, cs, NU), 2 * NU / cs**2),
        periodic=(True, False),
    )


SUMMED = StabilityMap(
    "summed-surface",
    "Free surface with summed densities",
    "A layer of fluid at rest between two free surfaces, for a given time. Densities by continuity leave it there. "
    "Summed ones are too low near the surface: the tension makes particles clump, the sooner the more neighbours the "
    "kernel has.",
    Axis("speed of sound x time / spacing", 0.1, 40.0, 0.04, log=True),
    Axis("cutoff / spacing", 2.4, 5.0, 0.1),
    (2.4, 3.0, 3.5, 4.0, 5.0),
    _summed,
    lambda cell: FailureCriteria(every=10, closest=0.5),
    ("rho/sum", "continuity"),
    tags=("quick",),
    quick_lines=(3.0, 4.0),
)


# --- surface/detection

CUT = 3.0
ALL = math.pi * CUT**2 - 1  # neighbours in the bulk, as a continuum
DEEP = math.ceil(CUT)  # rows that a circle around the next one reaches
LAYERS = 9
STILL = 0.01  # a time step; nothing moves by itself


def share(height: float) -> float:
    """Return the share of the cutoff's circle below a plane ``height`` above (or, negative, below) its centre."""
    u = min(max(height / CUT, -1.0), 1.0)
    return 0.5 + (u * math.sqrt(1 - u * u) + math.asin(u)) / math.pi


def neighbours(depth: float) -> float:
    """Return the neighbours of a particle ``depth`` below the surface (above, if negative) over those in the bulk."""
    own = 1 if depth >= 0 else 0  # one that flies above is no part of the fluid
    return (math.pi * CUT**2 * share(depth) - own) / ALL


def _detecting(name: str, x_nc: FloatArray, style: str, limit: float, splash: int) -> Start:
    return start(
        name,
        {
            "types": [fluid(viscosity=NU)],
            "rheo": {"surface_detection": {"style": style, "limit": limit, "splash": splash}},
        },
        x_nc,
        (WIDTH, LAYERS + MARGIN),
        (0.0, -MARGIN),
        options=Options(cut=CUT),
        times=[STILL],
        timestep=STILL,
        periodic=(True, False),
    )


def _threshold(cell: MapCell) -> Start:
    limit = float(round(cell.x * ALL)) if cell.layer == "coordination" else 2 * cell.x
    return _detecting("detection", _layer("detection", LAYERS, cell.y), cell.layer, limit, 0)


def _expected_classes(cell: MapCell) -> FailureCriteria:
    """Expect surface in the outermost rows, bulk beyond the cutoff from it; the others may be either."""
    row_n = np.arange(LAYERS * WIDTH) // WIDTH
    outer_n, deep_n = np.isin(row_n, (0, LAYERS - 1)), (row_n >= DEEP) & (row_n < LAYERS - DEEP)
    return FailureCriteria(every=1, surface={int(k) + 1: int(outer_n[k]) for k in np.flatnonzero(outer_n | deep_n)})


DETECTION = StabilityMap(
    "detection",
    "Thresholds of surface/detection",
    "A layer of disordered fluid between two surfaces. A low limit takes particles of the outermost rows for bulk, a "
    "high one particles of the bulk for surface. Limits in units of what the bulk has: 27.3 neighbours within a "
    "cutoff of 3 spacings, or the divergence 2; those of coordination are rounded to whole numbers.",
    Axis("limit / value in the bulk", 0.3, 1.3, 0.02),
    Axis("disorder / spacing", 0.0, 0.45, 0.02),
    (0.05, 0.15, 0.25, 0.35, 0.45),
    _threshold,
    _expected_classes,
    ("coordination", "divergence"),
    coarse=21,  # both neighbours of the stable band have one kind: it must not fall between two places
    theory=(
        Theory("half a spacing below the surface", lambda y: neighbours(0.5), "coordination"),
        Theory("bulk", lambda y: 1.0),
    ),
    tags=("quick",),
    quick_lines=(0.05, 0.35),
)


def _flying(cell: MapCell) -> Start:
    x_nc = np.vstack([rows(0, LAYERS, WIDTH), [[WIDTH / 2, LAYERS + cell.y]]])
    return _detecting("splash", x_nc, "coordination", float(round(0.8 * ALL)), round(cell.x * ALL))


def _one_flies(cell: MapCell) -> FailureCriteria:
    expected = dict(_expected_classes(cell).surface)
    return FailureCriteria(every=1, surface={**expected, LAYERS * WIDTH + 1: 2})


SPLASH = StabilityMap(
    "splash",
    "Threshold of splash",
    "A particle flies above a layer of fluid on a lattice, and should be found as splash. A low limit/splash takes it "
    "for surface, a high one the surface for splash.",
    Axis("limit/splash / neighbours in the bulk", 0.0, 0.9, 0.02),
    Axis("height over the surface / spacing", 0.5, 3.0, 0.05),
    (1.0, 1.5, 2.0, 2.5),
    _flying,
    _one_flies,
    coarse=19,
    theory=(
        Theory("the flying one", lambda y: neighbours(-y)),
        Theory("half a spacing below the surface", lambda y: neighbours(0.5)),
    ),
)

MAPS = (SUMMED, DETECTION, SPLASH)
