"""A free surface that moves, and the interface of two fluids that should not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eos_ref.analytic.drops import stretched
from eos_ref.eos.table import FloatArray
from eos_ref.model.box import BoolArray
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Flow, Options, Snapshot, Start, relative
from lammps_cases.studies.flows.layout import fluid, rows, start, time_step, under

QUICK = (16, 24, 36)

# --- stretching drop

STRETCHING = 0.2  # time over which the drop is stretched, in units of the first rate of strain
SPEED = 1.0  # on the surface, at first


def disc(n: int) -> FloatArray:
    """Return the sites of a square lattice in a circle of n spacings across, around 0."""
    half = n // 2 + 1
    x_nc = rows(-half, half, 2 * half) - np.array([half, 0])
    return np.asarray(x_nc[(x_nc**2).sum(axis=1) < n**2 / 4])


def radius_of(x_nc: FloatArray) -> float:
    """Return the radius of the circle that has the area of particles of volume 1."""
    return float(np.sqrt(len(x_nc) / np.pi))


def _drop(n: int, options: Options) -> Start:
    x_nc = disc(n)
    radius = radius_of(x_nc)
    rate, cs = SPEED / radius, SPEED / options.number("mach", 0.05)
    ellipse = stretched(radius, rate, 0.0)
    h = options.cut / 3
    scene = {
        "types": [fluid(cs=cs, viscosity=0.0)],
        "pair": {
            "artificial_visc": options.number("artificial-visc", 0.1),
            "rho_damp": options.number("rho-damp", 0.1) * h * cs,
        },
    }
    edge = 2 * radius
    return start(
        f"drop-{n}",
        scene,
        x_nc,
        (edge, edge),
        (-edge, -edge),
        options=options,
        times=[STRETCHING / rate],
        timestep=time_step(options, cs + SPEED),
        v_nc=ellipse.velocity(x_nc),
        rho_n=1.0 + ellipse.pressure(x_nc, 1.0) / cs**2,
        periodic=(False, False),
    )


def _drop_errors(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    """Return the error of displacements, of velocities, and of the second moments that give the semi-axes."""
    x_nc, last = disc(n), snapshots[-1]
    radius = radius_of(x_nc)
    ellipse = stretched(radius, SPEED / radius, last.time)
    carried_nc = x_nc * np.array([ellipse.a, ellipse.b]) / radius
    exact_nc = ellipse.velocity(last.x_nc)
    a, b = np.sqrt(np.mean(last.x_nc**2, axis=0) / np.mean(x_nc**2, axis=0))
    return {
        "displacement": relative(last.x_nc - carried_nc, carried_nc - x_nc),
        "velocity": relative(last.v_nc - exact_nc, exact_nc),
        "long axis": float(abs(a * radius / ellipse.a - 1)),
        "short axis": float(abs(b * radius / ellipse.b - 1)),
    }


DROP = Flow(
    "drop",
    "A round drop, stretched along x and squeezed along y from the start, becomes an ellipse. Options: mach (0.05, "
    "speed of the surface over that of sound), artificial-visc (0.1), rho-damp (0.1, over h c). Without damping, or "
    "when stretched much further, the square lattice gives way and velocities become noise.",
    "ellipse of Monaghan (1994), with the pressure inside; eos_ref.analytic.drops",
    (16, 24, 36, 54),
    "1: forces of particles on the surface lack neighbours; artificial viscosity falls with the spacing",
    _drop,
    _drop_errors,
    quick=QUICK,
)


# --- two fluids at rest

HEAVY, LIGHT = {"mass": 1.0, "rho0": 1.0, "cs": 1.0}, {"mass": 0.4, "rho0": 0.4, "cs": 1.5}
REST = 1.0  # time, in units of the edge over the sound speed of the heavy fluid
SPREAD = 0.02  # kinematic viscosity over c n


def _fluids(n: int) -> tuple[FloatArray, BoolArray]:
    """Return positions in a box of n spacings, and whether they belong to the drop in its middle, half as wide."""
    x_nc = rows(0, n, n)
    inside_n = ((x_nc - n / 2) ** 2).sum(axis=1) < (n / 4) ** 2
    return x_nc, inside_n


def _interface(n: int, options: Options) -> Start:
    x_nc, inside_n = _fluids(n)
    nu, p = SPREAD * n, options.number("background", 0.05)
    disorder = options.number("disorder", 0.1)
    x_nc = x_nc + np.random.default_rng(seed(f"interface-{n}")).uniform(-disorder, disorder, x_nc.shape)
    scene = {"types": [{**kind, "viscosity": nu * kind["rho0"]} for kind in (HEAVY, LIGHT)], "pressure": under(p)}
    return start(
        f"interface-{n}",
        scene,
        np.mod(x_nc, n),
        (n, n),
        options=options,
        times=[REST * n],
        timestep=time_step(options, LIGHT["cs"], nu),
        type_n=np.where(inside_n, 1, 2),
    )


def _interface_errors(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    """Return the speed over that of sound; jump of the pressure, and its scatter, over the background."""
    inside_n, last, p = _fluids(n)[1], snapshots[-1], options.number("background", 0.05)
    jump = np.mean(last.pressure_n[inside_n]) - np.mean(last.pressure_n[~inside_n])
    return {
        "velocity": float(np.sqrt(np.mean((last.v_nc**2).sum(axis=1)))) / HEAVY["cs"],
        "jump": float(abs(jump)) / p,
        "pressure": float(np.sqrt(np.mean((last.pressure_n - p) ** 2))) / p,
    }


INTERFACE = Flow(
    "interface",
    "A heavy drop at rest in a lighter fluid, without surface tension, both under the same background pressure; "
    "particles in disorder, so that nothing vanishes by symmetry. Options: background (0.05, over rho c^2 of the "
    "drop), disorder (0.1, spacings).",
    "nothing moves, and the pressure is that of the background everywhere",
    (16, 24, 36, 54),
    "1: what is left of disorder at the size of the box is a mean over n^2 particles; at the size of a spacing it "
    "does not fall, but viscosity damps it",
    _interface,
    _interface_errors,
    quick=QUICK,
)

FLOWS = (DROP, INTERFACE)
