r"""Free surfaces: a standing wave that viscosity damps, and a square patch that rotates.

For a wave in deep water Lighthill has the amplitude fall at the rate :math:`2\nu k^2`, for which the surface must be
free of stress: the dissipation is :math:`2\rho\nu\int\mathbf D:\mathbf D`. The viscous force of pair rheo is that of
Morris, :math:`\nu\nabla^2\mathbf v` with :math:`\partial_n\mathbf v=0` where there are no neighbours; it dissipates
:math:`\rho\nu\int|\nabla\mathbf v|^2`, half as much in a potential flow, so that the rate is :math:`\nu k^2`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eos_ref.analytic import waves
from eos_ref.eos.table import FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import (
    Curve,
    Flow,
    FlowPanel,
    FlowQuantity,
    Options,
    Snapshot,
    Start,
    line,
    misfits,
)
from lammps_cases.studies.flows.layout import fluid, forces, rows, start, time_step

# --- standing wave; units: depth H, sqrt(g H)

REYNOLDS = 200.0  # of depth and sqrt(g H)
SLOPE = 0.05  # amplitude times wave number
K = math.pi  # wave number times depth: the wave is two depths long
SOUND = 10.0
OMEGA = math.sqrt(K * math.tanh(K))
READINGS, PERIODS = 48, 3
DAMPING = 0.1  # density diffusion over h c
TIMES = tuple(2 * math.pi / OMEGA * PERIODS * (k + 1) / READINGS for k in range(READINGS))


def _mode(x_nc: FloatArray, depth: float) -> FloatArray:
    """Return the velocities of the potential flow at the moment when the surface is flat, over their largest."""
    k = K / depth
    x_n, y_n = k * x_nc[:, 0], k * x_nc[:, 1]
    return np.stack([-np.cosh(y_n) * np.sin(x_n), np.sinh(y_n) * np.cos(x_n)], axis=1) / math.sinh(K)


def _wave(n: int, options: Options) -> Start:
    """Return the wave in n rows of fluid, over a wall."""
    layers, nu, g = math.ceil(options.cut), n / REYNOLDS, 1.0 / n
    x_nc = rows(-layers, n, 2 * n)
    wet_n = x_nc[:, 1] > 0
    speed = SLOPE / K * OMEGA
    kind = fluid(cs=SOUND, viscosity=nu)
    scene = {
        "types": [kind, {**kind, "phase": "solid"}],
        "rheo": {"interface_reconstruct": True},
        "pair": {"rho_damp": DAMPING * options.cut / 3 * SOUND},
        "forces": forces(gravity=(0.0, -g)),
    }
    return start(
        f"wave-{n}",
        scene,
        x_nc,
        (2.0 * n, 2.0 * n),
        (0.0, -layers - 1.0),
        options=options,
        times=[t * n for t in TIMES],
        timestep=time_step(options, SOUND + speed, nu),
        type_n=np.where(wet_n, 1, 2),
        v_nc=np.where(wet_n[:, None], speed * _mode(x_nc, n), 0.0),
        rho_n=1 + g * np.where(wet_n, n - x_nc[:, 1], 0.0) / SOUND**2,
        periodic=(True, False),
    )


def _amplitude(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return how much of the velocities is that of the mode, over the first one, at times in periods."""
    begin = _wave(n, options)
    wet_n = begin.atoms.type_n == 1
    mode_nc = _mode(begin.atoms.x_nc[wet_n], n)
    scale = float((mode_nc**2).sum()) * SLOPE / K * OMEGA
    values = [float((shot.v_nc[wet_n] * mode_nc).sum()) / scale for shot in snapshots]
    return tuple(shot.time / n * OMEGA / (2 * math.pi) for shot in snapshots), tuple(values)


def _oscillation(n: int, options: Options, snapshots: Sequence[Snapshot]) -> tuple[float, float]:
    """Return the rate of decay and the frequency, over those of Lighthill and of linear theory."""
    _, values = _amplitude(n, options, snapshots)
    rate, omega = waves.damped_oscillation(np.array(values), snapshots[0].time / n)
    return float(rate) / (2 * K**2 / REYNOLDS), float(omega) / OMEGA


_T = np.linspace(0, PERIODS, 301)


def _damped(rate: float) -> FloatArray:
    """Return the oscillation that decays at a rate."""
    t = _T * 2 * math.pi / OMEGA
    return np.asarray(np.cos(OMEGA * t) * np.exp(-rate * t))


MODE = FlowPanel(
    "velocity",
    "t / period",
    "velocity of the wave / its first",
    (
        line("Lighthill, 2 ν k²", _T, _damped(2 * K**2 / REYNOLDS), "Lighthill, Waves in Fluids (1978); deep water"),
        line("Morris' force, ν k²", _T, _damped(K**2 / REYNOLDS), "the dissipation of Morris' viscous force"),
    ),
    _amplitude,
)
WAVE = Flow(
    "standing-wave",
    f"A standing wave two depths long, slope {SLOPE:g}, Re = {REYNOLDS:g}, over a wall without slip (which adds "
    "less than 1 % to the decay). Morris' form of the viscous force, which pair rheo documents, leaves a free "
    "surface with another condition than no stress and dissipates half as much there as Lighthill's theory has it "
    "(Colagrossi et al., Phys. Rev. E 84, 026705, 2011): its own rate is drawn beside.",
    MODE.known[0].source,
    (12, 16, 24),
    "none: the decay goes to that of Morris' force, half of Lighthill's, as the spacing falls",
    _wave,
    misfits((MODE,)),
    quick=(8,),
    title="Standing wave",
    panels=(MODE,),
    quantities=(
        FlowQuantity("rate of decay over 2 nu k^2", lambda *of: _oscillation(*of)[0], 1.0, "Lighthill"),
        FlowQuantity(
            "frequency over that of linear theory",
            lambda *of: _oscillation(*of)[1],
            1.0,
            "linear theory",
            "no oscillation to fit",
        ),
    ),
    findings=(FORCE_PER_VOLUME,),
)

VALIDATIONS = (WAVE,)
