r"""Too few neighbours: moment matrices of the reproducing kernels, and free surfaces.

The matrix of a particle is :math:`\mathbf M_i=\sum_jV_jW_{ij}\mathbf H\mathbf H^T` over its neighbours, without itself:
it has at most as many independent rows as neighbours; RK0, RK1 and RK2 need 1, 3 and 6 of these in two
dimensions. Layers named after a kernel evaluate the matrix (its condition number) at the given positions; those with
``run`` show how an engine that uses it behaves over some steps.

A density summed over neighbours falls towards a free surface, so that the law gives a tension,
:math:`P=c^2(\rho-\rho_0)<0`: the surface is drawn in and particles clump there. Densities by continuity avoid this.

Detection counts neighbours or takes the divergence of position. Seen as a continuum, with a particle per unit of area
and f the share of the circle of the cutoff that lies in the fluid, a particle has :math:`\pi r_c^2f-1` neighbours.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.kernels import reproducing
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.kernels.styles import KERNELS, KernelStyle
from lammps_cases.findings.kernels import STALE_GRADIENT_BELOW_ZMIN
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options, Start, fluid, rows, start, time_step
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

CONDITION = 1e12  # leaves four digits of a double's sixteen
CS, NU = 10.0, 0.5
EDGE, MARGIN = 7, 4.0  # spacings
STEPS, EVERY = 20, 5
CORRECTING = {style: kernel for style, kernel in KERNELS.items() if kernel.corrects_gradients}
_FLUID: dict[str, Any] = {"types": [fluid(cs=CS, viscosity=NU)]}


def _start(
    cell: MapCell,
    x_nc: FloatArray,
    cut: float,
    zmin: int = 0,
    high_c: tuple[float, float] = (EDGE, EDGE),
    periodic: tuple[bool, bool] = (False, False),
) -> Start:
    """Return particles of unit volume with small random velocities, in a box with empty space beyond its open faces."""
    options = Options(cell.layer.split()[0], cut, zmin=zmin)
    low_c = tuple(0.0 if around else -MARGIN for around in periodic)
    dt = 0.1 * time_step(options, CS, NU)
    v_nc = np.random.default_rng(seed(f"{cell.map}/velocity")).uniform(-0.1, 0.1, x_nc.shape)
    ends = tuple(high if around else high + MARGIN for high, around in zip(high_c, periodic, strict=True))
    moving = start(
        f"{cell.map}-{cell.layer.replace(' ', '-').lower()}",
        _FLUID,
        x_nc,
        ends,
        low_c,
        options=options,
        times=(STEPS * dt,),
        timestep=dt,
        v_nc=v_nc,
        periodic=periodic,
    )
    return moving if cell.layer.endswith("run") else replace(moving, steps=(0,))


def _watch(cell: MapCell) -> FailureCriteria:
    if cell.layer.endswith("run"):
        return FailureCriteria(every=EVERY, growth=100.0)
    return FailureCriteria(every=EVERY, condition=CONDITION)


def square(disorder: float, name: str) -> FloatArray:
    """Return a square of particles, each moved by up to a fraction of the spacing along an axis."""
    x_nc = rows(0, EDGE, EDGE)
    return np.asarray(x_nc + disorder * np.random.default_rng(seed(f"{name}/positions")).uniform(-1, 1, x_nc.shape))


LATTICE = StabilityMap(
    id="matrices-coordination",
    title="Moment matrices: neighbours within the cutoff",
    about="A periodic square lattice in disorder under a shorter and shorter kernel: matrices of too few neighbours.",
    x=Axis("cut/spacing", 0.8, 3.0, 0.02),
    y=Axis("disorder", 0.0, 0.45, 0.05),
    lines=(0.0, 0.15, 0.3),
    start=lambda cell: _start(cell, np.mod(square(cell.y, cell.map), EDGE), cell.x, periodic=(True, True)),
    watch=_watch,
    layers=tuple(style for style, kernel in KERNELS.items() if kernel.order >= 0),
    theory=tuple(
        Theory("neighbours along the axes (lattice)", lambda y: 1.0, style)
        if kernel.order < 2
        else Theory("neighbours along the diagonals (lattice)", lambda y: math.sqrt(2), style)
        for style, kernel in KERNELS.items()
        if kernel.order >= 0
    ),
    quick_lines=(0.0,),
    tags=("quick",),
)


def neighbours(cut: float) -> tuple[int, int, int]:
    """Return the numbers of neighbours of a corner, an edge and the bulk of a square lattice within a cutoff."""
    reach = range(-math.ceil(cut), math.ceil(cut) + 1)
    near = [(a, b) for a in reach for b in reach if 0 < a * a + b * b < cut * cut]
    corner, edge = (sum(a >= 0 and b >= 0 for a, b in near), sum(b >= 0 for _, b in near))
    return corner, edge, len(near)


def zmin_needed(kernel: KernelStyle, cut: float) -> float:
    """Return the least zmin that excludes every particle with fewer neighbours than the kernel has functions."""
    size = reproducing.basis_size(max(KERNELS[kernel].order, 0), 2)
    return max((float(n + 1) for n in neighbours(cut) if n < size), default=0.0)


ZMIN = StabilityMap(
    id="matrices-zmin",
    title="Moment matrices at free surfaces: zmin",
    about="A square of particles with corners and edges, without disorder. x: zmin, rounded down. Below zmin "
    f"neighbours LAMMPS uses uninitialised memory (finding {STALE_GRADIENT_BELOW_ZMIN.id}): the fate of a run "
    "there depends on what its process did before.",
    x=Axis("zmin", 0.0, 12.0, 0.5),
    y=Axis("cut/spacing", 1.05, 3.0, 0.1),
    lines=(1.2, 1.6, 2.1, 3.0),
    start=lambda cell: _start(cell, square(0.0, cell.map), cell.y, math.floor(cell.x)),
    watch=_watch,
    layers=(*CORRECTING, *(f"{style} run" for style in CORRECTING)),
    theory=tuple(Theory("fewest neighbours", partial(zmin_needed, style), style) for style in CORRECTING),
    quick_lines=(1.6,),
    tags=("quick",),
)


SURFACE = StabilityMap(
    id="matrices-surface",
    title="Moment matrices at free surfaces: cutoff and disorder",
    about="A square of particles with corners and edges, and zmin 0: what the corners need of the cutoff. Particles "
    "whose matrix has no factor, and their neighbours, get other gradients from LAMMPS than from the reference, which "
    "falls back on the quintic spline.",
    x=Axis("cut/spacing", 0.8, 3.6, 0.02),
    y=Axis("disorder", 0.0, 0.45, 0.05),
    lines=(0.0, 0.1, 0.3),
    start=lambda cell: _start(cell, square(cell.y, cell.map), cell.x),
    watch=_watch,
    layers=(*CORRECTING, *(f"{style} run" for style in CORRECTING)),
    theory=tuple(
        Theory("corner: 3 neighbours (lattice)", lambda y: math.sqrt(2), style)
        if kernel.order == 1
        else Theory("corner: 6 neighbours (lattice)", lambda y: math.sqrt(5), style)
        for style, kernel in CORRECTING.items()
    ),
)


def _row(cell: MapCell) -> Start:
    """Return a periodic row, every second particle off the line."""
    n = 2 * EDGE
    x_nc = np.stack([np.arange(n) + 0.5, 2.0 + cell.x * (np.arange(n) % 2)], axis=1)
    return _start(cell, x_nc, cell.y, high_c=(n, 4.0), periodic=(True, False))


def _zigzag(cut: float) -> float:
    r"""Return the offset of every second particle at which the matrix of RK1 has the condition number `CONDITION`.

    With :math:`u` the offset over the cutoff and :math:`W_o`, :math:`W_e` the sums of the kernel over odd and even
    neighbours, the eigenvalues for :math:`u\to0` are those of the row itself and
    :math:`u^2W_oW_e/(W_o+W_e)`, the largest :math:`W_o+W_e`, or the moment along the row if that is larger.
    """
    q = {k: QUINTIC.shape(QUINTIC.support * k / cut) for k in range(1, math.ceil(cut))}
    odd, even = (2 * sum(float(w) for k, w in q.items() if k % 2 == rest) for rest in (1, 0))
    along = 2 * sum(float(w) * (k / cut) ** 2 for k, w in q.items())
    if not even:
        return math.nan
    return cut * math.sqrt(max(odd + even, along) / CONDITION * (odd + even) / (odd * even))


ROW = StabilityMap(
    id="matrices-row",
    title="Moment matrices of neighbours in a row",
    about="A row of particles, every second one off the line: a direction about which no neighbour gives information.",
    x=Axis("offset/spacing", 1e-12, 1.0, 0.1, log=True),
    y=Axis("cut/spacing", 2.05, 3.0, 0.1),
    lines=(2.1, 2.5, 3.0),
    start=_row,
    watch=_watch,
    layers=("RK1", "RK1 run"),
    theory=(Theory(f"condition {CONDITION:g}", _zigzag, "RK1"),),
)

MAPS = (LATTICE, ZMIN, SURFACE, ROW)


WIDTH = 8  # of a layer of fluid, periodic
EMPTY = 5.0  # empty space above and below
SURFACE_NU = 0.2  # kinematic viscosity

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
        {"types": [fluid(cs=cs, viscosity=SURFACE_NU)]},
        _layer("summed-surface", ROWS, 0.05),
        (WIDTH, ROWS + EMPTY),
        (0.0, -EMPTY),
        options=options,
        times=[TIME],
        timestep=min(time_step(options, cs, SURFACE_NU), 2 * SURFACE_NU / cs**2),
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
STILL = 0.01  # a time step, in which nothing moves


def share(height: float) -> float:
    """Return the share of the cutoff's circle below a plane ``height`` above (or, negative, below) its centre."""
    u = min(max(height / CUT, -1.0), 1.0)
    return 0.5 + (u * math.sqrt(1 - u * u) + math.asin(u)) / math.pi


