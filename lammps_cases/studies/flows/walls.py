r"""Flows between walls of solid particles: plane flow, Newtonian or not, and a tank in which nothing should move.

A solid particle is held by fix setforce 0 and lies in place of the next row of fluid, so that the wall is half a
spacing from the last row of fluid.

Fluids whose viscosity depends on the rate of strain have closed forms: a force :math:`\rho g` along plates at
rest makes the stress :math:`\tau=\rho g|y|`, y from the middle; fix rheo/viscosity power makes
:math:`\tau=\eta\dot\gamma` up to :math:`\dot\gamma_0`, :math:`\tau=\tau_0+K\dot\gamma^n` beyond.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from eos_ref.analytic.channel import column, plane_start_up, weight_of_column
from eos_ref.eos.table import EOS, FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.findings.walls import WALL_VELOCITY_LOST
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, fluid, forces, relative, rows, start, time_step
from lammps_cases.studies.flows.known import Curve, Flow, FlowPanel, FlowQuantity, ReferenceCurve, curve, line, misfits

WIDTH = 8  # of a strip along the walls, periodic


# --- plane flow from rest

NU = 1.0
MACH = 0.05
TIMES = (0.05, 0.1, 0.15, 0.2)  # in units of n^2/nu: at the end the slowest mode has decayed to 14 %


@dataclass(frozen=True)
class Drive:
    """The drive of the fluid: the final speed of its middle by gravity, and that of the upper plate.

    Both in units of Reynolds number x nu / n; ``reconstruct``: with interface/reconstruct.
    """

    pull: float
    plate: float
    reconstruct: bool

    def speed(self, n: int, options: Options) -> float:
        """Return the unit of speed."""
        return options.number("reynolds", 0.1) * NU / n

    def gravity(self, n: int, options: Options) -> float:
        """Return the acceleration along the plates."""
        return 8 * NU * self.pull * self.speed(n, options) / n**2


def _channel(n: int, options: Options, drive: Drive) -> Start:
    speed, layers = drive.speed(n, options), math.ceil(options.cut)
    type_n = np.repeat([2, 1, 3], [layers * WIDTH, n * WIDTH, layers * WIDTH])
    v_nc = np.zeros((len(type_n), 2))
    v_nc[type_n == 3, 0] = drive.plate * speed
    cs = speed / MACH
    kind = fluid(cs=cs, viscosity=NU)
    solid = {**kind, "phase": "solid"}
    scene = {
        "types": [kind, solid, solid],
        "rheo": {"interface_reconstruct": drive.reconstruct},
        "forces": forces("2*3", (drive.gravity(n, options), 0.0) if drive.pull else None),
    }
    return start(
        f"channel-{n}",
        scene,
        rows(-layers, n + layers, WIDTH),
        (WIDTH, n + layers + 1.0),
        (0.0, -layers - 1.0),
        options=options,
        times=[t * n**2 / NU for t in TIMES],
        timestep=time_step(options, cs + speed, NU),
        type_n=type_n,
        v_nc=v_nc,
        periodic=(True, False),
    )


def _channel_errors(n: int, options: Options, snapshots: Sequence[Snapshot], drive: Drive) -> dict[str, float]:
    """Return the errors of the velocity over all fluid particles: at all times, at the last one."""
    fluid_n = _channel(n, options, drive).atoms.type_n == 1
    speed, gravity = drive.speed(n, options), drive.gravity(n, options)
    velocities, exact = [], []
    for snapshot in snapshots:
        velocities.append(snapshot.v_nc[fluid_n, 0])
        y_n = snapshot.x_nc[fluid_n, 1]
        exact.append(plane_start_up(y_n, snapshot.time, n, NU, gravity, drive.plate * speed))
    error = np.array(velocities) - np.array(exact)
    return {"velocity": relative(error, np.array(exact)), "velocity at the end": relative(error[-1], exact[-1])}


def _channel_flow(name: str, about: str, expected: str, drive: Drive) -> Flow:
    return Flow(
        name,
        f"{about} Option: reynolds (default 0.1, so that rows pass each other by less than a spacing).",
        (8, 12, 18, 27),
        expected,
        partial(_channel, drive=drive),
        partial(_channel_errors, drive=drive),
        Options(kernel="RK1"),  # whose first moments are exact on every lattice; the quintic's are off by 8e-4
        findings=(WALL_VELOCITY_LOST,) if drive.plate and drive.reconstruct else (),
        validates="walls, viscosity",
    )


_AT_THE_WALL = "2: kernel smoothing; velocities of walls extrapolated linearly, to the estimated distance of the wall"
POISEUILLE = _channel_flow(
    "poiseuille", "Gravity sets fluid between two plates in motion.", _AT_THE_WALL, Drive(1.0, 0.0, True)
)
COUETTE = _channel_flow(
    "couette",
    f"A plate sets fluid in motion. LAMMPS ignores the velocity of the plate ({WALL_VELOCITY_LOST.id}): the "
    "extrapolation alone drags the fluid to half of it, and the error stays at a half.",
    _AT_THE_WALL,
    Drive(0.0, 1.0, True),
)
COUETTE_STORED = _channel_flow(
    "couette-stored",
    "A plate sets fluid in motion, without interface/reconstruct: solids have their own velocity, wherever they lie.",
    "1: the velocity of the plate is met about half a spacing behind its face",
    Drive(0.0, 1.0, False),
)


# --- tank

COMPRESSION = 0.02  # weight of the column over rho0 c^2
RESTS = 2.0  # in times n/c of sound through the column: a wave from a false start has its largest pressure
SPREAD = 0.01  # kinematic viscosity over c n


@dataclass(frozen=True)
class TankColumn:
    """A tank of n rows: law, gravity, positions and densities of the rows from the bottom up, height."""

    law: EOS
    gravity: float
    y_n: FloatArray
    rho_n: FloatArray
    height: float


def _column(n: int, options: Options) -> TankColumn:
    style = options.word("law", "linear")
    law = EOS(style, 1.0, 1.0)
    gravity = options.number("compression", COMPRESSION) / n
    depth_n, rho_n = column(law, np.arange(n) + 0.5, gravity)
    height = float(column(law, n, gravity)[0])
    return TankColumn(law, gravity, height - depth_n[::-1], rho_n[::-1], height)


def _tank(n: int, options: Options) -> Start:
    tank, layers, nu = _column(n, options), math.ceil(options.cut), SPREAD * n
    x_nc = rows(-layers, n, WIDTH)
    below = layers * WIDTH
    # Walls have the density of the bottom, and the spacing of that density.
    x_nc[:below, 1] /= tank.law.density(tank.gravity * n)
    x_nc[below:, 1] = np.repeat(tank.y_n, WIDTH)
    rho_n = np.concatenate([np.ones(below), np.repeat(tank.rho_n, WIDTH)])
    kind = fluid(viscosity=nu)
    scene = {
        "types": [kind, {**kind, "phase": "solid"}],
        "pressure": [{"types": "*", "style": tank.law.style}],
        "rheo": {"interface_reconstruct": True},
        "forces": forces(gravity=(0.0, -tank.gravity)),
    }
    return start(
        f"tank-{n}",
        scene,
        x_nc,
        (WIDTH, n + 2.0),
        (0.0, -layers - 1.0),
        options=options,
        times=[RESTS * n],
        timestep=time_step(options, 1.0, nu),
        type_n=np.repeat([2, 1], [below, n * WIDTH]),
        rho_n=rho_n,
        periodic=(True, False),
    )


def _tank_errors(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    """Return the errors of the pressure, and of the speed over that of a wave from a false start."""
    tank, last = _column(n, options), snapshots[-1]
    fluid_n = _tank(n, options).atoms.type_n == 1
    exact_n = weight_of_column(tank.law, tank.height - last.x_nc[fluid_n, 1], tank.gravity)
    scale = tank.gravity * n / tank.law.rho0
    return {
        "pressure": relative(last.pressure_n[fluid_n] - exact_n, exact_n),
        "velocity": float(np.sqrt(np.mean(last.v_nc[fluid_n] ** 2))) / scale,
    }


TANK = Flow(
    "tank",
    "Compressible fluid at rest under gravity over a wall, with a free surface. It starts in equilibrium and is looked "
    "at when a wave from a false start has its largest pressure. LAMMPS' forces lack the volume "
    f"({FORCE_PER_VOLUME.id}), so its column carries m g in place of rho g and the error stays near the compression. "
    "Options: law (linear, tait/water), compression (weight over rho0 c^2, default 0.02). From a cutoff of 4 spacings "
    "on the second layer of the wall lies within half of it, and the repulsion that comes with interface/reconstruct "
    "lifts the fluid.",
    (8, 12, 18, 27),
    "1: the free surface lies anywhere within the last row; 2 for the rest",
    _tank,
    _tank_errors,
    # The lattice sum that replaces the first moment of grad W is 1 - 1.4e-4 there, and 1 + 8.0e-4 with 3 spacings.
    Options(cut=2.7),
    findings=(FORCE_PER_VOLUME,),
    validates="gravity, walls, free surface",
)

FLOWS = (POISEUILLE, COUETTE, COUETTE_STORED, TANK)


REYNOLDS = 0.1  # unit of speed times gap over K: rows pass each other by less than a spacing
FINE = 1000  # spacings of the gap for which closed forms are drawn
SETTLING = 1.0  # time, in n^2 over the viscosity of a Newtonian fluid as fast


@dataclass(frozen=True)
class PowerFluid:
    r"""A law of fix rheo/viscosity power in a gap of n spacings, and the driving force.

    :math:`\tau_0=\eta\dot\gamma_0-K\dot\gamma_0^n` is the yield stress.
    """

    eta: float
    gd0: float
    K: float
    power: float
    gravity: float
    n: int

    @property
    def yield_stress(self) -> float:
        """Return the stress at rest, of the law beyond gd0."""
        return float(self.eta * self.gd0 - self.K * self.gd0**self.power)

    def rate(self, stress_n: FloatArray) -> FloatArray:
        """Return the rate of shear under a stress."""
        beyond = np.maximum(stress_n - self.yield_stress, 0.0) / self.K
        return np.where(stress_n > self.eta * self.gd0, beyond ** (1 / self.power), stress_n / self.eta)

    def velocity(self, y_n: FloatArray) -> FloatArray:
        """Return the velocity at distances y from the lower plate: the rate integrated, by trapezia of n/40 000."""
        away = np.linspace(0, self.n / 2, 20_001)
        rate = self.rate(self.gravity * away)
        from_middle = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(away))])
        return np.asarray(from_middle[-1] - np.interp(np.abs(y_n - self.n / 2), away, from_middle))

    @property
    def at_the_wall(self) -> float:
        """Return the viscosity at the plates."""
        stress = self.gravity * self.n / 2
        return stress / float(self.rate(np.array(stress)))


def power_law(power: float, n: int) -> PowerFluid:
    """Return a fluid of viscosity K rate^(n-1), cut at a tenth of the mean rate; 1 at the mean rate."""
    speed = REYNOLDS / n
    mean = speed / n
    K = mean ** (1 - power)
    gravity = K * (speed * (1 + 1 / power) / (n / 2) ** (1 + 1 / power)) ** power
    return PowerFluid(K * (mean / 10) ** (power - 1), mean / 10, K, power, gravity, n)


PLUG = 0.3  # of the gap, unyielded
STIFF = 20.0  # viscosity below the yield stress over that beyond


def bingham(n: int) -> PowerFluid:
    """Return a Bingham fluid of K = 1 as fix rheo/viscosity has it: stiff, not rigid, below its yield stress."""
    gravity = 2 * REYNOLDS / n / (n / 2 * (1 - PLUG)) ** 2
    return PowerFluid(STIFF, PLUG * gravity * n / 2 / (STIFF - 1), 1.0, 1.0, gravity, n)


def ideal_bingham(fluid_: PowerFluid, y_n: FloatArray) -> FloatArray:
    r"""Return the velocity of a rigid plug, :math:`\frac{\rho g}{2K}[(\frac n2-y_0)^2-(|y|-y_0)_+^2]`."""
    plug = fluid_.yield_stress / fluid_.gravity
    away = np.maximum(np.abs(y_n - fluid_.n / 2) - plug, 0.0)
    return np.asarray(fluid_.gravity / (2 * fluid_.K) * ((fluid_.n / 2 - plug) ** 2 - away**2))


def _power_channel(n: int, options: Options, of: Callable[[int], PowerFluid]) -> Start:
    """Return the closed form between plates whose type has the fluid's viscosity there.

    With the law of the fluid a solid, in which nothing shears, drags as stiffly as fluid at rest: option ``wall``.
    """
    power, layers = of(n), math.ceil(options.cut)
    x_nc, type_n = rows(-layers, n + layers, WIDTH), np.repeat([2, 1, 2], [layers * WIDTH, n * WIDTH, layers * WIDTH])
    v_nc = np.zeros_like(x_nc)
    v_nc[type_n == 1, 0] = power.velocity(x_nc[type_n == 1, 1])
    speed = REYNOLDS / n
    law = {"eta": power.eta, "gd0": power.gd0, "K": power.K, "n": power.power}
    kind = {"mass": 1.0, "rho0": 1.0, "cs": speed / MACH}
    at_wall: Any = law if options.word("wall", "constant") == "law" else power.at_the_wall
    return start(
        f"channel-{n}",
        {
            "types": [{**kind, "viscosity": law}, {**kind, "viscosity": at_wall, "phase": "solid"}],
            "rheo": {"interface_reconstruct": True},
            "forces": forces(gravity=(power.gravity, 0.0)),
        },
        x_nc,
        (WIDTH, n + layers + 1.0),
        (0.0, -layers - 1.0),
        options=options,
        times=[SETTLING * n**2 / (power.gravity * n**2 / (8 * speed))],
        timestep=time_step(options, speed / MACH + speed, max(power.eta, power.at_the_wall)),
        type_n=type_n,
        v_nc=v_nc,
        periodic=(True, False),
    )


def _profile(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the velocities of the rows of fluid, over the unit of speed, at heights over the gap."""
    last = snapshots[-1]
    rows_, u = slice(math.ceil(options.cut) * WIDTH, (math.ceil(options.cut) + n) * WIDTH), REYNOLDS / n
    y_nw, v_nw = last.x_nc[rows_, 1].reshape(n, WIDTH), last.v_nc[rows_, 0].reshape(n, WIDTH)
    return curve(y_nw.mean(axis=1) / n, v_nw.mean(axis=1) / u)


