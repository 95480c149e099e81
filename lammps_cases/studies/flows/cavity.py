"""Lid-driven cavity at Reynolds number 100, against the table of Ghia, Ghia & Shin (1982).

The lid is a belt of solid particles that runs on through the box, over the walls, so that it has no end. Walls are as
thick between the fluid and the edge of the box as its cutoff, and more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import griddata

from eos_ref.eos.table import FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.findings.walls import WALL_VELOCITY_LOST
from lammps_cases.studies.flows.flow import (
    Curve,
    Flow,
    FlowPanel,
    FlowQuantity,
    Options,
    Snapshot,
    Start,
    curve,
    misfits,
    table,
)
from lammps_cases.studies.flows.layout import fluid, forces, rows, smooth, start, time_step

REYNOLDS, MACH = 100.0, 0.1
SIDE = 4  # spacings of a wall
SETTLING, READINGS = 10, 4  # times that the lid needs for its length; the last of them are averaged over
ARTIFICIAL, DAMPING = 0.1, 0.2  # artificial viscosity; density diffusion over h c: with less a particle may escape


def _start(n: int, options: Options) -> Start:
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
        "pair": smooth(options, ARTIFICIAL, DAMPING, cs),
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


def _along(n: int, options: Options, snapshots: Sequence[Snapshot], axis: int, at: FloatArray) -> FloatArray:
    """Return the mean of the velocity across a line through the centre, interpolated linearly between particles."""
    inside_n = _start(n, options).atoms.type_n == 1
    middle = np.full(len(at), 0.5)
    places = (at, middle) if axis == 0 else (middle, at)
    values = [griddata(shot.x_nc[inside_n] / n, shot.v_nc[inside_n, 1 - axis], places) for shot in snapshots]
    return np.asarray(np.mean(values, axis=0))


def _u(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return u on the vertical line through the centre, as far as there are particles; the walls have their own."""
    at = _between(n)
    return curve(np.array([0.0, *at, 1.0]), np.array([0.0, *_along(n, options, snapshots, 1, at), 1.0]))


def _v(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return v on the horizontal line through the centre, as far as there are particles, and at the walls."""
    at = _between(n)
    return curve(np.array([0.0, *at, 1.0]), np.array([0.0, *_along(n, options, snapshots, 0, at), 0.0]))


def _between(n: int) -> FloatArray:
    """Return places that particles surround: the outermost rows lie half a spacing from the walls, or are moved."""
    return np.linspace(1 / n, 1 - 1 / n, 2 * n - 3)


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
    U.known[0].source,
    (12, 20, 28),
    "1: noise of the shift at the scale of a spacing, corners of the lid",
    _start,
    misfits((U, V)),
    title="Lid-driven cavity, reconstructed walls",
    panels=(U, V),
    quantities=QUANTITIES,
    findings=(WALL_VELOCITY_LOST, FORCE_PER_VOLUME),
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
)
VALIDATIONS = (CAVITY, STORED)
