r"""Benchmarks of the paper with walls: channels of a Newtonian and of a yielding fluid, a column at rest, a dam break.

Fluid and wall particles share one lattice, so that the fluid's last row lies at the half width H of the channel and the
wall's first row at H + 1. The published profiles are compared with walls at H; a wall without slip lies half a spacing
further out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from scipy.integrate import solve_ivp

from eos_ref.analytic.channel import plane_start_up
from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KernelStyle
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, fluid, forces, relative, start
from lammps_cases.studies.flows.known import Curve, Flow, FlowPanel, Published, ReferenceCurve, curve, line, misfits
from lammps_cases.studies.flows.paper import (
    LENGTH,
    NAMES,
    SOURCE,
    disordered,
    errors_of,
    lattice,
    pair_terms,
    points_of,
    step_length,
)

# --- 3 and 4 channels

WIDTH, SOUND, END = 12, 2.0, 150.0  # spacings along the channel; c; the time of the profile in the paper's units
HALF = LENGTH / 2  # H
ROWS = 3.95  # the inner rows of the published norm, 16 of a grid


@dataclass(frozen=True)
class ChannelFluid:
    """A fluid of the paper in its units: viscosity up to a rate of strain, a power law beyond, acceleration."""

    eta: float
    gravity: float
    gd0: float = math.inf
    yielding: float = 0.0
    power: float = 1.0

    @property
    def K(self) -> float:
        """Return the consistency, with which the stress is continuous at gd0."""
        return float((self.eta * self.gd0 - self.yielding) / self.gd0**self.power)

    def stress(self, rate_n: FloatArray) -> FloatArray:
        """Return the shear stress at a rate of strain."""
        if math.isinf(self.gd0):
            return self.eta * rate_n
        size_n = np.maximum(np.abs(rate_n), self.gd0)
        beyond_n = np.sign(rate_n) * (self.yielding + self.K * size_n**self.power)
        return np.where(np.abs(rate_n) < self.gd0, self.eta * rate_n, beyond_n)

    def viscosity(self, unit: float) -> float | dict[str, float]:
        """Return the viscosity of a scene in which a length of 1 is ``unit`` spacings; stresses are the same."""
        if math.isinf(self.gd0):
            return self.eta * unit
        return {
            "eta": self.eta * unit,
            "gd0": self.gd0 / unit,
            "K": self.K * unit**self.power,
            "n": self.power,
        }

    def speed(self, y_n: FloatArray, time: float, half: float) -> FloatArray:
        """Return the velocity from rest between walls at -half and half; by finite volumes unless Newtonian."""
        if math.isinf(self.gd0):
            return np.asarray(plane_start_up(np.clip(y_n + half, 0, 2 * half), time, 2 * half, self.eta, self.gravity))
        return np.asarray(np.interp(np.abs(y_n), *_from_rest(self, time, half)))


@cache
def _from_rest(of: ChannelFluid, time: float, half: float) -> tuple[FloatArray, FloatArray]:
    """Return places from the middle to a wall, and the velocity there."""
    cells = 400
    size = half / cells
    place_n = (np.arange(cells) + 0.5) * size

    def rate(_: float, u_n: FloatArray) -> FloatArray:
        slope_n = np.diff(u_n, prepend=u_n[:1], append=-u_n[-1:]) / size  # the middle is a plane of symmetry
        return of.gravity + np.diff(of.stress(slope_n)) / size

    band = np.eye(cells) + np.eye(cells, k=1) + np.eye(cells, k=-1)
    # The cells' own error is (1/400)^2, 6e-6 of the velocity.
    found = solve_ivp(rate, (0.0, time), 0 * place_n, "BDF", rtol=1e-6, atol=1e-10, jac_sparsity=band)
    return np.append(place_n, half), np.append(found.y[:, -1], 0.0)


NEWTONIAN = ChannelFluid(0.16, 1e-4)
YIELDING = ChannelFluid(0.5, 2e-4, 5e-4, 2e-5, 0.5)


def _channel(n: int, options: Options, of: ChannelFluid) -> Start:
    """Return the channel: rows -n/2 to n/2 are fluid."""
    unit, half, layers = n / LENGTH, n // 2, math.ceil(options.cut)
    x_nc = lattice(np.arange(WIDTH) + 0.5, np.arange(-half - layers, half + layers + 1))
    inside_n = np.abs(x_nc[:, 1]) <= half
    x_nc = disordered(x_nc, f"paper-channel-{n}", inside_n)
    kind = fluid(cs=SOUND, viscosity=1.0) | {"viscosity": of.viscosity(unit)}
    return start(
        f"paper-channel-{n}",
        {
            "types": [kind, {**kind, "phase": "solid"}],
            "rheo": {"interface_reconstruct": True, "shift": True},
            "pair": pair_terms(options, SOUND),
            "forces": forces("2", (of.gravity / unit, 0.0)),
        },
        np.stack([np.mod(x_nc[:, 0], WIDTH), x_nc[:, 1]], axis=1),
        (WIDTH, half + layers + 1.0),
        (0.0, -half - layers - 1.0),
        options=options,
        times=[END * unit],
        timestep=step_length(options, SOUND),
        type_n=np.where(inside_n, 1, 2),
        periodic=(True, False),
    )


def _profile(
    n: int, options: Options, snapshots: Sequence[Snapshot], of: ChannelFluid
) -> tuple[FloatArray, FloatArray]:
    """Return distances from the middle and velocities of the fluid, in the paper's units."""
    inside_n = _channel(n, options, of).atoms.type_n == 1
    last = snapshots[-1]
    return last.x_nc[inside_n, 1] * LENGTH / n, last.v_nc[inside_n, 0]


