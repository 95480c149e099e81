r"""Square cavities: driven by a lid (Ghia, Ghia & Shin 1982), and heated from the side (de Vahl Davis 1983).

The lid is a belt of solid particles that runs on through the box, over the walls, so that it has no end. Walls are as
thick between the fluid and the edge of the box as its cutoff, and more. The Reynolds number is 100.

RHEO has no buoyancy. In Boussinesq's approximation it is a force :math:`m g\beta(T-T_0)`, applied by fix addforce with
an atom-style variable and the temperature from compute rheo/property/atom. Side walls keep their temperature by
a specific heat a million times the fluid's; floor and roof conduct nothing, as harmonic/means gives for a pair with
one insulator. No shift, which moves energies by their gradient, independent of specific heats.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.interpolate import griddata

from eos_ref.eos.table import FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.findings.thermal import HEAT_IS_TEMPERATURE_RATE
from lammps_cases.findings.walls import WALL_VELOCITY_LOST
from lammps_cases.studies.flows.flow import (
    Body,
    Options,
    Snapshot,
    Start,
    fluid,
    forces,
    rows,
    smooth,
    start,
    time_step,
)
from lammps_cases.studies.flows.known import Curve, Flow, FlowPanel, FlowQuantity, curve, misfits, table

REYNOLDS, MACH = 100.0, 0.1
SIDE = 4  # spacings of a wall
SETTLING, READINGS = 10, 4  # times in which the lid moves by its length; the last ones are averaged
ARTIFICIAL, DAMPING = 0.1, 0.2  # artificial viscosity; density diffusion over h c: with less, particles may escape


def _driven(n: int, options: Options) -> Start:
    layers, nu, cs = math.ceil(options.cut), n / REYNOLDS, 1 / MACH
    x_nc = rows(-layers, n + layers, n + 2 * SIDE) - np.array([SIDE, 0.0])
    inside_n = ((x_nc > 0) & (x_nc < n)).all(axis=1)
    type_n = np.where(x_nc[:, 1] > n, 3, np.where(inside_n, 1, 2))
    v_nc = np.zeros_like(x_nc)
    v_nc[type_n == 3, 0] = 1.0
    kind = fluid(cs=cs, viscosity=nu)
    solid = {**kind, "phase": "solid"}
    scene = {
        "types": [kind, solid, solid],
        "rheo": {"interface_reconstruct": options.word("walls", "reconstructed") == "reconstructed", "shift": True},
        "pair": smooth(options, options.number("artificial", ARTIFICIAL), DAMPING, cs),
        "forces": forces("2*3"),
    }
    return start(
        f"cavity-{n}",
        scene,
        x_nc,
        (n + SIDE, n + layers + 1.0),
        (-SIDE, -layers - 1.0),
        options=options,
        times=[t * n for t in range(SETTLING - READINGS + 1, SETTLING + 1)],
        timestep=time_step(options, cs + 1, nu),
        type_n=type_n,
        v_nc=v_nc,
        periodic=(True, False),
    )


def _across(begin: Start, n: int, snapshots: Sequence[Snapshot], axis: int, end: float = 0.0) -> Curve:
    """Return the mean of the velocity across an axis on the line through the centre along it, with those of the walls.

    It is interpolated linearly where particles surround the line: the outermost rows lie half a spacing from the walls.
    """
    inside_n = begin.atoms.type_n == 1
    at = np.linspace(1 / n, 1 - 1 / n, 2 * n - 3)
    middle = np.full(len(at), 0.5)
    places = (at, middle) if axis == 0 else (middle, at)
    values = [griddata(shot.x_nc[inside_n] / n, shot.v_nc[inside_n, 1 - axis], places) for shot in snapshots]
    return curve(np.array([0.0, *at, 1.0]), np.array([0.0, *np.mean(values, axis=0), end]))


def _u(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    return _across(_driven(n, options), n, snapshots, 1, 1.0)


def _v(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    return _across(_driven(n, options), n, snapshots, 0)


U = FlowPanel("u", "y / side", "velocity u along the lid / lid's", (table("ghia-u", "Ghia et al. 1982"),), _u)
V = FlowPanel("v", "x / side", "velocity v across the lid / lid's", (table("ghia-v", "Ghia et al. 1982"),), _v)
QUANTITIES = (
    FlowQuantity("fastest backward flow, u / lid", lambda *of: min(_u(*of)[1]), -0.21090, "Ghia et al., table I"),
    FlowQuantity("fastest downward flow, v / lid", lambda *of: min(_v(*of)[1]), -0.24533, "Ghia et al., table II"),
)
ABOUT = (
    "A lid drives the fluid in a square cavity, Re = 100, c = 10 lid speeds, with shift, artificial viscosity "
    f"{ARTIFICIAL:g} and rho/damp {DAMPING:g} h c; from rest for {SETTLING} lengths of the lid, the last {READINGS} "
    "readings averaged."
)


CAVITY = Flow(
    "cavity",
    ABOUT,
    (12, 20, 28),
    "1: disorder of the shifted particles at the scale of a spacing, corners of the lid, where its velocity jumps",
    _driven,
    misfits((U, V)),
    title="Lid-driven cavity, reconstructed walls",
    panels=(U, V),
    quantities=QUANTITIES,
    findings=(WALL_VELOCITY_LOST, FORCE_PER_VOLUME),
    validates="moving walls, viscosity, shift",
    setups={"no artificial viscosity": Options(extra={"artificial": 0.0})},
    limits="Speed is missing, as if the fluid were more viscous, by what falls with the spacing. Artificial viscosity "
    "is not the reason: without any, curves are noisier and the extremes no nearer. The curves are means of few "
    "readings of particles in disorder; their errors fall less evenly than those of the extremes.",
)
STORED = replace(
    CAVITY,
    name="cavity-stored",
    about=f"{ABOUT} Without interface/reconstruct, so that walls have the velocity and the density that they are "
    "given.",
    resolutions=(16, 20, 28),
    expected="1: the velocity of the lid is met about half a spacing behind its face",
    options=Options(extra={"walls": "stored"}),
    quick=(12,),
    title="Lid-driven cavity, walls as they are given",
    findings=(FORCE_PER_VOLUME,),
    validates="moving walls without reconstruction",
    setups={},
    limits="The same walls are of first order in plane flow, where particles stay in rows (flow couette-stored). Here "
    "the velocity stays too small at every N, and this set-up does not converge; with reconstructed walls the flow "
    "does.",
)
VALIDATIONS = (CAVITY, STORED)


RAYLEIGH, PRANDTL = 1e4, 0.71
FASTEST = 20.0  # speeds are in units of diffusivity over side; that of sound is ten times the fastest
MEAN = 1.5  # of the temperatures 1 and 2 of the walls
HEAVY, NOTHING = 1e6, 1e-12  # specific heat of the side walls, conductivity of floor and roof, over those of the fluid
TIMES = (0.2, 0.225, 0.25)  # in units of side squared over diffusivity, from rest; averaged over
HEATED_ARTIFICIAL, HEATED_DAMPING = 0.02, 0.1


def _lift(mass_n: FloatArray, x_nc: FloatArray, T_n: FloatArray | None, lift: float) -> FloatArray:
    """Return Boussinesq's buoyancy."""
    return np.stack([0 * mass_n, lift * mass_n * (np.asarray(T_n) - MEAN)], axis=1)


