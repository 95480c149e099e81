"""Single precision: where a flow fails in float32 that is stable in float64.

LAMMPS computes in float64 alone, so that the layer float32 is the reference's: positions, velocities and densities are
stored as float32, and all that follows from them is float32 too, but for the neighbour search and the differences of
positions, which are exact and then rounded (`lammps_cases.studies.stability.runs.Single`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.layout import fluid, rows, start, time_step
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

EDGE = 6  # spacings
SPEED = 1.0  # of the flow


def _shear(cell: MapCell, viscosity: float, offset: float, fraction: float, steps: int) -> Start:
    """Return a sheared wave of Mach number y, in a box far from the origin; the viscosity is given over c."""
    cs = SPEED / cell.y
    nu = viscosity * cs
    y_n = rows(0, EDGE, EDGE)[:, 1]
    v_nc = np.stack([SPEED * np.sin(2 * np.pi * y_n / EDGE), np.zeros(len(y_n))], axis=1)
    options = Options(dt_fraction=fraction)
    dt = time_step(options, cs + SPEED, nu)
    return _start(cell, {"types": [fluid(cs=cs, viscosity=nu)]}, options, dt, steps, offset, v_nc=v_nc)


def _start(
    cell: MapCell, scene: dict[str, Any], options: Options, dt: float, steps: int, offset: float = 0.0, **fields: Any
) -> Start:
    """Return a periodic box with some fields, whose numbers the layer float32 rounds."""
    low_c, high_c = (offset, offset), (offset + EDGE, offset + EDGE)
    x_nc, name = rows(0, EDGE, EDGE) + np.array(low_c), f"{cell.map}-{cell.layer}"
    double = start(name, scene, x_nc, high_c, low_c, options=options, times=(steps * dt,), timestep=dt, **fields)
    return single(double) if cell.layer == "float32" else double


def single(given: Start) -> Start:
    """Return a start whose positions, velocities and densities are float32: the reference goes on in that type."""
    a = given.atoms
    arrays: dict[str, Any] = {"x_nc": a.x_nc, "v_nc": a.v_nc, "rho_n": a.rho_n}
    short = {name: array.astype(np.float32) for name, array in arrays.items() if array is not None}
    return replace(given, atoms=replace(a, **short))


ORIGIN = StabilityMap(
    id="precision-origin",
    title="Distance from the origin",
    about="A sheared wave in a periodic box far from the origin: positions lose the digits that tell particles apart.",
    x=Axis("offset/spacing", 10.0, 1e16, 0.2, log=True),
    y=Axis("Mach number", 0.01, 0.3, 0.1, log=True),
    lines=(0.03, 0.3),
    # A whole offset: the places half a spacing from it are the first to be lost.
    start=lambda cell: _shear(cell, 0.1, float(math.floor(cell.x)), 0.2, 60),
    watch=lambda cell: FailureCriteria(every=10, growth=2.0, energy=EDGE**2 * SPEED**2 / 4, closest=0.3),
    layers=("float64", "float32"),
    reference_only=("float32",),
    engines_differ="particles that rounding puts on top of each other: refused by the reference, not by LAMMPS",
    theory=(
        Theory("numbers one spacing apart", lambda y: 2.0**52, "float64"),
        Theory("numbers one spacing apart", lambda y: 2.0**23, "float32"),
    ),
)


STEP = StabilityMap(
    id="precision-timestep",
    title="Time step",
    about="A sheared wave under longer and longer time steps, over min(h/4(c + U), h^2/8 nu): whether roundings bring "
    "the failure on earlier.",
    x=Axis("dt/limit", 1.0, 16.0, 0.03, log=True),
    y=Axis("Mach number", 0.003, 0.3, 0.1, log=True),
    lines=(0.03, 0.3),
    start=lambda cell: _shear(cell, 0.5, 0.0, cell.x, 100),
    watch=lambda cell: FailureCriteria(every=20, growth=2.0, energy=EDGE**2 * SPEED**2 / 4, closest=0.1),
    layers=("float64", "float32"),
    reference_only=("float32",),
)


def _squeezed(cell: MapCell) -> Start:
    """Return a wave of compression so weak that its densities are few roundings from rho0."""
    cs, options = 10.0, Options(dt_fraction=0.2)
    rho_n = 1.0 + cell.x * np.cos(2 * np.pi * rows(0, EDGE, EDGE)[:, 0] / EDGE)
    scene = {"types": [fluid(cs=cs, viscosity=cell.y)], "pressure": [{"types": "*", "style": "tait/water"}]}
    return _start(cell, scene, options, time_step(options, cs, cell.y), 100, rho_n=rho_n)


def _sound(cell: MapCell) -> FailureCriteria:
    """Watch for a kinetic energy beyond a few times that of the sound wave."""
    return FailureCriteria(every=10, growth=4.0, energy=EDGE**2 * (10.0 * cell.x) ** 2 / 4)


COMPRESSION = StabilityMap(
    id="precision-compression",
    title="Weak compression",
    about="A sound wave of a small amplitude, of which roundings of the density make noise. x: amplitude over rho0.",
    x=Axis("amplitude/rho0", 1e-18, 1e-2, 0.4, log=True),
    y=Axis("viscosity", 0.1, 10.0, 0.1, log=True),
    lines=(1.0, 5.0),
    coarse=12,
    start=_squeezed,
    watch=_sound,
    layers=("float64", "float32"),
    reference_only=("float32",),
    theory=(
        Theory("rounding of the density", lambda y: 2.0**-53, "float64"),
        Theory("rounding of the density", lambda y: 2.0**-24, "float32"),
    ),
)

MAPS = (ORIGIN, STEP, COMPRESSION)
