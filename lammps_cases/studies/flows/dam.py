r"""A column of fluid that collapses between walls, against the experiments of Martin & Moyce (1952).

Speeds are in units of :math:`\sqrt{gH}`, H the height of the column; the fastest fluid has two of them, sound twenty.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import (
    Curve,
    Flow,
    FlowPanel,
    FlowQuantity,
    Options,
    Snapshot,
    Start,
    misfits,
    table,
)
from lammps_cases.studies.flows.layout import fluid, forces, rows, smooth, start, time_step

FASTEST, SOUND = 2.0, 20.0  # over sqrt(g H)
VISCOSITY = 1e-3  # over H sqrt(g H): walls drag, but the fluid far from them hardly
ARTIFICIAL, DAMPING = 0.1, 0.1  # artificial viscosity; density diffusion over h c: with twice that a front loses drops


class Tank:
    """A tank and the column at its left end, in units of the height of the column; the times at which it is read."""

    def __init__(self, width: float, length: float, height: float, times: Iterable[float]) -> None:
        self.width, self.length, self.height, self.times = width, length, height, tuple(times)


def _start(n: int, options: Options, tank: Tank) -> Start:
    """Return the column in hydrostatic equilibrium with a wall that is gone; n spacings high."""
    layers, g = math.ceil(options.cut), 1.0 / n
    length, top = round(tank.length * n), round(tank.height * n)
    x_nc = rows(-layers, top, length + 2 * layers) - np.array([layers, 0.0])
    x_n, y_n = x_nc.T
    open_n = (x_n > 0) & (x_n < length) & (y_n > 0)
    wet_n = open_n & (x_n < round(tank.width * n)) & (y_n < n)
    kept_n = ~open_n | wet_n
    x_nc, wet_n = x_nc[kept_n], wet_n[kept_n]
    depth_n = np.where(wet_n, n - x_nc[:, 1], 0.0)
    kind = fluid(cs=SOUND, viscosity=VISCOSITY * n)
    scene = {
        "types": [kind, {**kind, "phase": "solid"}],
        "rheo": {"interface_reconstruct": True},
        "pair": smooth(options, ARTIFICIAL, DAMPING, SOUND),
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
        timestep=time_step(options, SOUND + FASTEST, VISCOSITY * n),
        type_n=np.where(wet_n, 1, 2),
        rho_n=1 + g * depth_n / SOUND**2,
        periodic=(False, False),
    )


# --- front

NARROW = Tank(0.5, 2.75, 1.2, np.linspace(0.4, 3.34, 22) / 2)


def _front(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the front over the width of the column, at times in units of the root of width over 2 g."""
    wet_n = _start(n, options, NARROW).atoms.type_n == 1
    width = NARROW.width * n
    # The foremost particle may be a drop: the front has one in two hundred ahead of it.
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
    """Return the time at which the front has run to three widths."""
    times, fronts = _front(n, options, snapshots)
    return float(np.interp(3.0, fronts, times))


DAM = Flow(
    "dam-break",
    "A column of width a, twice as high, collapses along a floor; c = 10 times the fastest fluid, viscosity "
    f"{VISCOSITY:g} H √(gH), artificial viscosity {ARTIFICIAL:g}, rho/damp {DAMPING:g} h c. The experiment has "
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

VALIDATIONS = (DAM,)
