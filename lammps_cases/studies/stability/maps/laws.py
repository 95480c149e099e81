"""Every equation of state over its parameters and density: where it has no value, no speed of sound, or a wrong sign.

A cell is one particle without neighbours, to which the law is applied once. rho0 and cs are not 1, so that wrong
factors show.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability.model import Axis, FailureCriteria, MapCell, StabilityMap, Theory

RHO0, CS = 1.2, 3.1
STIFFNESS = CS * CS * RHO0  # the natural unit of pressure
_SIDE = 8.0  # of the box


def alone(name: str, law: dict[str, Any], rho: float, e: float | None = None, background: float = 0.0) -> Start:
    """Return one particle of a law at a density and, for a gas, an energy per mass."""
    laws = [{"types": "*", **law}]
    if background:
        laws.append({"types": "*", "style": "background", "P_b": background})
    scene = Scene.model_validate(
        {
            "dimension": 2,
            "types": [{"mass": RHO0, "rho0": RHO0, "cs": CS}],
            "positions": {"lattice": "sq", "spacing": 1.0, "cells": (1, 1)},
            "pressure": laws,
            "rho": {"constant": rho},
            "energy": None if e is None else {"constant": e},
        }
    )
    atoms = Atoms(
        id_n=np.array([1]),
        type_n=np.array([1]),
        x_nc=np.array([[_SIDE / 2, _SIDE / 2, 0.0]]),
        mass_n=np.array([RHO0]),
        low_c=np.array([0.0, 0.0, -0.5]),
        high_c=np.array([_SIDE, _SIDE, 0.5]),
        periodic=(True, True, True),
        spacing=1.0,
        rho_n=np.array([rho]),
        energy_n=None if e is None else np.array([RHO0 * e]),
    )
    return Start(Case(name, "", (), scene, Path("stability")), atoms, (0,), 0.0)


def _tait(gamma: float) -> dict[str, Any]:
    return {"style": "tait/general", "gamma": gamma}


def _overflow(gamma: float) -> float:
    r"""Return the decades of compression at which :math:`(\rho/\rho_0)^\gamma` or the pressure overflows."""
    largest = math.log10(sys.float_info.max)
    return min(largest, largest - math.log10(STIFFNESS / gamma)) / gamma


OVERFLOW = StabilityMap(
    id="laws-tait-overflow",
    title="Tait's law at large densities",
    about="Pressures beyond the largest double, against the exponent. x: decades of rho/rho0.",
    x=Axis("log10(rho/rho0)", 0.02, 200.0, 0.02, log=True),
    y=Axis("gamma", 2.0, 4000.0, 0.1, log=True),
    lines=(2.3, 7.0, 60.0, 4000.0),
    start=lambda cell: alone("tait-overflow", _tait(cell.y), RHO0 * 10.0**cell.x),
    theory=(Theory("largest double", _overflow),),
    tags=("quick",),
)


def _zero(gamma: float) -> float:
    """Return rho/rho0 below which Tait's law has no real value, or falls; NaN without such a limit."""
    return math.nan if gamma > 0 and gamma % 2 == 1 else 0.0


NEGATIVE = StabilityMap(
    id="laws-tait-negative",
    title="Tait's law at negative densities",
    about="A negative density to a power that is not whole is no real number; an even power falls with density.",
    x=Axis("rho/rho0", -1.0, 1.3, 0.02),
    y=Axis("gamma", -2.0, 8.0, 0.1),
    lines=(-1.5, 1.4, 2.3, 4.0, 7.0),
    start=lambda cell: alone("tait-negative", _tait(cell.y), RHO0 * cell.x),
    watch=lambda cell: FailureCriteria(hyperbolic=True),
    theory=(Theory("real and rising", _zero),),
    tags=("quick",),
    quick_lines=(2.3, 4.0),
)


def _cubic(cell: MapCell) -> Start:
    sign = -1.0 if cell.layer == "stretched" else 1.0
    law = {"style": "cubic", "A3": -cell.y / RHO0**2}
    return alone(f"cubic-{cell.layer}", law, RHO0 * (1 + sign * cell.x))


