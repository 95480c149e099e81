r"""Fluid in empty space, and two phases: a rotating square, a drop oscillating in a central force, a bubble.

The drop: a disc of radius R is stretched at the rate :math:`A_0` while every particle is pulled to the middle by
:math:`-B^2\mathbf r`. It stays an ellipse, :math:`\dot a=Aa`, :math:`\dot A=(A^2+B^2)(b^2-a^2)/(b^2+a^2)`,
:math:`ab=R^2` (Monaghan & Rafiee, Int. J. Numer. Methods Fluids 71, 537, 2013).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from eos_ref.analytic import waves
from eos_ref.eos.table import FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import Body, Options, Snapshot, Start, fluid, rows, smooth, start, time_step
from lammps_cases.studies.flows.known import Curve, Flow, FlowPanel, FlowQuantity, line, misfits
from lammps_cases.studies.flows.surfaces import INTERFACE, disc, radius_of

ARTIFICIAL, DAMPING = 0.1, 0.1  # artificial viscosity; density diffusion over h c
NO_TENSION = (
    "RHEO has no surface tension, neither in its manual nor among the styles of fixes that LAMMPS lists, and no "
    "other fix of LAMMPS gives a fluid a tension that is known. "
)

# --- rotating square patch; units: side, angular velocity

PATCH_SOUND = 7.0  # ten times the speed of a corner
ANGLES = tuple(np.linspace(0.1, 2.0, 20).tolist())


def patch_pressure(x_nc: FloatArray, side: float, terms: int = 40) -> FloatArray:
    r"""Return the first pressure over :math:`\rho\omega^2`: :math:`\nabla^2p=2`, 0 on the edges of the square.

    Source: Colagrossi, thesis, Rome (2005): a double series of sines.
    """
    waves_ = np.arange(1, terms, 2) * np.pi / side
    sines_k, sines_l = (np.sin(np.outer(x_n + side / 2, waves_)) for x_n in x_nc.T)
    weight = -32.0 / (side**2 * np.outer(waves_, waves_) * (waves_[:, None] ** 2 + waves_**2))
    return np.asarray(np.einsum("nk,nl,kl->n", sines_k, sines_l, weight))


def _inviscid(sound: float, options: Options) -> dict[str, Any]:
    """Return the scene of a fluid whose only viscosity is that which keeps it smooth."""
    return {"types": [fluid(cs=sound, viscosity=0.0)], "pair": smooth(options, ARTIFICIAL, DAMPING, sound)}


def _patch(n: int, options: Options) -> Start:
    x_nc, omega = rows(0, n, n) - n / 2, 1.0 / n
    return start(
        f"patch-{n}",
        _inviscid(PATCH_SOUND, options),
        x_nc,
        (3.0 * n, 3.0 * n),
        (-3.0 * n, -3.0 * n),
        options=options,
        times=[angle * n for angle in ANGLES],
        timestep=time_step(options, PATCH_SOUND + 1),
        v_nc=omega * np.stack([x_nc[:, 1], -x_nc[:, 0]], axis=1),
        rho_n=1 + omega**2 * patch_pressure(x_nc, n) / PATCH_SOUND**2,
        periodic=(False, False),
    )


def _kept(n: int, options: Options, snapshots: Sequence[Snapshot], angular: bool) -> Curve:
    """Return the angular momentum or the kinetic energy over its initial value, at angles of the square's rotation."""
    begin = _patch(n, options).atoms
    assert begin.v_nc is not None

    def value(x_nc: FloatArray, v_nc: FloatArray) -> float:
        return float(np.sum(x_nc[:, 0] * v_nc[:, 1] - x_nc[:, 1] * v_nc[:, 0] if angular else v_nc**2))

    first = value(begin.x_nc, begin.v_nc)
    return tuple(shot.time / n for shot in snapshots), tuple(value(s.x_nc, s.v_nc) / first for s in snapshots)


