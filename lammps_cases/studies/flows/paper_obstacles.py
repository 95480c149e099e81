r"""Substitutes for the paper's moving sphere and cylinder, whose decks are not public or need an inlet.

A body force drives fluid through a periodic array of obstacles at rest, at a Reynolds number far below 1, until it is
steady. The speed then is that of the drag, which the cell's force balances: Hasimoto's for spheres, the series of
`eos_ref.analytic.stokes` for cylinders.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from eos_ref.analytic import stokes
from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KernelStyle
from eos_ref.model.box import BoolArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, fluid, start, time_step
from lammps_cases.studies.flows.known import (
    Curve,
    Flow,
    FlowPanel,
    FlowQuantity,
    Published,
    ReferenceCurve,
    curve,
    line,
)
from lammps_cases.studies.flows.paper import SOURCE, disordered, lattice, points_of

NU, SOUND, MACH = 1.0, 1.0, 0.01
SETTLED = 6.0  # the start has decayed by exp(-6)


class ObstacleArray:
    """Obstacles in cells of n spacings: spheres in space or cylinders in the plane, of a radius over the cell."""

    def __init__(self, dimension: int, radius: float) -> None:
        self.dimension, self.radius = dimension, radius

    def cell(self, n: int) -> int:
        """Return the length of the cell: N is that of a cell of spheres, or the diameter of a cylinder."""
        return n if self.dimension == 3 else round(n / (2 * self.radius))

    def speed(self, n: int) -> float:
        """Return the mean velocity wanted: Mach 0.01, or Reynolds 0.1 if that is slower."""
        return min(MACH * SOUND, 0.1 * NU / (2 * self.radius * self.cell(n)))

    def drag(self) -> float:
        """Return the drag over eta U and, in space, the length of the cell."""
        if self.dimension == 2:
            return float(stokes.cylinders(self.radius).drag)
        return 6 * math.pi * self.radius * stokes.drag_of_sphere(4 / 3 * math.pi * self.radius**3)

    def gravity(self, n: int) -> float:
        """Return the acceleration whose force on a cell is the drag at the mean velocity."""
        return self.drag() * NU * self.speed(n) / self.cell(n) ** 2

    def inside(self, n: int, x_nc: FloatArray) -> BoolArray:
        """Return which particles are the obstacle's."""
        return np.asarray(np.linalg.norm(x_nc - self.cell(n) / 2, axis=1) < self.radius * self.cell(n))


SPHERES = ObstacleArray(3, 0.25)
CYLINDERS = ObstacleArray(2, 1 / 12)  # six diameters apart, as the paper's row


def _start(n: int, options: Options, of: ObstacleArray) -> Start:
    cell, d = of.cell(n), of.dimension
    x_nc = lattice(*[np.arange(cell) + 0.5] * d)
    inside_n = of.inside(n, x_nc)
    x_nc = np.mod(disordered(x_nc, f"paper-array-{d}-{n}", ~inside_n), cell)
    kind = fluid(cs=SOUND, viscosity=NU)
    return start(
        f"paper-array-{d}-{n}",
        {
            "types": [kind, {**kind, "phase": "solid"}],
            "rheo": {"interface_reconstruct": True},
            "forces": [
                {"style": "gravity", "vector": (of.gravity(n), *[0.0] * (d - 1))},
                {"style": "setforce", "vector": (0.0,) * d, "types": "2"},
            ],
        },
        x_nc,
        (float(cell),) * d,
        options=options,
        times=[SETTLED * cell**2 / (of.drag() * NU)],  # the drag over the mass of the cell is the slowest rate
        timestep=time_step(options, SOUND, NU),
        type_n=np.where(inside_n, 2, 1),
    )


def _flux(n: int, options: Options, snapshots: Sequence[Snapshot], of: ObstacleArray) -> float:
    """Return the mean velocity over the cell, over that of the drag."""
    fluid_n = _start(n, options, of).atoms.type_n == 1
    return float(snapshots[-1].v_nc[fluid_n, 0].sum() / of.cell(n) ** of.dimension / of.speed(n))


def _errors(n: int, options: Options, snapshots: Sequence[Snapshot], of: ObstacleArray) -> dict[str, float]:
    drag = {"drag": abs(1 / _flux(n, options, snapshots, of) - 1)}
    if of.dimension == 3:
        return drag
    y, u = map(np.array, _across(n, options, snapshots))
    exact = stokes.cylinders(of.radius).speed(y * 2 * of.radius)
    return drag | {"profile": float(np.abs(u / u.mean() - exact / exact.mean()).mean())}


def _across(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return u over its mean velocity against the distance from the axis in diameters, near the plane through it."""
    shot, cell = snapshots[-1], CYLINDERS.cell(n)
    begin = _start(n, options, CYLINDERS).atoms
    chosen_n = (np.abs(begin.x_nc[:, 0] - cell / 2) < 1) & (begin.x_nc[:, 1] > cell / 2)
    mean = _flux(n, options, snapshots, CYLINDERS) * CYLINDERS.speed(n)
    return curve((begin.x_nc[chosen_n, 1] - cell / 2) / n, shot.v_nc[chosen_n, 0] / mean)


def _profile_panel() -> FlowPanel:
    y = np.linspace(0, 3, 181)
    exact = stokes.cylinders(CYLINDERS.radius).speed(y * 2 * CYLINDERS.radius)
    known = points_of("cylinder_lattice_boltzmann", "y_over_D", "ux_over_u0_Re0p1")
    return FlowPanel(
        "profile",
        "distance from the axis / diameter",
        "u / mean",
        (
            line("Stokes, square array", y, exact, "eos_ref.analytic.stokes"),
            ReferenceCurve("lattice Boltzmann, a row 18 diameters long", *known, SOURCE),
        ),
        _across,
    )


def _flow(
    of: ObstacleArray, kernel: KernelStyle, name: str, title: str, resolutions: tuple[int, ...], about: Published
) -> Flow:
    return Flow(
        f"paper-{name}-{kernel.lower()}",
        "Fluid driven through a periodic array of obstacles at rest.",
        resolutions[:-1],
        "1: the obstacle is made of whole particles; its surface is known to half a spacing",
        partial(_start, of=of),
        partial(_errors, of=of),
        Options(kernel, 3.0),
        quick=resolutions[:1],
        full=resolutions[-1:],
        title=f"{title}, {kernel}",
        panels=(_profile_panel(),) if of is CYLINDERS else (),
        quantities=(FlowQuantity("mean velocity over that of the drag", partial(_flux, of=of), 1.0, "Stokes flow"),),
        findings=(FORCE_PER_VOLUME,),
        published=about,
    )


def _sphere(kernel: KernelStyle) -> Flow:
    meaning = (
        "No deck or text is public for the paper's sphere; its published errors (0.02 to 0.6, order "
        f"{'2.0' if kernel == 'RK1' else '0.8'} over all spacings) are of another set-up. Here: a simple cubic array, "
        "radius a quarter of the cell, N spacings to a cell."
    )
    about = Published("5 sphere", {}, math.nan, meaning)
    return _flow(SPHERES, kernel, "sphere", "Array of spheres", (8, 12, 16, 24), about)


OBSTACLES = (
    _sphere("RK1"),
    _sphere("quintic"),
    _flow(
        CYLINDERS,
        "RK1",
        "cylinder",
        "Array of cylinders",
        (4, 6, 8, 12),
        Published(
            "6 cylinder",
            {},
            math.nan,
            "The paper's row of cylinders has an inlet, which the released package lacks. Here: a square array, six "
            "diameters apart, at Reynolds 0.1 or below, N spacings to a diameter.",
        ),
    ),
)
