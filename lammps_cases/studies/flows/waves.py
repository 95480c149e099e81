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
from collections.abc import Sequence

import numpy as np

from eos_ref.analytic import waves
from eos_ref.eos.table import FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, fluid, forces, rows, smooth, start, time_step
from lammps_cases.studies.flows.known import Curve, Flow, FlowPanel, FlowQuantity, line, misfits, table

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
    """Return the rate of decay and the frequency, over those of Morris' force and of linear theory."""
    _, values = _amplitude(n, options, snapshots)
    rate, omega = waves.damped_oscillation(np.array(values), snapshots[0].time / n)
    return float(rate) / MORRIS, float(omega) / OMEGA


# Of Morris' force, with the layer at a wall without slip: Lighthill (1978), section 3.5.
MORRIS = K**2 / REYNOLDS + K / math.sinh(2 * K) * math.sqrt(OMEGA / 2 / REYNOLDS)
LIGHTHILL = 2 * K**2 / REYNOLDS
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
        line("Morris' force, ν k² and the wall", _T, _damped(MORRIS), "the dissipation of Morris' viscous force"),
        line("Lighthill, 2 ν k²", _T, _damped(LIGHTHILL), "Lighthill, Waves in Fluids (1978); deep water"),
    ),
    _amplitude,
)
WAVE = Flow(
    "standing-wave",
    f"A standing wave two depths long, slope {SLOPE:g}, Re = {REYNOLDS:g}, over a wall without slip (which adds 1.6 % "
    "to the decay), c = 10 √(gH). Morris' form of the viscous force, which pair rheo documents, leaves a free surface "
    "with another condition than no stress and dissipates half as much there as Lighthill's theory has it (Colagrossi "
    "et al., Phys. Rev. E 84, 026705, 2011). Errors are taken against its own rate; Lighthill's is drawn as well.",
    (12, 16, 24),
    "2: kernel smoothing, (k h)^2, where particles lie in order; 1 for the free surface, anywhere within the last row",
    _wave,
    misfits((MODE,)),
    quick=(8,),
    title="Standing wave",
    panels=(MODE,),
    quantities=(
        FlowQuantity(
            "rate of decay over that of Morris' force", lambda *of: _oscillation(*of)[0], 1.0, "energy dissipated"
        ),
        FlowQuantity(
            "frequency over that of linear theory",
            lambda *of: _oscillation(*of)[1],
            1.0,
            "linear theory",
            "no oscillation to fit",
        ),
        FlowQuantity("rate of decay over Lighthill's", lambda *of: _oscillation(*of)[0] * MORRIS / LIGHTHILL),
    ),
    findings=(FORCE_PER_VOLUME,),
    validates="free surface, gravity, viscous decay",
    limits="Lighthill's rate is not the limit of this method: the ratio to it, the last number, goes to a half. What "
    "the decay has beyond Morris' rate falls with the spacing.",
)

FASTEST, DAM_SOUND = 2.0, 20.0  # over sqrt(g H)
VISCOSITY = 1e-3  # of the other set-up, over H sqrt(g H)
ARTIFICIAL, DAM_DAMPING = 0.1, 0.1  # artificial viscosity; density diffusion over h c: twice that loses drops


COLUMN, LENGTH, HEIGHT = 0.5, 2.75, 1.2  # widths of column and tank, height of the tank
DAM_TIMES = np.linspace(0.4, 3.34, 22) / 2


def _dam(n: int, options: Options) -> Start:
    """Return the column, n spacings high, in hydrostatic equilibrium with a removed wall."""
    layers, g, nu = math.ceil(options.cut), 1.0 / n, options.number("viscosity", 0.0) * n
    length, top = round(LENGTH * n), round(HEIGHT * n)
    x_nc = rows(-layers, top, length + 2 * layers) - np.array([layers, 0.0])
    x_n, y_n = x_nc.T
    open_n = (x_n > 0) & (x_n < length) & (y_n > 0)
    wet_n = open_n & (x_n < round(COLUMN * n)) & (y_n < n)
    kept_n = ~open_n | wet_n
    x_nc, wet_n = x_nc[kept_n], wet_n[kept_n]
    depth_n = np.where(wet_n, n - x_nc[:, 1], 0.0)
    kind = fluid(cs=DAM_SOUND, viscosity=nu)
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
        times=[t * n for t in DAM_TIMES],
        timestep=time_step(options, DAM_SOUND + FASTEST, nu),
        type_n=np.where(wet_n, 1, 2),
        rho_n=1 + g * depth_n / DAM_SOUND**2,
        periodic=(False, False),
    )