_KEPT = line(
    "incompressible, inviscid", np.array([0.0, 2.0]), np.array([1.0, 1.0]), "no force from outside, no friction"
)
ENERGY = FlowPanel(
    "kinetic energy", "angle turned (radians)", "kinetic energy / its first", (_KEPT,), partial(_kept, angular=False)
)
SPIN = FlowPanel(
    "angular momentum", "angle turned (radians)", "angular momentum / its first", (_KEPT,), partial(_kept, angular=True)
)
PATCH = Flow(
    "patch",
    "A square of fluid in empty space rotates as a solid body at first; its corners go out. It starts with the "
    "pressure of the series of sines, which is negative. c = 10 corner speeds, artificial viscosity "
    f"{ARTIFICIAL:g}, rho/damp {DAMPING:g} h c, no shift.",
    (20, 28, 40),
    "1: artificial viscosity falls with the spacing",
    _patch,
    misfits((ENERGY, SPIN)),
    quick=(16,),
    title="Rotating square patch",
    panels=(ENERGY, SPIN),
    quantities=(
        FlowQuantity(
            "kinetic energy after two radians, over the first", lambda *of: ENERGY.read(*of)[1][-1], 1.0, "kept"
        ),
    ),
    findings=(FORCE_PER_VOLUME,),
    validates="free surfaces, conservation of energy and of angular momentum",
    limits="Artificial viscosity takes the energy. Forces along the line between two particles keep the angular "
    f"momentum to rounding; LAMMPS loses a little of it by {FORCE_PER_VOLUME.id}.",
    left_out="Shapes and pressures at later times are published as figures of other codes, whose numbers could not be "
    "confirmed.",
)


# --- oscillating drop; units: radius R, B R

STRETCH = 0.4  # first rate of strain over B
DROP_SOUND = 12.0  # over B R: the pressure in the middle, 0.58, compresses the fluid by 0.4 %
SWINGS = tuple(np.linspace(0.2, 9.6, 48).tolist())  # times B


def ellipse(times: FloatArray) -> FloatArray:
    """Return the axis along which the drop is stretched first, over R."""

    def rates(_: float, state: FloatArray) -> list[float]:
        rate, a = state
        return [(rate**2 + 1) * (1 / a**2 - a**2) / (1 / a**2 + a**2), rate * a]

    least = 100 * np.finfo(float).eps  # the smallest that scipy accepts
    solved = solve_ivp(rates, (0, times[-1]), [STRETCH, 1.0], "DOP853", times, rtol=least, atol=least)
    return np.asarray(solved.y[1])


def _pull(mass_n: FloatArray, x_nc: FloatArray, _: FloatArray | None, B: float) -> FloatArray:
    """Return the central force."""
    return np.asarray(-(B**2) * mass_n[:, None] * x_nc)


def _drop(n: int, options: Options) -> Start:
    """Return a drop n spacings wide, with the pressure of the ellipse."""
    x_nc = disc(n)
    radius = radius_of(x_nc)
    B = 1 / radius
    pressure_n = 0.5 * (STRETCH**2 + 1) * (1 - (x_nc**2).sum(axis=1) / radius**2)
    pull = Body(
        (f"-{B**2!r}*mass*x", f"-{B**2!r}*mass*y"),
        partial(_pull, B=B),
    )
    return start(
        f"drop-{n}",
        _inviscid(DROP_SOUND, options),
        x_nc,
        (3 * radius, 3 * radius),
        (-3 * radius, -3 * radius),
        options=options,
        times=[t / B for t in SWINGS],
        timestep=time_step(options, DROP_SOUND + 1),
        v_nc=STRETCH * B * x_nc * np.array([1.0, -1.0]),
        rho_n=1 + pressure_n / DROP_SOUND**2,
        periodic=(False, False),
        body=pull,
    )