def _channel_errors(n: int, options: Options, snapshots: Sequence[Snapshot], of: ChannelFluid) -> dict[str, float]:
    """Return the paper's norm of the shape, and errors of the velocity against walls at H and half a spacing out."""
    y_n, u_n = _profile(n, options, snapshots, of)
    time, exact = snapshots[-1].time * LENGTH / n, {}
    for name, half in (("velocity, wall at H", HALF), ("velocity, wall half a spacing out", HALF + LENGTH / n / 2)):
        exact[name] = of.speed(y_n, time, half)
    right_n, inner_n = exact["velocity, wall at H"], np.abs(y_n) <= ROWS
    if of is NEWTONIAN:
        shapes = [v_n[inner_n] / v_n[inner_n].mean() for v_n in (u_n, right_n)]
        norm = 16 * float(np.abs(shapes[0] - shapes[1]).mean())
    else:
        upper_n = (y_n >= 0) & (y_n <= 4.5 / 19 * 20)
        norm = 9 / 400 * float(np.abs(u_n - right_n)[upper_n].mean() / right_n.mean())
    return {"published norm": norm} | {name: relative(u_n - right, right) for name, right in exact.items()}


def _read_profile(n: int, options: Options, snapshots: Sequence[Snapshot], of: ChannelFluid) -> Curve:
    y_n, u_n = _profile(n, options, snapshots, of)
    return curve(y_n, u_n / float(of.speed(np.zeros(1), snapshots[-1].time * LENGTH / n, HALF)[0]))


def _channel_flow(of: ChannelFluid, name: str, title: str, kernel: KernelStyle, published: Published) -> Flow:
    across = np.linspace(-HALF, HALF, 201)
    middle = float(of.speed(np.zeros(1), END, HALF)[0])
    exact = line("exact, wall at H", across, of.speed(across, END, HALF) / middle, "start-up between plates")
    panel = FlowPanel("velocity", "y", "u / exact in the middle", (exact,), partial(_read_profile, of=of))
    return Flow(
        f"paper-{name}-{kernel.lower()}",
        f"A channel from rest, driven along its walls, at t = {END:g}; disordered by 0.1 spacings, shifted.",
        (20, 40),
        "1 against walls at H, which are half a spacing further out; 2 against walls there",
        partial(_channel, of=of),
        partial(_channel_errors, of=of),
        Options(kernel, 3.0),
        quick=(20,) if kernel == "RK1" else (),
        full=(50, 100),
        title=f"{title}, {kernel}",
        panels=(panel,),
        findings=(FORCE_PER_VOLUME,),
        published=published,
    )


# Norms of the shape from the published profiles; the printed fit has one point.
_SHAPES = {
    "quintic": {20: 0.778, 40: 0.415, 50: 0.327, 100: 0.149, 200: 0.069},
    "RK1": {20: 0.579, 40: 0.284, 50: 0.221, 100: 0.095, 200: 0.032},
}


