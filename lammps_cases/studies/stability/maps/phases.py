r"""Two fluids side by side: how far apart their densities and speeds of sound may lie.

A summed density mixes both across the interface: :math:`\sum_jm_jW_{ij}` is about the mean of the two, so that the
heavy fluid comes under the tension :math:`c^2(\rho_h-\rho_l)/2` and the light one under a pressure like it. With
self/mass the density is :math:`m_i\sum_jW_{ij}`, which is right on both sides; LAMMPS does not have the keyword,
so its side ends in an error.

By continuity the densities stay right and the time step is what fails: a light particle among heavy ones has the
kinematic viscosity :math:`\nu(1+r)/2` by arithmetic means, r the density ratio.
"""

from __future__ import annotations

import numpy as np

from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.layout import fluid, rows, start, time_step, under
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

SIZE = 12  # edge of the periodic box; the slab of the heavy fluid takes half of it
DISORDER = 0.1  # spacings
BACKGROUND = 0.05  # pressure that both fluids are under, over rho0 c^2 of the heavy one
NU = 0.1  # kinematic viscosity of both, over the faster speed of sound times the spacing
TIME = 20.0


def _time_step(sound: float) -> float:
    """Return the longest time step of the fluids alone; sound grows with the time step unless dt < 2 nu/c^2."""
    return min(time_step(Options(), sound, NU * sound), 2 * NU / sound)


def _slabs(cell: MapCell) -> Start:
    x_nc, faster = rows(0, SIZE, SIZE), max(1.0, cell.y)
    heavy_n = np.abs(x_nc[:, 0] - SIZE / 2) < SIZE / 4
    x_nc += DISORDER * np.random.default_rng(seed("phases")).uniform(-1, 1, x_nc.shape)
    kinds = [
        fluid(mass=rho0, rho0=rho0, cs=cs, viscosity=rho0 * NU * faster)
        for rho0, cs in ((1.0, 1.0), (1 / cell.x, cell.y))
    ]
    return start(
        "phases",
        {
            "types": kinds,
            "pressure": under(BACKGROUND),
            "rheo": {"self_mass": cell.layer == "rho/sum self/mass"},
            "pair": {"harmonic_means": cell.layer == "harmonic/means"},
        },
        np.mod(x_nc, SIZE),
        (SIZE, SIZE),
        options=Options(rho_sum=cell.layer.startswith("rho/sum")),
        times=[TIME],
        timestep=_time_step(faster),
        type_n=np.where(heavy_n, 1, 2),
    )


def viscous_limit(sound: float) -> float:
    r"""Return the density ratio at which :math:`\Delta t=h^2/8\nu` for a light particle among heavy ones; h: spacing.

    Source: Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997), for the limit.
    """
    faster = max(1.0, sound)
    return 2 * 0.125 / (NU * faster * _time_step(faster)) - 1


def tension(sound: float) -> float:
    r"""Return the density ratio from which the tension :math:`c^2(\rho_h-\rho_l)/2` exceeds the background."""
    return 1 / (1 - 2 * BACKGROUND)


MAPS = (
    StabilityMap(
        "phases",
        "Two fluids: ratios of density and speed of sound",
        "Slabs of a heavy and of a light fluid at rest under the same background pressure, slightly disordered; m = "
        "rho0 for both, so that volumes are 1. Densities by continuity, with "
        "arithmetic means of the viscosity or harmonic ones, or summed. By continuity the boundary lies far beyond "
        "the viscous limit of a light particle among heavy ones, and moves up as the time step goes down.",
        Axis("density ratio", 1.0, 1000.0, 0.08, log=True),
        Axis("speed of sound of the light fluid / of the heavy one", 0.5, 2.0, 0.1),
        (0.5, 1.0, 2.0),
        _slabs,
        lambda cell: FailureCriteria(every=10, closest=0.5),
        ("continuity", "harmonic/means", "rho/sum", "rho/sum self/mass"),
        theory=(
            Theory("viscous limit", viscous_limit, "continuity"),
            Theory("tension over background", tension, "rho/sum"),
        ),
    ),
)