def _heated(n: int, options: Options) -> Start:
    """Return fluid at rest, warm on the left; diffusivity 1."""
    layers, cs, speed = math.ceil(options.cut), 10 * FASTEST / n, FASTEST / n
    x_nc = rows(-layers, n + layers, n + 2 * layers) - np.array([layers, 0.0])
    x_n, y_n = x_nc.T
    type_n = np.select([(y_n < 0) | (y_n > n), x_n < 0, x_n > n], [2, 3, 4], 1)
    kind = {"mass": 1.0, "rho0": 1.0, "cs": cs, "viscosity": PRANDTL, "conductivity": 1.0, "specific_heat": 1.0}
    side = {**kind, "phase": "solid", "specific_heat": HEAVY}
    T_n = np.clip(MEAN + 0.5 - x_n / n, MEAN - 0.5, MEAN + 0.5)
    T_n = np.where(type_n == 3, MEAN + 0.5, np.where(type_n == 4, MEAN - 0.5, T_n))
    lift = RAYLEIGH * PRANDTL / n**3
    body = Body(
        ("0.0", f"{lift!r}*mass*(c_warm-{MEAN!r})"),
        partial(_lift, lift=lift),
        warm=True,
    )
    scene = {
        "types": [kind, {**kind, "phase": "solid", "conductivity": NOTHING}, side, side],
        "rheo": {"interface_reconstruct": True},
        "pair": {**smooth(options, HEATED_ARTIFICIAL, HEATED_DAMPING, cs), "harmonic_means": True},
        "forces": forces("2*4"),
    }
    return start(
        f"convection-{n}",
        scene,
        x_nc,
        (n + layers + 1.0, n + layers + 1.0),
        (-layers - 1.0, -layers - 1.0),
        options=options,
        times=[t * n**2 for t in TIMES],
        timestep=time_step(options, cs + speed, 1.0),
        type_n=type_n,
        e_n=T_n * np.where(type_n > 2, HEAVY, 1.0),
        periodic=(False, False),
        body=body,
    )