def _newtonian(kernel: KernelStyle) -> Flow:
    meaning = (
        "The printed order is a fit through one point and is left out; errors by N are those of the published "
        "profiles. The wall lies at H + 1/2 spacing: that alone makes most of the error against walls at H."
    )
    published = Published("3 Poiseuille flow", _SHAPES[kernel], math.nan, meaning)
    return _channel_flow(NEWTONIAN, "poiseuille", "Poiseuille flow", kernel, published)


def _yielding(kernel: KernelStyle, order: float) -> Flow:
    meaning = (
        "Published: after t = 4470, against the ideal law; here at t = 150, against the law that is simulated, "
        "Newtonian up to a rate of strain. The velocity lies between those for walls at H and half a spacing out."
    )
    published = Published("4 Herschel-Bulkley channel", errors_of("4", kernel, "shift"), order, meaning)
    return _channel_flow(YIELDING, "herschel-bulkley", "Herschel-Bulkley channel", kernel, published)


# --- 7 column at rest

WEIGHT = 1e-3  # gravity in the paper's units, H = 10, c = 1: a compression of 1 per cent
REST = 150.0


def _column(n: int, options: Options) -> Start:
    """Return rows 1 to n over a floor whose first row is 0, in equilibrium."""
    layers, unit = math.ceil(options.cut), n / LENGTH
    gravity = WEIGHT / unit
    x_nc = lattice(np.arange(WIDTH) + 0.5, np.arange(-layers, n + 1))
    wet_n = x_nc[:, 1] > 0
    kind = fluid(viscosity=0.1 * unit)
    surface = {"style": "divergence", "limit": 1.5, "splash": 2}
    return start(
        f"paper-column-{n}",
        {
            "types": [kind, {**kind, "phase": "solid"}],
            "rheo": {"interface_reconstruct": True, "shift": True, "surface_detection": surface},
            "pair": pair_terms(options, 1.0),
            "forces": forces("2", (0.0, -gravity)),
        },
        x_nc,
        (WIDTH, n + 5.0),
        (0.0, -layers - 1.0),
        options=options,
        times=[REST * unit],
        timestep=step_length(options, 1.0),
        type_n=np.where(wet_n, 1, 2),
        rho_n=np.where(wet_n, np.exp(gravity * (n + 0.5 - x_nc[:, 1])), 1.0),
        periodic=(True, False),
    )


