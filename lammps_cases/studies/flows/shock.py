"""Shock tube of two gases whose particles keep their energies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eos_ref import InputError
from eos_ref.analytic.riemann import Gas, Riemann
from eos_ref.eos.table import FloatArray
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.studies.flows.flow import Flow, Options, Snapshot, Start
from lammps_cases.studies.flows.layout import fluid, rows, start, time_step

QUICK = (60, 120, 240)
WIDTH = 4  # of the tube, periodic
GAMMA = 1.4
DENSE = Gas(1.0, 0.0, 1.0)
THIN_SOUND = 0.9
TIME = 0.16  # times length over speed of sound: the rarefactions meet in the middle at 0.25
SPREAD = 1.5  # widest spacing that the dense gas expands to: the cutoff is in units of that


def problem(options: Options) -> Riemann:
    """Return the two gases, the dense one on the left.

    Raises
    ------
    InputError
        A thin gas of the higher pressure.
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
    wide = replace(options, cut=SPREAD * options.cut)
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

    The same from the solution that forces without volumes have.
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
    f"{SPREAD:g} spacings, as wide as the gas expands: below that the lattice, stretched along the tube alone, no "
    "longer carries the pressure. Options: thin (density of the thin gas, default 0.5), artificial-visc (default "
    "0.5).",
    "jump conditions and Riemann invariants of two isothermal gases in eos_ref.analytic.riemann",
    (60, 120, 240, 480),
    "1: discontinuities smeared over some spacings, in the L1 norm; n/ln n at the edges of the rarefaction, so that "
    "slopes at these resolutions are between 0.8 and 1",
    _tube,
    _tube_errors,
    quick=QUICK,
)

FLOWS = (SHOCK_TUBE,)