def share_of_bulk(depth: float) -> float:
    """Return the neighbours of a particle ``depth`` below the surface (above, if negative) over those in the bulk."""
    own = 1 if depth >= 0 else 0  # a particle flying above is not part of the fluid
    return (math.pi * CUT**2 * share(depth) - own) / ALL


def _detecting(name: str, x_nc: FloatArray, style: str, limit: float, splash: int) -> Start:
    return start(
        name,
        {
            "types": [fluid(viscosity=SURFACE_NU)],
            "rheo": {"surface_detection": {"style": style, "limit": limit, "splash": splash}},
        },
        x_nc,
        (WIDTH, LAYERS + EMPTY),
        (0.0, -EMPTY),
        options=Options(cut=CUT),
        times=[STILL],
        timestep=STILL,
        periodic=(True, False),
    )


def _threshold(cell: MapCell) -> Start:
    limit = float(round(cell.x * ALL)) if cell.layer == "coordination" else 2 * cell.x
    return _detecting("detection", _layer("detection", LAYERS, cell.y), cell.layer, limit, 0)


def _expected_classes(cell: MapCell) -> FailureCriteria:
    """Expect surface in the outermost rows, bulk beyond the cutoff from it; others may be either."""
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
        Theory("half a spacing below the surface", lambda y: share_of_bulk(0.5), "coordination"),
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
        Theory("the flying one", lambda y: share_of_bulk(-y)),
        Theory("half a spacing below the surface", lambda y: share_of_bulk(0.5)),
    ),
)

SURFACE_MAPS = (SUMMED, DETECTION, SPLASH)
