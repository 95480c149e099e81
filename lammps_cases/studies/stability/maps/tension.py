r"""Fluids without walls: tensile instability, by which particles form pairs; two adjacent fluids.

A uniform pressure P in :math:`\mathbf F_i=-\sum_jV_iV_j(P_i+P_j)\nabla W_{ij}` acts on a displacement
:math:`\mathbf u\,e^{i\mathbf k\cdot\mathbf x}` of a lattice as on springs of stiffness proportional to P,

.. math:: \ddot{\mathbf u}=-\frac{2PV}{\rho}\sum_j[1-\cos(\mathbf k\cdot\mathbf x_{ij})]\,\nabla\nabla W_{ij}\,\mathbf u
          -c^2\mathbf g\,(\mathbf g\cdot\mathbf u)-\Gamma\dot{\mathbf u},\qquad
          \mathbf g=V\sum_j\sin(\mathbf k\cdot\mathbf x_{ij})\nabla W_{ij},\qquad
          \Gamma=-2\nu V\sum_j[1-\cos(\mathbf k\cdot\mathbf x_{ij})]\frac{W'}{r}

Sound (g) does not see the shortest waves, so the sign of P W'' at the nearest neighbours decides: P W'' < 0 is unstable
(Swegle, Hicks & Attaway, J. Comput. Phys. 116, 123 (1995)). The quintic has W'' > 0 there at a cutoff of 3 spacings;
with more neighbours the whole sum counts.

Particles lie on a triangular lattice, which pressure leaves as it is, one per unit of area; m = rho, so that volumes
are 1 until particles move, and that LAMMPS' forces lack the volume does not hide all else.

Of two fluids, a summed density mixes both across the interface: :math:`\sum_jm_jW_{ij}` is about the mean of the two,
so that the heavy fluid is under the tension :math:`c^2(\rho_h-\rho_l)/2` and the light one under a similar pressure.
With self/mass the density is :math:`m_i\sum_jW_{ij}`, which is right on both sides; LAMMPS lacks the keyword,
so its side ends in an error. By continuity the densities stay right and the time step fails: a light particle
among heavy ones has the kinematic viscosity :math:`\nu(1+r)/2` by arithmetic means, r the density ratio.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.optimize import bisect

from eos_ref.eos.table import FloatArray
from eos_ref.kernels.quintic import QUINTIC
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options, Start, fluid, rows, start, time_step, under
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

WIDTH, HEIGHT = 10, 10  # particles along x and rows; the height is even, as every second row is shifted
EDGE = math.sqrt(2 / math.sqrt(3))  # of triangles that have a particle per unit of area
DISORDER = 0.05  # largest displacement along an axis (spacings)
NU = 0.1  # kinematic viscosity: waves of sound grow with the time step unless dt < 2 nu/c^2
DT, STEPS = 0.1, 400
CLOSEST = 0.5  # spacings: half of the distance to the next particle


def triangles(width: int, height: int) -> tuple[FloatArray, tuple[float, float]]:
    """Return a triangular lattice, a particle per unit of area (n, 2), and its periodic edges; ``height`` is even."""
    x_nc = rows(0, height, width)
    x_nc[:, 0] += np.where(np.floor(x_nc[:, 1]) % 2, 0.25, -0.25)
    scale_c = np.array([EDGE, EDGE * math.sqrt(3) / 2])
    edges = scale_c * np.array([width, height])
    return x_nc * scale_c, (float(edges[0]), float(edges[1]))


def _fluid(name: str, background: float, density: float, cut: float, shift: bool) -> Start:
    x_nc, edges = triangles(WIDTH, HEIGHT)
    x_nc += np.random.default_rng(seed(name)).uniform(-DISORDER, DISORDER, x_nc.shape)
    scene = {
        "types": [fluid(mass=density, viscosity=NU * density)],
        "pressure": under(background),
        "rheo": {"shift": shift},
    }
    return start(
        name,
        scene,
        np.mod(x_nc, edges),
        edges,
        options=Options(cut=cut),
        times=[STEPS * DT],
        timestep=DT,
        rho_n=np.full(len(x_nc), density),
    )


def _watch(cell: MapCell) -> FailureCriteria:
    return FailureCriteria(every=20, closest=CLOSEST)


# --- theory


@cache
def waves(cut: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return lattice sums for the wave vectors k that fit in the box: the stiffness (k, 2, 2), g (k, 2), Gamma/nu."""
    x_nc, (lx, ly) = triangles(WIDTH, HEIGHT)
    around = range(-math.ceil(cut / ly), math.ceil(cut / ly) + 1)
    x_pc = np.concatenate([x_nc + np.array([a * lx, b * ly]) for a in around for b in around]) - x_nc[0]
    r_p = np.hypot(*x_pc.T)
    near = (r_p > 0) & (r_p < cut)
    x_pc, r_p = x_pc[near], r_p[near]
    h, norm = cut / QUINTIC.support, QUINTIC.normalisation(2, cut)
    over_r_p = norm / h * QUINTIC.slope(r_p / h) / r_p  # W'/r
    step = 1e-4 * h
    slopes = [QUINTIC.slope((r_p + side) / h) for side in (-step, step)]
    bend_p = norm / h * (slopes[1] - slopes[0]) / (2 * step)  # W''
    n_pc = x_pc / r_p[:, None]
    hessian_p = (bend_p - over_r_p)[:, None, None] * n_pc[:, :, None] * n_pc[:, None, :]
    hessian_p += over_r_p[:, None, None] * np.eye(2)
    k_kc = 2 * np.pi * np.array([(p / lx, q / ly) for p in range(WIDTH) for q in range(HEIGHT)][1:])
    phase_kp = k_kc @ x_pc.T
    still_kp = 1 - np.cos(phase_kp)
    g_kc = np.sin(phase_kp) @ (over_r_p[:, None] * x_pc)
    return np.einsum("kp,pab->kab", still_kp, hessian_p), g_kc, -2 * still_kp @ over_r_p