def _front(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the front over the width of the column, at times in units of the root of width over 2 g."""
    wet_n = _dam(n, options).atoms.type_n == 1
    # The foremost particle may be a drop: the front is behind one particle in two hundred.
    ahead = max(1, int(wet_n.sum()) // 200)
    return (
        tuple(2 * shot.time / n for shot in snapshots),
        tuple(float(np.sort(shot.x_nc[wet_n, 0])[-ahead] + 0.5) / (COLUMN * n) for shot in snapshots),
    )


def _released(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the kinetic energy over the potential energy that the column has lost, from T = 1 on: first it is 0/0."""
    begin = _dam(n, options).atoms
    wet_n = begin.type_n == 1
    first, late = begin.x_nc[wet_n, 1].sum(), [shot for shot in snapshots if 2 * shot.time / n >= 1]
    lost = [float(first - shot.x_nc[wet_n, 1].sum()) / n for shot in late]
    kinetic = [float((shot.v_nc[wet_n] ** 2).sum()) / 2 for shot in late]
    ratio = (k / p if p else math.nan for k, p in zip(kinetic, lost, strict=True))
    return tuple(2 * shot.time / n for shot in late), tuple(ratio)


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
ENERGY = FlowPanel(
    "energy",
    "t √(2g/a)",
    "kinetic energy / potential energy lost",
    (line("no friction", np.array([1.0, 3.34]), np.array([1.0, 1.0]), "energy is kept: no force from outside"),),
    _released,
)
CLOCKS = np.arange(-0.1, 0.3, 0.005)


def _clock(curve: Curve) -> tuple[float, float]:
    """Return the error of a front for the best zero of the experiment's time, and that zero."""
    times = np.array(curve[0])
    return min((FRONT.known[0].misfit((tuple((times + late).tolist()), curve[1])), float(late)) for late in CLOCKS)


def _dam_errors(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    return {
        "energy": abs(_released(n, options, snapshots)[1][-1] - 1),
        "front": FRONT.known[0].misfit(front := _front(n, options, snapshots)),
        "front, best zero of time": _clock(front)[0],
    }


def _between(n: int, options: Options, snapshots: Sequence[Snapshot], begin: float = 1.44, end: float = 3.0) -> float:
    """Return the time in which the front runs between two places, for which no zero of time is needed."""
    times, fronts = _front(n, options, snapshots)
    first, last = np.interp([begin, end], fronts, times)
    return float(last - first)


DAM = Flow(
    "dam-break",
    f"A column of width a, twice as high, collapses along a floor; c = {DAM_SOUND / FASTEST:g} times the fastest "
    f"fluid, artificial viscosity {ARTIFICIAL:g}, rho/damp {DAM_DAMPING:g} h c, no viscosity: walls do not drag, and "
    "the energy is kept except for a loss that falls with the spacing.",
    (12, 16, 24),
    "1 for the energy: artificial viscosity falls with the spacing; none for the front: an experiment has no error "
    "that falls with it",
    _dam,
    _dam_errors,
    quick=(12,),
    title="Dam break: the front",
    panels=(FRONT, ENERGY),
    quantities=(
        FlowQuantity("kinetic energy over potential energy lost, at the end", lambda *of: _released(*of)[1][-1], 1.0),
        FlowQuantity("time from 1.44 to 3 widths", _between, 1.32, "Martin & Moyce, table 2"),
        FlowQuantity("zero of the experiment's time", lambda *of: _clock(_front(*of))[1]),
    ),
    findings=(FORCE_PER_VOLUME,),
    left_out="The pressure on a wall opposite (Buchner 2002): at these resolutions sound and particles that the impact "
    "throws out outweigh it on both sides, and LAMMPS loses atoms.",
    validates="free surfaces, gravity, walls under a moving fluid",
    setups={f"viscosity {VISCOSITY:g} H √(gH)": Options(extra={"viscosity": VISCOSITY})},
    limits="A viscosity that does not fall with the spacing takes energy at walls without slip, more as the layer "
    "there is resolved; but without any a particle may slip through a wall, as one does at N = 32. The experiment has "
    "its zero of time where the front was first seen, and a wall that takes time to go: the front runs ahead of it. "
    "Apart from a zero of time it misses the points by about as much as two readings of the same series differ.",
)

VALIDATIONS = (DAM, WAVE)