def _heated_along(n: int, options: Options, snapshots: Sequence[Snapshot], axis: int) -> Curve:
    """Return the velocity across a line through the centre, over diffusivity over side; the mean of the readings."""
    at, velocity = _across(_heated(n, options), n, snapshots, axis)
    return at, tuple(n * v for v in velocity)


def _nusselt(n: int, options: Options, snapshots: Sequence[Snapshot]) -> float:
    r"""Return the mean Nusselt number, :math:`1+\langle u(T-T_0)\rangle L/\alpha\Delta T` over all fluid."""
    inside_n = _heated(n, options).atoms.type_n == 1
    flow = [
        float(np.mean(shot.v_nc[inside_n, 0] * (shot.temperature_n[inside_n] - MEAN)))
        for shot in snapshots
        if shot.temperature_n is not None
    ]
    return 1 + n * float(np.mean(flow))


HEATED_U = FlowPanel(
    "u",
    "y / side",
    "velocity u · side / diffusivity",
    (table("vahl-davis-u", "de Vahl Davis 1983"),),
    partial(_heated_along, axis=1),
)
HEATED_V = FlowPanel(
    "v",
    "x / side",
    "velocity v · side / diffusivity",
    (table("vahl-davis-v", "de Vahl Davis 1983"),),
    partial(_heated_along, axis=0),
)
SOURCE = "de Vahl Davis"
CONVECTION = Flow(
    "convection",
    f"Fluid between a warm and a cold wall, Ra = {RAYLEIGH:g}, Pr = {PRANDTL:g}. RHEO has no buoyancy of its own: "
    "fix addforce gives Boussinesq's, by an atom-style variable of the temperature. Side walls keep "
    "their temperature by a specific heat a million times the fluid's.",
    (16, 22, 30),
    "1: walls have their temperature throughout, so that it is met about half a spacing behind their faces",
    _heated,
    misfits((HEATED_U, HEATED_V)),
    title="Natural convection",
    panels=(HEATED_U, HEATED_V),
    quantities=(
        FlowQuantity("mean Nusselt number", _nusselt, 2.243, SOURCE),
        FlowQuantity("fastest upward flow", lambda *of: max(HEATED_V.read(*of)[1]), 19.617, SOURCE),
    ),
    findings=(HEAT_IS_TEMPERATURE_RATE,),
    validates="conduction, heat carried by a flow",
    limits="Walls half a spacing further out make the Nusselt number smaller by one part in N, which is less than "
    "what is missing: the flow is too slow, as in the cavity with a lid.",
)
HEATED = (CONVECTION,)
