"""Discontinuities: a moving free surface, the interface of two fluids, a shock tube of two gases.

Particles of the tube keep their energies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eos_ref import InputError
from eos_ref.analytic.drops import stretched
from eos_ref.analytic.riemann import Gas, Riemann
from eos_ref.eos.table import FloatArray
from eos_ref.model.box import BoolArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, fluid, relative, rows, start, time_step, under
from lammps_cases.studies.flows.known import Flow

QUICK = (16, 24, 36)

# --- stretching drop

STRETCHING = 0.2  # time over which the drop is stretched, in units of the first rate of strain
SPEED = 1.0  # on the surface, at first


def disc(n: int) -> FloatArray:
    """Return the sites of a square lattice in a circle around 0, n spacings across."""
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
    (16, 24, 36, 54),
    "1: forces of particles on the surface lack neighbours; artificial viscosity falls with the spacing",
    _drop,
    _drop_errors,
    quick=QUICK,
    findings=(FORCE_PER_VOLUME,),
    validates="free surface",
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
    (16, 24, 36, 54),
    "1: what is left of disorder at the size of the box is a mean over n^2 particles; at the size of a spacing it "
    "does not fall, but viscosity damps it",
    _interface,
    _interface_errors,
    quick=QUICK,
    findings=(FORCE_PER_VOLUME,),
    validates="two fluids",
)

FLOWS = (DROP, INTERFACE)


SHOCK_QUICK = (60, 120, 240)
WIDTH = 4  # of the tube, periodic
GAMMA = 1.4
DENSE = Gas(1.0, 0.0, 1.0)
THIN_SOUND = 0.9
TIME = 0.16  # times length over speed of sound: the rarefactions meet in the middle at 0.25
SHOCK_SPREAD = 1.5  # widest spacing after expansion of the dense gas: unit of the cutoff


def problem(options: Options) -> Riemann:
    """Return the two gases, the dense one on the left.

    Raises
    ------
    InputError
        The thin gas has the higher pressure.
    """
    thin = Gas(options.number("thin", 0.5), 0.0, THIN_SOUND)
    if not thin.pressure < DENSE.pressure:
        raise InputError("thin", f"must be below {DENSE.pressure / THIN_SOUND**2:g}, for the lower pressure", thin.rho)
    return Riemann(DENSE, thin)


def without_volume(gases: Riemann, x_n: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
    r"""Return the density and velocity of gases at rest if forces lack the volume, as LAMMPS' do.

    The acceleration is then :math:`-\partial_xP/m` in place of :math:`-\partial_xP/\rho`, m the first density of each
    gas.

    - Rarefaction of the left gas: waves run at :math:`a=c\sqrt{\rho/m}`, so :math:`u+2a` is constant and
      :math:`u_*=2c(1-\sqrt y)` with :math:`y=P_*/P_L`; inside the fan :math:`x/t=u-a`.
    - Shock into the right one: with :math:`j=\rho(u-S)` constant, :math:`j\,du=-(\rho/m)\,dP` (P with its artificial
      part) gives :math:`c^2[\rho]=-\tfrac12mj^2[\rho^{-2}]`, hence :math:`S=cx\sqrt{2/(1+x)}` and :math:`u_*=S(1-1/x)`
      with :math:`x=P_*/P_R`.
    """
    left, right = gases.left, gases.right

    def shock(p: float) -> tuple[float, float]:
        x = p / right.pressure
        speed = right.c * x * math.sqrt(2 / (1 + x))
        return speed, speed * (1 - 1 / x)

    low, high = right.pressure, left.pressure
    while low < (p := (low + high) / 2) < high:
        faster = 2 * left.c * (1 - math.sqrt(p / left.pressure)) > shock(p)[1]
        low, high = (p, high) if faster else (low, p)
    (speed, u), xi_n = shock(p), x_n / t
    a_n = (2 * left.c - np.clip(xi_n, -left.c, u - left.c * np.sqrt(p / left.pressure))) / 3
    u_n = np.where(xi_n < u, 2 * (left.c - a_n), np.where(xi_n < speed, u, 0.0))
    thin_n = np.where(xi_n < speed, p / right.c**2, right.rho)
    return np.where(xi_n < u, left.rho * (a_n / left.c) ** 2, thin_n), u_n


def _tube(n: int, options: Options) -> Start:
    """Dense gas in the middle half of a periodic tube; mass equal to density in both, so that all volumes are 1."""
    gases = problem(options)
    x_nc = rows(0, WIDTH, n)
    type_n = np.where(np.abs(x_nc[:, 0] - n / 2) < n / 4, 1, 2)
    e_t = np.array([gas.c**2 / (GAMMA - 1) for gas in (gases.left, gases.right)])
    kinds = [
        fluid(mass=gas.rho, rho0=gas.rho, cs=gas.c, viscosity=0.0, conductivity=0.0)
        for gas in (gases.left, gases.right)
    ]
    wide = replace(options, cut=SHOCK_SPREAD * options.cut)
    return start(
        f"shock-tube-{n}",
        {
            "types": kinds,
            "pressure": [{"types": "*", "style": "ideal/gas", "gamma": GAMMA}],
            "pair": {"artificial_visc": options.number("artificial-visc", 0.5)},
        },
        x_nc,
        (n, WIDTH),
        options=wide,
        times=[TIME * n],
        timestep=time_step(wide, DENSE.c + gases.velocity),
        type_n=type_n,
        e_n=e_t[type_n - 1],
    )


def folded(n: int, snapshot: Snapshot) -> tuple[FloatArray, FloatArray]:
    """Return the distances from the nearest diaphragm and velocities, both positive towards the thin gas."""
    away_n = snapshot.x_nc[:, 0] % n - n / 2
    return np.abs(away_n) - n / 4, np.sign(away_n) * snapshot.v_nc[:, 0]


def _tube_errors(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    """Return mean absolute errors over the speed of the contact and the first difference of densities.

    Also those from the solution with forces that lack the volume.
    """
    gases, last = problem(options), snapshots[-1]
    x_n, velocity_n = folded(n, last)
    errors = {}
    for suffix, (rho_n, u_n) in (
        ("", gases.at(x_n, last.time)),
        (" without volume", without_volume(gases, x_n, last.time)),
    ):
        difference = gases.left.rho - gases.right.rho
        errors[f"velocity{suffix}"] = float(np.mean(np.abs(velocity_n - u_n)) / gases.velocity)
        errors[f"density{suffix}"] = float(np.mean(np.abs(last.rho_n - rho_n)) / difference)
    return errors


SHOCK_TUBE = Flow(
    "shock-tube",
    "Sod's problem for gases whose particles keep their energies: a rarefaction, a contact, a shock. Mass equals "
    f"density on both sides, so that LAMMPS, whose forces lack the volume ({FORCE_PER_VOLUME.id}), is right until "
    "volumes change; it then converges to another solution, with a shock that is too fast. The cutoff is in units of "
    f"{SHOCK_SPREAD:g} spacings, as wide as the gas expands: below that the lattice, stretched along the tube alone, "
    "no longer carries the pressure. Options: thin (density of the thin gas, default 0.5), artificial-visc (default "
    "0.5).",
    (60, 120, 240, 480),
    "1: discontinuities smeared over some spacings, in the L1 norm; n/ln n at the edges of the rarefaction, so that "
    "slopes at these resolutions are between 0.8 and 1",
    _tube,
    _tube_errors,
    quick=SHOCK_QUICK,
    findings=(FORCE_PER_VOLUME,),
    validates="ideal gas, shocks",
)

SHOCKS = (SHOCK_TUBE,)
