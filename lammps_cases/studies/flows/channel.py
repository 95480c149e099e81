r"""Fluids whose viscosity depends on the rate of strain, between two plates at rest; closed forms.

A force :math:`\rho g` along the plates makes the stress :math:`\tau=\rho g|y|`, y from the middle; fix rheo/viscosity
power makes :math:`\tau=\eta\dot\gamma` up to :math:`\dot\gamma_0`, :math:`\tau=\tau_0+K\dot\gamma^n` beyond.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import (
    Curve,
    Flow,
    FlowPanel,
    FlowQuantity,
    Options,
    ReferenceCurve,
    Snapshot,
    Start,
    curve,
    line,
    misfits,
)
from lammps_cases.studies.flows.layout import forces, rows, start, time_step
from lammps_cases.studies.flows.walls import MACH, WIDTH

REYNOLDS = 0.1  # unit of speed times gap over K: rows pass each other by less than a spacing
FINE = 1000  # spacings of the gap for which closed forms are drawn
SETTLING = 1.0  # time, in n^2 over the viscosity of a Newtonian fluid as fast


@dataclass(frozen=True)
class PowerFluid:
    r"""A law of fix rheo/viscosity power in a gap of n spacings, and the force that drives it.

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
        """Return the viscosity beside the plates."""
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


def _start(n: int, options: Options, of: Callable[[int], PowerFluid]) -> Start:
    """Return the closed form between plates whose type has the viscosity that the fluid has beside them.

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
    """Return the closed form, over the unit of speed; it depends on n by the units alone."""
    y = np.linspace(0, 1, 201)
    return line(label, y, of(FINE).velocity(y * FINE) / (REYNOLDS / FINE), "the law integrated over the gap")


def _of_channel(
    name: str,
    title: str,
    about: str,
    of: Callable[[int], PowerFluid],
    resolutions: tuple[int, ...] = (12, 16, 24),
    extra: tuple[ReferenceCurve, ...] = (),
) -> Flow:
    known = _known(of, "closed form")
    panel = FlowPanel("velocity", "y / gap", "velocity / nominal speed (Re = 0.1)", (known, *extra), _profile)
    middle = FlowQuantity("velocity in the middle", _middle, max(known.y), "closed form")
    return Flow(
        name,
        about + " It begins with the closed form and runs until it has its own. Option: wall (constant: walls have the "
        "viscosity of the fluid beside them; law: that of the fluid).",
        known.source,
        resolutions,
        "2: kernel smoothing, and velocities of walls extrapolated linearly",
        partial(_start, of=of),
        misfits((panel,)),
        Options(kernel="RK1"),
        (8, 12),
        title,
        (panel,),
        (middle,),
        (FORCE_PER_VOLUME,),
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
    f"fluid of {STIFF:g} times the viscosity below the yield stress; its closed form is the one that errors are taken "
    "against, the rigid plug is drawn beside it.",
    bingham,
    (8, 12, 16),
    (line("rigid plug", _Y, ideal_bingham(bingham(FINE), _Y * FINE) / (REYNOLDS / FINE), "Bingham's plug, rigid"),),
)

VALIDATIONS = (THINNING, THICKENING, BINGHAM)
