r"""Free surfaces under gravity: a standing wave damped by viscosity, and a column that collapses between walls.

For a wave in deep water Lighthill has the amplitude fall at the rate :math:`2\nu k^2`, for which the surface must be
free of stress: the dissipation is :math:`2\rho\nu\int\mathbf D:\mathbf D`. The viscous force of pair rheo is that of
Morris, :math:`\nu\nabla^2\mathbf v` with :math:`\partial_n\mathbf v=0` where there are no neighbours; it dissipates
:math:`\rho\nu\int|\nabla\mathbf v|^2`, half as much in a potential flow, so that the rate is :math:`\nu k^2`.

The column is that of the experiments of Martin & Moyce (1952). Its speeds are in units of :math:`\sqrt{gH}`, H the
height of the column; the fastest fluid has speed 2, sound 20.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial

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
    fluid,
    forces,
    line,
    misfits,
    rows,
    smooth,
    start,
    table,
    time_step,
)

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
    """Return the velocities of the potential flow when the surface is flat, over their largest."""
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
    """Return the amplitude of the mode in the velocities, over its initial value, at times in periods."""
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
    "(Colagrossi et al., Phys. Rev. E 84, 026705, 2011): its own rate is drawn as well.",
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


FASTEST, DAM_SOUND = 2.0, 20.0  # over sqrt(g H)
VISCOSITY = 1e-3  # over H sqrt(g H): walls drag, but the fluid far from them hardly
ARTIFICIAL, DAM_DAMPING = (
    0.1,
    0.1,
)  # artificial viscosity; density diffusion over h c: twice that loses drops


class Tank:
    """A tank and the column at its left end, in units of the height of the column; the times at which it is read."""

    def __init__(self, width: float, length: float, height: float, times: Iterable[float]) -> None:
        self.width, self.length, self.height, self.times = width, length, height, tuple(times)


def _start(n: int, options: Options, tank: Tank) -> Start:
    """Return the column, n spacings high, in hydrostatic equilibrium with a removed wall."""
    layers, g = math.ceil(options.cut), 1.0 / n
    length, top = round(tank.length * n), round(tank.height * n)
    x_nc = rows(-layers, top, length + 2 * layers) - np.array([layers, 0.0])
    x_n, y_n = x_nc.T
    open_n = (x_n > 0) & (x_n < length) & (y_n > 0)
    wet_n = open_n & (x_n < round(tank.width * n)) & (y_n < n)
    kept_n = ~open_n | wet_n
    x_nc, wet_n = x_nc[kept_n], wet_n[kept_n]
    depth_n = np.where(wet_n, n - x_nc[:, 1], 0.0)
    kind = fluid(cs=DAM_SOUND, viscosity=VISCOSITY * n)
    scene = {
        "types": [kind, {**kind, "phase": "solid"}],
        "rheo": {"interface_reconstruct": True},
        "pair": smooth(options, ARTIFICIAL, DAM_DAMPING, DAM_SOUND),
        "forces": forces(gravity=(0.0, -g)),
    }
    return start(
        f"dam-{n}",
        scene,
        x_nc,
        (length + layers + 1.0, 2.0 * top),
        (-layers - 1.0, -layers - 1.0),
        options=options,
        times=[t * n for t in tank.times],
        timestep=time_step(options, DAM_SOUND + FASTEST, VISCOSITY * n),
        type_n=np.where(wet_n, 1, 2),
        rho_n=1 + g * depth_n / DAM_SOUND**2,
        periodic=(False, False),
    )


# --- front

NARROW = Tank(0.5, 2.75, 1.2, np.linspace(0.4, 3.34, 22) / 2)


def _front(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the front over the width of the column, at times in units of the root of width over 2 g."""
    wet_n = _start(n, options, NARROW).atoms.type_n == 1
    width = NARROW.width * n
    # The foremost particle may be a drop: the front is behind one particle in two hundred.
    ahead = max(1, int(wet_n.sum()) // 200)
    return (
        tuple(2 * shot.time / n for shot in snapshots),
        tuple(float(np.sort(shot.x_nc[wet_n, 0])[-ahead] + 0.5) / width for shot in snapshots),
    )


FRONT = FlowPanel(
    "front",
    "t √(2g/a)",
    "front / width a of the column",
    (
        table("martin-moyce-table", "Martin & Moyce 1952, table"),
        table("martin-moyce-large", "the same, read off its figure"),
        table("martin-moyce-small", "column of half the size"),
    ),
    _front,
)


def _arrival(n: int, options: Options, snapshots: Sequence[Snapshot]) -> float:
    """Return the time at which the front has reached three widths."""
    times, fronts = _front(n, options, snapshots)
    return float(np.interp(3.0, fronts, times))


DAM = Flow(
    "dam-break",
    "A column of width a, twice as high, collapses along a floor; c = 10 times the fastest fluid, viscosity "
    f"{VISCOSITY:g} H √(gH), artificial viscosity {ARTIFICIAL:g}, rho/damp {DAM_DAMPING:g} h c. The experiment has "
    "its zero of time where the front was first seen, and a wall that takes time to go: simulations run ahead.",
    FRONT.known[0].source,
    (16, 24, 32),
    "none: an experiment has no error that falls with the spacing",
    partial(_start, tank=NARROW),
    misfits((FRONT,)),
    quick=(12,),
    title="Dam break: the front",
    panels=(FRONT,),
    quantities=(FlowQuantity("time to run three widths", _arrival, 2.51, "Martin & Moyce, table 2"),),
    findings=(FORCE_PER_VOLUME,),
    left_out="The pressure on a wall opposite (Buchner 2002): at these resolutions sound and particles that the impact "
    "throws out outweigh it on both sides, and LAMMPS loses atoms.",
)

DAMS = (DAM,)