def _middle(n: int, options: Options, snapshots: Sequence[Snapshot]) -> float:
    """Return the velocity in the middle."""
    _, velocity = _profile(n, options, snapshots)
    return max(velocity)


def _known(of: Callable[[int], PowerFluid], label: str) -> ReferenceCurve:
    """Return the closed form over the unit of speed, which depends on n only by the units."""
    y = np.linspace(0, 1, 201)
    return line(label, y, of(FINE).velocity(y * FINE) / (REYNOLDS / FINE), "the law integrated over the gap")


def _of_channel(
    name: str,
    title: str,
    about: str,
    of: Callable[[int], PowerFluid],
    resolutions: tuple[int, ...] = (12, 16, 24),
    extra: tuple[ReferenceCurve, ...] = (),
    validates: str = "fix rheo/viscosity power, walls without slip",
) -> Flow:
    known = _known(of, "closed form")
    panel = FlowPanel("velocity", "y / gap", "velocity / nominal speed (Re = 0.1)", (known, *extra), _profile)
    middle = FlowQuantity("velocity in the middle", _middle, max(known.y), "closed form")
    return Flow(
        name,
        about + " It begins with the closed form and runs until it has its own. Option: wall (constant: walls have the "
        "viscosity of the adjacent fluid; law: that of the fluid).",
        resolutions,
        "2: kernel smoothing, and velocities of walls extrapolated linearly",
        partial(_power_channel, of=of),
        misfits((panel,)),
        Options(kernel="RK1"),
        (8, 12),
        title,
        (panel,),
        (middle,),
        (FORCE_PER_VOLUME,),
        validates=validates,
        setups={"walls with the law of the fluid": Options(kernel="RK1", extra={"wall": "law"})},
        limits="With its own law a wall, in which nothing shears, drags as stiffly as fluid at rest.",
    )


_Y = np.linspace(0, 1, 201)
THINNING = _of_channel(
    "power-law",
    "Shear-thinning Poiseuille flow",
    "A fluid of viscosity K (shear rate)^(−1/2) between plates, by fix rheo/viscosity power (n = 0.5), cut at a tenth "
    "of the mean rate.",
    partial(power_law, 0.5),
)
THICKENING = _of_channel(
    "power-law-thick",
    "Shear-thickening Poiseuille flow",
    "A fluid of viscosity K (shear rate)^(1/2) between plates (n = 1.5).",
    partial(power_law, 1.5),
)
BINGHAM = _of_channel(
    "bingham",
    "Bingham plug",
    f"A fluid with a yield stress, whose middle {PLUG:.0%} of the gap moves as a plug. fix rheo/viscosity power has a "
    f"fluid of {STIFF:g} times the viscosity below the yield stress, and errors are taken against its closed form; the "
    "rigid plug is drawn for comparison.",
    bingham,
    (8, 12, 16),
    (line("rigid plug", _Y, ideal_bingham(bingham(FINE), _Y * FINE) / (REYNOLDS / FINE), "Bingham's plug, rigid"),),
)

VALIDATIONS = (THINNING, THICKENING, BINGHAM)
