r"""Maps of the time step.

The scene of the time step is a square lattice of particles at rest density, whose velocities are noise of all
wavelengths: the shortest waves fail by viscosity, those of about five spacings by sound. Except in the map
over the Mach number, velocities are small against the speed of sound, so that the growth of the kinetic energy can be
computed (`growth`).

The scheme, linearised around the lattice. With :math:`\mathbf d` and :math:`l` the kernel's first and second
derivative for a wave :math:`\mathbf k` (of the continuum :math:`\mathbf k` and :math:`k^2`), a step takes half-step
velocity and density of a longitudinal wave by

.. math:: u' = u + \Delta t[-i\,d\,c^2\rho - (\tfrac12 d^2c^2\Delta t+\nu l)u],\qquad \rho' = \rho - i\,d\,\Delta t\,u,

because forces see densities that have taken half of the step's change. Waves decay if :math:`\nu l\Delta t<2` (viscous
limit) and :math:`d^2c^2\Delta t<2\nu l` (amplification of sound; :math:`\Delta t<2\nu/c^2` for long waves). Neither is
the criterion of Morris, Fox & Zhu (1997), :math:`\min(h/4c,h^2/8\nu)`, in whose units the step is given.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model import interactions
from eos_ref.model.box import Box
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options, Start, fluid, rows, start, time_step
from lammps_cases.studies.stability.model import Axis, FailureCriteria, StabilityMap, Theory

EDGE = 10  # spacings
STEPS, EVERY = 200, 20  # of a run, and between two observations
TENFOLD = 10.0  # growth of the kinetic energy that counts as failure
SLOW = 1e-4  # Mach number at which particles stay on their lattice
CUT = 3.0
SPEED = 1.0  # of sound
FRACTION = Axis("time step over min(h/4c, h^2/8nu)", 0.3, 12.0, 0.03, log=True)


def viscosity(ratio: float, cut: float) -> float:
    """Return the kinematic viscosity at which the acoustic limit h/4c is ``ratio`` times the viscous one, h^2/8nu."""
    return ratio * SPEED * (cut / 3) / 2


def box(fraction: float, ratio: float, cut: float, mach: float) -> Start:
    """Return the noisy lattice, run for `STEPS` steps of a length given over min(h/4c, h^2/8nu).

    Parameters
    ----------
    fraction : float
        Of the time step.
    ratio : float
        Of the two limits, see `viscosity`.
    cut : float
        Kernel's cutoff (spacings).
    mach : float
        Largest velocity along an axis over the speed of sound.
    """
    nu, options = viscosity(ratio, cut), Options(cut=cut, dt_fraction=fraction)
    x_nc = rows(0, EDGE, EDGE)
    dt = time_step(options, SPEED, nu)
    return start(
        "time-step",
        {"types": [fluid(cs=SPEED, viscosity=nu)]},
        x_nc,
        (EDGE, EDGE),
        options=options,
        times=[STEPS * dt],
        timestep=dt * (1 + 1e-9),  # so that rounding does not add a step
        v_nc=noise(x_nc.shape) * mach * SPEED,
    )


def noise(shape: tuple[int, ...]) -> FloatArray:
    """Return velocities along the axes between -1 and 1, of mean zero."""
    v_nc = np.random.default_rng(seed("stability/time-step")).uniform(-1, 1, shape)
    return np.asarray(v_nc - v_nc.mean(axis=0))


def watch(mach: float) -> FailureCriteria:
    """Watch every twenty steps for ten times the kinetic energy of the start."""
    v_nc = noise((EDGE**2, 2)) * mach * SPEED
    return FailureCriteria(every=EVERY, growth=TENFOLD, energy=0.5 * float(np.sum(np.square(v_nc))))


# --- theory


@dataclass(frozen=True)
class Waves:
    r"""All waves of the box but the mean: derivatives of the kernel on the lattice, and their shares of the noise.

    Attributes
    ----------
    d_k, l_k : (k,)
        First derivative :math:`|\mathbf d|` and second derivative :math:`l`.
    along_k, across_k : (k,)
        Shares of the noise's energy, parallel to :math:`\mathbf d` and across it.
    """

    d_k: FloatArray
    l_k: FloatArray
    along_k: FloatArray
    across_k: FloatArray


@functools.cache
def waves(cut: float) -> Waves:
    """Return the waves of the box for a kernel's cutoff; see the module."""
    x_nc = rows(0, EDGE, EDGE)
    i, j, shift_pc = directed_pairs(x_nc, Box((0.0, 0.0), (float(EDGE),) * 2, (True, True)), float(cut))
    of_first = i == 0
    x_pc = x_nc[i[of_first]] - (x_nc[j[of_first]] + shift_pc[of_first])
    rr = np.square(x_pc).sum(axis=1)
    r, h = np.sqrt(rr), cut / QUINTIC.support
    slope = QUINTIC.normalisation(2, cut) / h * np.asarray(QUINTIC.slope(r / h))
    g_pc = slope[:, None] * x_pc / r[:, None]
    number = np.fft.fftfreq(EDGE, 1 / EDGE)
    k_kc = 2 * np.pi / EDGE * np.stack(np.meshgrid(number, number, indexing="ij"), axis=-1).reshape(-1, 2)[1:]
    phase_kp = k_kc @ x_pc.T
    d_kc = -np.sin(phase_kp) @ g_pc
    drag = np.asarray(interactions.viscous_term(1.0, 1.0, 1.0, (x_pc * g_pc).sum(axis=1) / rr))
    size_k = np.sqrt(np.square(d_kc).sum(axis=1))
    unit_kc = d_kc / np.where(size_k > 0, size_k, 1.0)[:, None]
    v_kc = np.exp(-1j * k_kc @ x_nc.T) @ noise(x_nc.shape)
    energy_k, along_k = (np.abs(v_kc) ** 2).sum(axis=1), np.abs((v_kc * unit_kc).sum(axis=1)) ** 2
    total = energy_k.sum()
    return Waves(size_k, -(1 - np.cos(phase_kp)) @ drag, along_k / total, (energy_k - along_k) / total)