def _pressures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the pressure over rho0 g H against the depth over H."""
    wet_n = _column(n, options).atoms.type_n == 1
    last = snapshots[-1]
    return curve(1 - last.x_nc[wet_n, 1] / n, last.pressure_n[wet_n] / (WEIGHT * LENGTH))


def _column_errors(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    depth_n, p_n = map(np.array, _pressures(n, options, snapshots))
    exact_n = np.expm1(WEIGHT * LENGTH * (depth_n + 0.5 / n)) / (WEIGHT * LENGTH)
    bottom = depth_n > 0.9
    return {"pressure": relative(p_n - exact_n, exact_n), "at the floor": float((p_n / exact_n)[bottom].mean() - 1)}


_DEPTH = np.linspace(0, 1, 101)


def _tank_flow(kernel: KernelStyle) -> Flow:
    x, y = points_of("hydrostatic_profile", "depth_over_H", "p_over_rho_g_H", kernel=NAMES[kernel])
    exact = line("exact", _DEPTH, np.expm1(WEIGHT * LENGTH * _DEPTH) / (WEIGHT * LENGTH), "weight of the column")
    panel = FlowPanel(
        "pressure",
        "depth / H",
        "p / rho0 g H",
        (exact, ReferenceCurve("published, N = 100", x, y, SOURCE)),
        _pressures,
    )
    return Flow(
        f"paper-tank-{kernel.lower()}",
        "A column under gravity over a floor, periodic along it, from equilibrium.",
        (20, 40),
        "1: the free surface lies anywhere within the last row",
        _column,
        _column_errors,
        Options(kernel, 3.5, zmin=30),
        quick=(20,) if kernel == "quintic" else (),
        full=(100,),
        title=f"Hydrostatic column, {kernel}",
        panels=(panel,),
        findings=(FORCE_PER_VOLUME,),
        published=Published(
            "7 hydrostatic tank",
            {},
            math.nan,
            "Published: one profile at N = 100 from a start at uniform density, without a norm. Here the column "
            "starts in equilibrium.",
        ),
    )


# --- 8 dam break

FALL, DAM_SOUND = 0.0245, 10.0
RUN = 1.47  # t sqrt(g/H) at the end


def _dam(n: int, options: Options) -> Start:
    """Return the column, n wide and 2 n high, at the left end of a tank; N is per 10 of the paper's units."""
    unit, layers = n / LENGTH, math.ceil(options.cut)
    gravity, right = FALL / unit, round(5.366 * n)
    x_nc = lattice(np.arange(-layers, right + layers), np.arange(-layers, round(2.5 * n)))
    x_n, y_n = x_nc.T
    wet_n = (x_n > 0) & (x_n <= n) & (y_n > 0) & (y_n <= 2 * n)
    kept_n = wet_n | (x_n <= 0) | (x_n > right) | (y_n <= 0)
    x_nc, wet_n = x_nc[kept_n], wet_n[kept_n]
    kind = fluid(cs=DAM_SOUND, viscosity=0.05 * unit)
    surface = {"style": "coordination", "limit": 26, "splash": 2}
    end = RUN * math.sqrt(2 * n / gravity)
    return start(
        f"paper-dam-{n}",
        {
            "types": [kind, {**kind, "phase": "solid"}],
            "rheo": {"interface_reconstruct": True, "shift": True, "surface_detection": surface},
            "pair": pair_terms(options, DAM_SOUND),
            "forces": forces("2", (0.0, -gravity)),
        },
        x_nc,
        (right + layers + 1.0, 4.0 * n),
        (-layers - 1.0, -layers - 1.0),
        options=options,
        times=[end * (t + 1) / 18 for t in range(18)],
        timestep=step_length(options, DAM_SOUND),
        type_n=np.where(wet_n, 1, 2),
        rho_n=np.where(wet_n, 1 + gravity * (2 * n - x_nc[:, 1]) / DAM_SOUND**2, 1.0),
        periodic=(False, False),
    )


def _front(n: int, options: Options, snapshots: Sequence[Snapshot]) -> Curve:
    """Return the foremost fluid particle from the face of the dam, over H = 2 n, against t sqrt(g/H)."""
    wet_n = _dam(n, options).atoms.type_n == 1
    per_time = math.sqrt(FALL * LENGTH / n / (2 * n))
    fronts = [float(shot.x_nc[wet_n, 0].max() - n) / (2 * n) for shot in snapshots]
    return tuple(shot.time * per_time for shot in snapshots), tuple(fronts)


def _series(label: str, name: str) -> ReferenceCurve:
    return ReferenceCurve(label, *points_of("dam_break_front", "t_sqrt_g_over_H", "x_over_H", series=name), SOURCE)


def _dam_flow(kernel: KernelStyle) -> Flow:
    known = (
        _series("published, N = 100", NAMES[kernel]),
        _series("Martin & Moyce 1952", "Martin_Moyce_1952"),
        _series("Shao & Lo", "Shao_Lo_ISPH"),
    )
    panel = FlowPanel("front", "t √(g/H)", "front / H", known, _front)
    return Flow(
        f"paper-dam-{kernel.lower()}",
        "A column of width L, twice as high, collapses along a floor without slip. Re = 280.",
        (20,),
        "none: a published computation at N = 100",
        _dam,
        misfits((panel,)),
        Options(kernel, 3.5, zmin=32),
        quick=(10,) if kernel == "quintic" else (),
        full=(40,),
        title=f"Dam break, {kernel}",
        panels=(panel,),
        findings=(FORCE_PER_VOLUME,),
        published=Published(
            "8 dam break",
            {},
            math.nan,
            "The error is that against the published front of the same kernel at N = 100. Both run behind the "
            "experiment, whose zero of time is uncertain.",
        ),
    )


WALLS = (
    _newtonian("RK1"),
    _newtonian("quintic"),
    _yielding("RK1", 1.226),
    _yielding("quintic", 0.694),
    _tank_flow("RK1"),
    _tank_flow("quintic"),
    _dam_flow("RK1"),
    _dam_flow("quintic"),
)
