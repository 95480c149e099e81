r"""Natural convection in a square cavity, against the bench mark of de Vahl Davis (1983).

RHEO has no buoyancy. In Boussinesq's approximation it is a force :math:`m g\beta(T-T_0)`, which fix addforce makes of
an atom-style variable and the temperature that compute rheo/property/atom gives. Side walls keep their temperature by
a specific heat a million times the fluid's; floor and roof conduct nothing, as harmonic/means has it of a pair of
which one does not. No shift: it moves energies by their gradient, which knows nothing of specific heats.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.interpolate import griddata

from eos_ref.eos.table import FloatArray
from lammps_cases.findings.thermal import HEAT_IS_TEMPERATURE_RATE
from lammps_cases.studies.flows.flow import (
    Body,
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
from lammps_cases.studies.flows.layout import forces, rows, smooth, start, time_step

RAYLEIGH, PRANDTL = 1e4, 0.71
FASTEST = 20.0  # speeds are in units of diffusivity over side; sound has ten times the fastest
MEAN = 1.5  # of the temperatures 1 and 2 of the walls
HEAVY, NOTHING = 1e6, 1e-12  # specific heat of the side walls, conductivity of floor and roof, over those of the fluid
TIMES = (0.2, 0.225, 0.25)  # in units of side squared over diffusivity, from rest; averaged over
ARTIFICIAL, DAMPING = 0.02, 0.1


def _lift(mass_n: FloatArray, x_nc: FloatArray, T_n: FloatArray | None, lift: float) -> FloatArray:
    """Return Boussinesq's buoyancy."""
    return np.stack([0 * mass_n, lift * mass_n * (np.asarray(T_n) - MEAN)], axis=1)


def _start(n: int, options: Options) -> Start:
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
        "pair": {**smooth(options, ARTIFICIAL, DAMPING, cs), "harmonic_means": True},
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


def _along(n: int, options: Options, snapshots: Sequence[Snapshot], axis: int) -> Curve:
    """Return the velocity across a line through the centre, over diffusivity over side; the mean of the readings."""
    inside_n = _start(n, options).atoms.type_n == 1
    at = np.linspace(1 / n, 1 - 1 / n, 2 * n - 3)
    middle = np.full(len(at), 0.5)
    places = (at, middle) if axis == 0 else (middle, at)
    values = [griddata(shot.x_nc[inside_n] / n, n * shot.v_nc[inside_n, 1 - axis], places) for shot in snapshots]
    mean: FloatArray = np.mean(values, axis=0)
    return curve(np.array([0.0, *at, 1.0]), np.array([0.0, *mean, 0.0]))


def _nusselt(n: int, options: Options, snapshots: Sequence[Snapshot]) -> float:
    r"""Return the mean Nusselt number, :math:`1+\langle u(T-T_0)\rangle L/\alpha\Delta T` over all fluid."""
    inside_n = _start(n, options).atoms.type_n == 1
    flow = [
        float(np.mean(shot.v_nc[inside_n, 0] * (shot.temperature_n[inside_n] - MEAN)))
        for shot in snapshots
        if shot.temperature_n is not None
    ]
    return 1 + n * float(np.mean(flow))


U = FlowPanel(
    "u",
    "y / side",
    "velocity u · side / diffusivity",
    (table("vahl-davis-u", "de Vahl Davis 1983"),),
    partial(_along, axis=1),
)
V = FlowPanel(
    "v",
    "x / side",
    "velocity v · side / diffusivity",
    (table("vahl-davis-v", "de Vahl Davis 1983"),),
    partial(_along, axis=0),
)
SOURCE = "de Vahl Davis"
CONVECTION = Flow(
    "convection",
    f"Fluid between a warm and a cold wall, Ra = {RAYLEIGH:g}, Pr = {PRANDTL:g}. RHEO has no buoyancy of its own: "
    "fix addforce gives Boussinesq's, by an atom-style variable of the temperature. Side walls keep "
    "their temperature by a specific heat a million times the fluid's.",
    U.known[0].source,
    (16, 22, 30),
    "1: walls have their temperature throughout, so that it is met about half a spacing behind their faces",
    _start,
    misfits((U, V)),
    title="Natural convection",
    panels=(U, V),
    quantities=(
        FlowQuantity("mean Nusselt number", _nusselt, 2.243, SOURCE),
        FlowQuantity("fastest upward flow", lambda *of: max(V.read(*of)[1]), 19.617, SOURCE),
    ),
    findings=(HEAT_IS_TEMPERATURE_RATE,),
)
VALIDATIONS = (CONVECTION,)