CUBIC = StabilityMap(
    id="laws-cubic",
    title="Cubic law with a negative prefactor",
    about="Beyond the spinodal the pressure falls as the density rises; under compression it turns negative at last. "
    "x: distance from rho0. The slope is the reference's at the engine's density, the sign that of the engine's own "
    "pressure.",
    x=Axis("|rho - rho0|/rho0", 0.03, 6.0, 0.02, log=True),
    y=Axis("-A3 rho0^2", 0.1, 30.0, 0.1, log=True),
    lines=(0.1, 0.4, 1.6, 25.6),
    start=_cubic,
    watch=lambda cell: FailureCriteria(pressure=True) if cell.layer == "sign" else FailureCriteria(hyperbolic=True),
    layers=("compressed", "stretched", "sign"),
    theory=(
        Theory("spinodal", lambda y: 1 / math.sqrt(3 * y), "compressed"),
        Theory("spinodal", lambda y: 1 / math.sqrt(3 * y), "stretched"),
        Theory("P = 0", lambda y: 1 / math.sqrt(y), "sign"),
    ),
    tags=("quick",),
)

GAS = StabilityMap(
    id="laws-gas-gamma",
    title="Ideal gas: heat capacity ratio",
    about="At gamma = 1 a gas has no pressure, below it one that pulls. The reference refuses both.",
    x=Axis("gamma", -0.6, 2.2, 0.01),
    y=Axis("energy per mass", -1.0, 2.0, 0.1),
    lines=(-1.0, 0.5, 2.0),
    start=lambda cell: alone("gas-gamma", {"style": "ideal/gas", "gamma": cell.x}, RHO0, cell.y),
    watch=lambda cell: FailureCriteria(pressure=True, hyperbolic=True),
    theory=(Theory("gamma = 1", lambda y: 1.0),),
    tags=("quick",),
)

ENERGY = StabilityMap(
    id="laws-gas-energy",
    title="Ideal gas: energy",
    about="A gas of negative energy pulls, and has no sound.",
    x=Axis("energy per mass", -1.0, 1.3, 0.01),
    y=Axis("gamma", 1.0, 2.0, 0.1),
    lines=(1.05, 1.4, 5 / 3),
    start=lambda cell: alone("gas-energy", {"style": "ideal/gas", "gamma": cell.y}, RHO0, cell.x),
    watch=lambda cell: FailureCriteria(pressure=True, hyperbolic=True),
    theory=(Theory("e = 0", lambda y: 0.0),),
)

DIGITS = 8  # decimal digits of the pressure that must remain


def _limit(ratio: float) -> float:
    r"""Return the exponent below which :math:`[(\rho/\rho_0)^\gamma-1]/\gamma` keeps fewer digits.

    The power is :math:`1+\gamma\ln(\rho/\rho_0)`, its rounding at most 2^-53.
    """
    return 2.0**-53 * 10.0**DIGITS / math.log(ratio)


LIMIT = StabilityMap(
    id="laws-gamma-0",
    title="Tait's law as its exponent vanishes",
    about="The law tends to P = c^2 rho0 ln(rho/rho0), but a power near 1 less 1 keeps few digits.",
    x=Axis("gamma", 1e-18, 1.0, 0.25, log=True),
    y=Axis("rho/rho0", 1.001, 10.0, 0.1, log=True),
    lines=(1.01, 1.3, 4.0),
    start=lambda cell: alone("gamma-0", _tait(cell.x), RHO0 * cell.y),
    watch=lambda cell: FailureCriteria(digits=DIGITS),
    engines_differ="LAMMPS evaluates the power as printed, which loses the digits that gamma has below 1",
    theory=(Theory(f"{DIGITS} digits left", _limit),),
    tags=("quick",),
    quick_lines=(1.3,),
)


BACKGROUND = StabilityMap(
    id="laws-background",
    title="Background pressure of either sign",
    about="How large a background must be to keep the pressure positive at a density.",
    x=Axis("P_b/(c^2 rho0)", -1.0, 1.1, 0.01),
    y=Axis("rho/rho0", 0.5, 1.3, 0.1),
    lines=(0.8, 0.95, 1.05, 1.2),
    start=lambda cell: alone(
        f"background-{cell.layer}", {"style": cell.layer}, RHO0 * cell.y, background=STIFFNESS * cell.x
    ),
    watch=lambda cell: FailureCriteria(pressure=True),
    layers=("linear", "tait/water"),
    theory=(Theory("P = 0", lambda y: 1 - y, "linear"), Theory("P = 0", lambda y: (1 - y**7) / 7, "tait/water")),
    tags=("quick",),
)

MAPS = (OVERFLOW, NEGATIVE, CUBIC, GAS, ENERGY, LIMIT, BACKGROUND)
