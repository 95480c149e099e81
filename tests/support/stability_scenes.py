"""Initial states shared by the tests of the atlas."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.studies.flows.flow import Options, Start, rows, start
from lammps_cases.studies.stability.maps import timestep
from lammps_cases.studies.stability.model import Axis, MapCell, StabilityMap

WIDTH, HEIGHT = 8, 9
CUBIC = [{"types": "*", "style": "cubic", "A3": -1.0}, {"types": "*", "style": "background", "P_b": 0.5}]


def channel(steps: int = 0, mass: float = 1.0, **scene: Any) -> Start:
    """Fluid over a wall of type 2 two rows thick, in a box that is periodic along x alone; a cubic law."""
    x_nc = rows(0, HEIGHT, WIDTH)
    random = np.random.default_rng(5)
    x_nc = x_nc + random.uniform(-0.05, 0.05, x_nc.shape)
    type_n = np.where(x_nc[:, 1] < 2, 2, 1)
    types = [{"mass": mass, "rho0": 1.0, "cs": 1.0}, {"mass": mass, "rho0": 1.0, "cs": 1.0, "phase": "solid"}]
    made = start(
        "channel",
        {
            "types": types,
            "pressure": CUBIC,
            "rheo": {"surface_detection": {"style": "coordination", "limit": 18, "splash": 5}},
            "compare": ("x", "v", "rho", "pressure", "surface"),
            **scene,
        },
        x_nc,
        (WIDTH, HEIGHT + 4),
        (0, -1),
        options=Options(kernel="RK2", zmin=4),
        times=[max(steps, 1) * 0.01],
        timestep=0.01,
        type_n=type_n,
        periodic=(True, False),
    )
    return made if steps else replace(made, steps=(0,))


def resting(steps: int, mass: float = 1.0, high: float = 8.0) -> Start:
    """Particles on a lattice, at rest without pressure: the state never changes."""
    return start(
        "rest",
        {"types": [{"mass": mass, "rho0": mass, "cs": 1.0}], "pressure": [{"types": "*", "style": "linear"}]},
        rows(0, 8, 8),
        (8.0, high),
        options=Options(),
        times=[steps * 0.01],
        timestep=0.01,
    )


def unstable(mach: float = 1e-3) -> Start:
    """A box whose time step is somewhat too long."""
    return timestep.box(5.2, 1.0, 3.0, mach)


def viscous(factor: float) -> StabilityMap:
    """The map of the time step with one line and a viscosity that is wrong by a factor."""

    def of(cell: MapCell) -> Start:
        made = timestep.box(cell.x, cell.y, 3.0, 1e-4)
        scene = made.case.scene
        types = tuple(t.model_copy(update={"viscosity": float(str(t.viscosity)) * factor}) for t in scene.types)
        return replace(made, case=replace(made.case, scene=scene.model_copy(update={"types": types})))

    return replace(timestep.VISCOSITY, id="one", lines=(1.0,), start=of, x=Axis("step", 1.0, 10.0, 0.05, log=True))


def brute_moments(x_nc: FloatArray, box: tuple[FloatArray, FloatArray], cut: float, k: int) -> FloatArray:
    """Moment matrix of RK2 of particle k in the plane, periodic along x, for volumes of 1: a direct sum over images."""
    total = np.zeros((6, 6))
    for j in range(len(x_nc)):
        for image in (-1, 0, 1):
            dx, dy = x_nc[k] - x_nc[j] - [image * (box[1][0] - box[0][0]), 0.0]
            r = float(np.hypot(dx, dy))
            if (j == k and image == 0) or r >= cut:
                continue
            q, (a, b) = 3 * r / cut, (dx / cut, dy / cut)
            shape = sum(c * max(s - q, 0.0) ** 5 for c, s in ((1, 3), (-6, 2), (15, 1)))
            h = np.array([1, a, b, a * a / 2, b * b / 2, a * b])
            total += 7 / (478 * np.pi * (cut / 3) ** 2) * shape * np.outer(h, h)
    return total