def _axis(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the axis along x, by the second moment, over the first radius, at times B."""
    begin = disc(n)
    first, radius = float(np.mean(begin[:, 0] ** 2)), radius_of(begin)
    return (
        tuple(shot.time / radius for shot in snapshots),
        tuple(float(np.sqrt(np.mean(shot.x_nc[:, 0] ** 2) / first)) for shot in snapshots),
    )


def _period(times: Sequence[float], axis: Sequence[float]) -> float:
    """Return the period times B of an axis, of the oscillation that fits its logarithm best."""
    _, omega = waves.damped_oscillation(np.log(np.array(axis)), times[1] - times[0])
    return 2 * math.pi / float(omega)


_T = np.linspace(0, SWINGS[-1], 481)
AXIS = FlowPanel(
    "axis",
    "time · B",
    "half axis along x / R",
    (line("ellipse", _T, ellipse(_T), "Monaghan & Rafiee (2013): the equations of the ellipse, integrated"),),
    _axis,
)
DROP = Flow(
    "oscillating-drop",
    f"A round drop, stretched at {STRETCH:g} B, swings under a force −B² r to its middle, given by fix addforce "
    f"with atom-style variables. c = {DROP_SOUND:g} B R, artificial viscosity {ARTIFICIAL:g}, rho/damp "
    f"{DAMPING:g} h c. About 1 % of error stays as the spacing falls; with c = 25 B R noise makes it larger.",
    (16, 22, 30),
    "none: the Mach number stays, and with it what the fluid is compressed by",
    _drop,
    misfits((AXIS,)),
    quick=(12,),
    title="Oscillating drop",
    panels=(AXIS,),
    quantities=(
        FlowQuantity(
            "period times B",
            lambda *of: _period(*_axis(*of)),
            _period(SWINGS, ellipse(np.array(SWINGS)).tolist()),
            "ellipse",
        ),
    ),
    findings=(FORCE_PER_VOLUME,),
    validates="free surfaces under an outside force, frequency of a fluid",
    limits="The fluid is compressed, whatever the spacing: an error of the axis stays, and the period goes to one "
    "below that of the ellipse.",
    left_out=NO_TENSION + "The drop swings under a central force instead.",
)


# --- bubble

BINS = 12  # of the distance from the middle
RIM = 0.25  # radius of the bubble, over the edge of the box


def _radial(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the mean pressure over the background, by distance from the middle over the radius of the bubble."""
    last, background = snapshots[-1], options.number("background", 0.05)
    r_n = np.sqrt(((last.x_nc - n / 2) ** 2).sum(axis=1)) / (RIM * n)
    edges = np.linspace(0, 2, BINS + 1)
    bin_n = np.digitize(r_n, edges) - 1
    means = [float(last.pressure_n[bin_n == k].mean()) / background for k in range(BINS)]
    return tuple((0.5 * (edges[1:] + edges[:-1])).tolist()), tuple(means)


JUMP = FlowPanel(
    "pressure",
    "distance from the middle / radius of the bubble",
    "pressure / that of the background",
    (
        line(
            "Laplace's law without tension",
            np.array([0.0, 2.0]),
            np.array([1.0, 1.0]),
            "Laplace: jump = tension / R = 0",
        ),
    ),
    _radial,
)


def _jump(n: int, options: Options, snapshots: Sequence[Snapshot]) -> float:
    """Return the pressure inside less that outside, over the background."""
    r, p = map(np.array, _radial(n, options, snapshots))
    return float(p[r < 1].mean() - p[r > 1].mean())


BUBBLE = Flow(
    "bubble",
    f"{INTERFACE.about} Particles of the two phases may not gain a difference of pressure by themselves.",
    (16, 24, 36),
    INTERFACE.expected,
    INTERFACE.start,
    misfits((JUMP,)),
    INTERFACE.options,
    (16,),
    "Static bubble of two phases",
    (JUMP,),
    (FlowQuantity("jump of the pressure over the background", _jump, 0.0, "Laplace"),),
    (FORCE_PER_VOLUME,),
    NO_TENSION + "The jump to be met is that of no tension.",
    validates="interface of two densities under one pressure",
    limits="Each bin of the distance holds few particles: the error of the profile is the noise of the start, damped "
    "by viscosity; the jump, a mean over the bubble, is what falls.",
)
VALIDATIONS = (PATCH, DROP, BUBBLE)