def growth_rate(background: float, density: float, cut: float) -> float:
    r"""Return the largest s of :math:`s^2+\Gamma s+\omega^2=0` over all waves of the box (1/time); 0 if none grows."""
    stiffness_kab, g_kc, damping_k = waves(cut)
    pressure = density - 1 + background
    matrix_kab = 2 * pressure / density * stiffness_kab + g_kc[:, :, None] * g_kc[:, None, :]
    lowest_k = np.linalg.eigvalsh(matrix_kab)[:, 0]
    half_k = NU * damping_k / 2
    return max(0.0, float(np.max(-half_k + np.sqrt(np.maximum(half_k**2 - lowest_k, 0.0)))))


def clumps_below(density: float, cut: float) -> float:
    """Return the background below which the fastest wave grows from the disorder to half-way to clumping in a run."""
    wanted = math.log((1 - CLOSEST) / 2 / DISORDER) / (STEPS * DT)
    no_pressure = 1.0 - density  # where nothing grows
    return float(bisect(lambda p: growth_rate(p, density, cut) - wanted, -10.0, no_pressure, xtol=1e-11))


TENSION = StabilityMap(
    "tension",
    "Tensile instability: background pressure and density",
    "A periodic fluid at rest, slightly disordered, all under the pressure c^2 (rho - rho0) + P_b. Under tension "
    "particles clump. Shift drives them apart and the boundary moves to stronger tension; it also raises the "
    "mean density, and with it the pressure, until the tension is gone.",
    Axis("background pressure / rho0 c^2", -0.8, 0.4, 0.02),
    Axis("density / rho0", 0.8, 1.2, 0.02),
    (0.8, 1.0, 1.2),
    lambda cell: _fluid("tension", cell.x, cell.y, 3.0, cell.layer == "shift"),
    _watch,
    ("", "shift"),
    coarse=7,
    theory=(
        Theory("P W'' = 0", lambda density: 1 - density),
        Theory("fastest wave of the lattice", lambda density: clumps_below(density, 3.0), ""),
    ),
    tags=("quick",),
    quick_lines=(1.0,),
)
WIDE = StabilityMap(
    "tension-width",
    "Tensile and pairing instability: width of the kernel",
    "As the map tension, at the density rho0, for other cutoffs. At 6 spacings the nearest neighbours lie where "
    "W'' < 0, and yet tension makes particles clump, not pressure: sums over the lattice decide, and those of the "
    "quintic are positive to within 1 % of the largest. So pairing does not show at positive pressure.",
    Axis("background pressure / rho0 c^2", -0.8, 0.8, 0.02),
    Axis("cutoff / spacing", 2.4, 6.0, 0.1),
    (2.4, 4.0, 6.0),
    lambda cell: _fluid("pairing", cell.x, 1.0, cell.y, shift=False),
    _watch,
    coarse=5,
    theory=(Theory("fastest wave of the lattice", lambda cut: clumps_below(1.0, cut)),),
)

MAPS = (TENSION, WIDE)


SIZE = 12  # edge of the periodic box; the slab of the heavy fluid takes half of it
PHASES_DISORDER = 0.1  # spacings
BACKGROUND = 0.05  # pressure that both fluids are under, over rho0 c^2 of the heavy one
PHASES_NU = 0.1  # kinematic viscosity of both, over the faster speed of sound times the spacing
TIME = 20.0


def _time_step(sound: float) -> float:
    """Return the longest time step of the fluids alone; sound grows with the time step unless dt < 2 nu/c^2."""
    return min(time_step(Options(), sound, PHASES_NU * sound), 2 * PHASES_NU / sound)


def _slabs(cell: MapCell) -> Start:
    x_nc, faster = rows(0, SIZE, SIZE), max(1.0, cell.y)
    heavy_n = np.abs(x_nc[:, 0] - SIZE / 2) < SIZE / 4
    x_nc += PHASES_DISORDER * np.random.default_rng(seed("phases")).uniform(-1, 1, x_nc.shape)
    kinds = [
        fluid(mass=rho0, rho0=rho0, cs=cs, viscosity=rho0 * PHASES_NU * faster)
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
    return 2 * 0.125 / (PHASES_NU * faster * _time_step(faster)) - 1


def tension_limit(sound: float) -> float:
    r"""Return the density ratio from which the tension :math:`c^2(\rho_h-\rho_l)/2` exceeds the background."""
    return 1 / (1 - 2 * BACKGROUND)


PHASES_MAPS = (
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
            Theory("tension over background", tension_limit, "rho/sum"),
        ),
    ),
)
