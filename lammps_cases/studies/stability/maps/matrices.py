r"""Moment matrices of the reproducing kernels: where they have no factor, or are ill-conditioned.

The matrix of a particle is :math:`\mathbf M_i=\sum_jV_jW_{ij}\mathbf H\mathbf H^T` over its neighbours, without itself:
it has at most as many independent rows as there are neighbours, 1, 3 and 6 of which RK0, RK1 and RK2 need in two
dimensions. Layers named after a kernel ask for the matrix (its condition number) at the positions given; those with
``run`` show what happens to an engine that uses it, over some steps.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.kernels import reproducing
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.kernels.styles import KERNELS, KernelStyle
from lammps_cases.findings.kernels import STALE_GRADIENT_BELOW_ZMIN
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.layout import fluid, rows, start, time_step
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

CONDITION = 1e12  # leaves four digits of a double's sixteen
CS, NU = 10.0, 0.5
EDGE, MARGIN = 7, 4.0  # spacings
STEPS, EVERY = 20, 5
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
    options = Options(cast(KernelStyle, cell.layer.split()[0]), cut, zmin=zmin)
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
    layers=("RK0", "RK1", "RK2"),
    theory=(
        Theory("neighbours along the axes (lattice)", lambda y: 1.0, "RK0"),
        Theory("neighbours along the axes (lattice)", lambda y: 1.0, "RK1"),
        Theory("neighbours along the diagonals (lattice)", lambda y: math.sqrt(2), "RK2"),
    ),
    quick_lines=(0.0,),
    tags=("quick",),
)


def neighbours(cut: float) -> tuple[int, int, int]:
    """Return how many neighbours a corner, an edge and the bulk of a square lattice have within a cutoff."""
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
    f"neighbours LAMMPS uses uninitialised memory (finding {STALE_GRADIENT_BELOW_ZMIN.id}): what becomes of a run "
    "there depends on what its process did before.",
    x=Axis("zmin", 0.0, 12.0, 0.5),
    y=Axis("cut/spacing", 1.05, 3.0, 0.1),
    lines=(1.2, 1.6, 2.1, 3.0),
    start=lambda cell: _start(cell, square(0.0, cell.map), cell.y, math.floor(cell.x)),
    watch=_watch,
    layers=("RK1", "RK2", "RK1 run", "RK2 run"),
    theory=(
        Theory("fewest neighbours", lambda y: zmin_needed("RK1", y), "RK1"),
        Theory("fewest neighbours", lambda y: zmin_needed("RK2", y), "RK2"),
    ),
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
    layers=("RK1", "RK2", "RK1 run", "RK2 run"),
    theory=(
        Theory("corner: 3 neighbours (lattice)", lambda y: math.sqrt(2), "RK1"),
        Theory("corner: 6 neighbours (lattice)", lambda y: math.sqrt(5), "RK2"),
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