def step_of(fraction: float, ratio: float, cut: float) -> float:
    """Return the time step of a place on a map."""
    return time_step(Options(cut=cut, dt_fraction=fraction), SPEED, viscosity(ratio, cut))


def viscous_limit(ratio: float, cut: float) -> float:
    r"""Return the fraction at which :math:`\nu l\Delta t=2` for the wave that viscosity damps most."""
    return float(2 / (viscosity(ratio, cut) * waves(cut).l_k.max()) / step_of(1.0, ratio, cut))


def sound_limit(ratio: float, cut: float) -> float:
    r"""Return the fraction at which :math:`\Delta t=2\nu/c^2`: beyond it long waves of sound grow, however slowly."""
    return 2 * viscosity(ratio, cut) / SPEED**2 / step_of(1.0, ratio, cut)


def growth(fraction: float, ratio: float, cut: float, every: int = EVERY, looks: int = STEPS // EVERY) -> FloatArray:
    r"""Return the kinetic energy at every observation over that of the start, for small velocities.

    Whole steps begin and end halfway between half-step velocities: :math:`u_0=(1-\tfrac12\nu l\Delta t)v_0`,
    :math:`v_n=\tfrac12(u_{n-1}+u_n)`.
    """
    of = waves(cut)
    dt, nu = step_of(fraction, ratio, cut), viscosity(ratio, cut)
    s_k, q_k = of.d_k * SPEED * dt, nu * of.l_k * dt
    one = np.ones(len(s_k))
    step_kff = np.array([[1 - s_k**2 / 2 - q_k, -1j * s_k], [-1j * s_k, one]]).transpose(2, 0, 1)
    with np.errstate(all="ignore"):
        stretch_kff = np.linalg.matrix_power(step_kff, every)
        half_kf = np.linalg.matrix_power(step_kff, every - 1)[:, :, 0] * (1 - q_k / 2)[:, None]
        energies = []
        for look in range(1, looks + 1):
            along_k = 0.5 * (half_kf[:, 0] + (step_kff[:, 0] * half_kf).sum(axis=1))
            across_k = (1 - q_k / 2) ** 2 * (1 - q_k) ** (every * look - 1)
            energies.append(of.along_k @ np.abs(along_k) ** 2 + of.across_k @ across_k**2)
            half_kf = (stretch_kff @ half_kf[:, :, None])[:, :, 0]
    return np.array(energies)


@functools.cache
def growth_limit(ratio: float, cut: float) -> float:
    """Return the lowest fraction, to 1 %, at which the linearised scheme's energy is tenfold at an observation."""
    # Waves oscillate between motion and compression, so that the observed energy may fall again beyond this limit.
    fraction = min(viscous_limit(ratio, cut), sound_limit(ratio, cut))
    fraction = max(fraction, FRACTION.low)
    while fraction < FRACTION.high:
        if not (growth(fraction, ratio, cut) <= TENFOLD).all():  # NaN follows overflow
            return fraction
        fraction *= 1.01
    return math.nan


def acoustic_criterion(ratio: float, cut: float) -> float:
    """Return the fraction at which the step is h/4c."""
    return cut / 3 / (4 * SPEED) / step_of(1.0, ratio, cut)


def viscous_criterion(ratio: float, cut: float) -> float:
    """Return the fraction at which the step is h^2/8nu."""
    return (cut / 3) ** 2 / (8 * viscosity(ratio, cut)) / step_of(1.0, ratio, cut)


def _theory(ratio_and_cut: Callable[[float], tuple[float, float]]) -> tuple[Theory, ...]:
    """Return all limits as functions of a map's y."""
    return (
        Theory("h/4c", lambda y: acoustic_criterion(*ratio_and_cut(y))),
        Theory("h^2/8nu", lambda y: viscous_criterion(*ratio_and_cut(y))),
        Theory("viscous limit of the lattice", lambda y: viscous_limit(*ratio_and_cut(y))),
        Theory("sound grows, 2nu/c^2", lambda y: sound_limit(*ratio_and_cut(y))),
        Theory(f"energy tenfold in {STEPS} steps (linear)", lambda y: growth_limit(*ratio_and_cut(y))),
    )


# --- maps

_ABOUT = (
    f"A periodic square lattice of {EDGE} x {EDGE} particles with noise of all wavelengths in the velocities runs for "
    f"{STEPS} steps; it fails when its kinetic energy is {TENFOLD:g} times that of the start. One wave out of all "
    f"{EDGE**2 - 1} has to grow by about {math.log(TENFOLD * EDGE**2) / (2 * STEPS):.1%} per step for that: slower "
    "growth, as of sound in a step a little above 2nu/c^2, is not seen. "
)

MACH = StabilityMap(
    "timestep-mach",
    "Time step against Mach number",
    _ABOUT + "The acoustic and the viscous limit are equal: nu = h c/2. Theory is that of small velocities.",
    FRACTION,
    Axis("velocity over speed of sound", 1e-3, 1.0, 0.1, log=True),
    (1e-3, 0.03, 0.1, 0.3, 1.0),
    lambda cell: box(cell.x, 1.0, CUT, cell.y),
    lambda cell: watch(cell.y),
    theory=_theory(lambda y: (1.0, CUT)),
)

VISCOSITY = StabilityMap(
    "timestep-viscosity",
    "Time step against viscosity",
    _ABOUT + "Below 1 sound limits the step, above 1 viscosity.",
    FRACTION,
    Axis("h/4c over h^2/8nu (= 2nu/hc)", 0.01, 30.0, 0.1, log=True),
    (0.01, 0.1, 0.3, 1.0, 3.0, 30.0),
    lambda cell: box(cell.x, cell.y, CUT, SLOW),
    lambda cell: watch(SLOW),
    theory=_theory(lambda y: (y, CUT)),
    tags=("quick",),
    quick_lines=(0.1, 3.0),
)

KERNEL = StabilityMap(
    "timestep-kernel",
    "Time step against kernel width",
    _ABOUT + "h is a third of the cutoff. Viscosity limits the step: h/4c is three times h^2/8nu.",
    FRACTION,
    Axis("cutoff over spacing", 2.0, 4.0, 0.1),
    (2.0, 2.5, 3.0, 3.5, 4.0),
    lambda cell: box(cell.x, 3.0, cell.y, SLOW),
    lambda cell: watch(SLOW),
    theory=_theory(lambda y: (3.0, y)),
)

MAPS = (MACH, VISCOSITY, KERNEL)
