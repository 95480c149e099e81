r"""A flow at its start: scene and particles, and what is read of them later.

All flows have particles at spacing 1 with mass rho0, so that volumes are 1, at explicit positions (`start`); the box
grows with the resolution N (particles per wavelength, height or diameter). Viscosity and time grow with N as well:
Reynolds and Mach numbers are constant, and only the spacing in units of the flow changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KernelStyle
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, IntArray
from lammps_cases.scene.casefile import Case


@dataclass(frozen=True)
class Options:
    """Options of the solution of a flow.

    Attributes
    ----------
    kernel, zmin, rho_sum : arguments of fix rheo
    cut : cutoff of the kernel (spacings)
    dt_fraction : time step over the flow's own limit of stability, `lammps_cases.studies.flows.flow.time_step`
    extra : further options, listed in ``about`` of each flow
    """

    kernel: KernelStyle = "quintic"
    cut: float = 3.0
    rho_sum: bool = False
    dt_fraction: float = 1.0
    zmin: int = 0
    extra: Mapping[str, float | str] = field(default_factory=dict)

    def number(self, name: str, default: float) -> float:
        """Return a further option that is a number.

        Raises
        ------
        InputError
        """
        value = self.extra.get(name, default)
        if isinstance(value, str):
            raise InputError(f"option {name}", "must be a number", value)
        return float(value)

    def word(self, name: str, default: str) -> str:
        """Return a further option that is a word."""
        return str(self.extra.get(name, default))


@dataclass(frozen=True)
class Body:
    """A force on every fluid particle that depends on its position or temperature.

    Attributes
    ----------
    formulas : its components for LAMMPS, as formulas of atom-style variables; the temperature is c_warm
    force : the same for the reference, (n, d), of masses (n,), positions (n, d) and, if any, temperatures (n,)
    warm : whether it depends on the temperature
    """

    formulas: tuple[str, str]
    force: Callable[[FloatArray, FloatArray, FloatArray | None], FloatArray]
    warm: bool = False


@dataclass(frozen=True)
class Start:
    """A flow at time 0: the scene, its particles, the steps at which fields are read, the length of a step.

    Attributes
    ----------
    steps : (0,) for a flow that is only evaluated
    held : types of particles whose energy stays (fix add/heat constant 0, overwrite)
    """

    case: Case
    atoms: Atoms
    steps: tuple[int, ...]
    timestep: float
    body: Body | None = None
    held: tuple[int, ...] = ()


@dataclass(frozen=True)
class Snapshot:
    """Particles after a step, by id.

    Attributes
    ----------
    x_nc, v_nc : (n, d)
        Positions in any periodic image, velocities.
    rho_n, pressure_n : (n,)
    energy_n, temperature_n : (n,), optional
        Energy of the whole particle, and the same over m cv.
    surface_n : (n,), optional
        Class of the field ``surface``: 0 bulk, 1 surface, 2 splash.
    fields : other fields that the scene compares, by name
    """

    step: int
    x_nc: FloatArray
    v_nc: FloatArray
    rho_n: FloatArray
    pressure_n: FloatArray
    energy_n: FloatArray | None = None
    surface_n: FloatArray | None = None
    time: float = 0.0
    temperature_n: FloatArray | None = None
    fields: Mapping[str, FloatArray] = field(default_factory=dict)


ALWAYS = ("x", "v", "rho", "pressure")  # fields of every flow


def relative(error_n: FloatArray, scale_n: FloatArray) -> float:
    """Return the root mean square of an error over that of its scale."""
    return float(np.sqrt(np.mean(np.square(error_n)) / np.mean(np.square(scale_n))))


def rows(first: int, last: int, width: int) -> FloatArray:
    """Return the square lattice of unit spacing, ``width`` columns from x = 0 on; row k lies at y = k + 1/2."""
    x_nn, y_nn = np.meshgrid(np.arange(width) + 0.5, np.arange(first, last) + 0.5)
    return np.stack([x_nn.ravel(), y_nn.ravel()], axis=1)


def fluid(**values: float | str) -> dict[str, float | str]:
    """Return the keys of an atom type: mass, density and speed of sound are 1 unless given."""
    return {"mass": 1.0, "rho0": 1.0, "cs": 1.0, **values}


def under(background: float) -> list[dict[str, Any]]:
    """Return the entries of the linear equation of state with a background pressure."""
    return [{"types": "*", "style": "linear"}, {"types": "*", "style": "background", "P_b": background}]


def forces(held: str = "2", gravity: tuple[float, float] | None = None) -> list[dict[str, Any]]:
    """Return the gravity of a scene, if any, and the force 0 that holds the solids of some types."""
    pull = [] if gravity is None else [{"style": "gravity", "vector": gravity}]
    return [*pull, {"style": "setforce", "vector": (0.0, 0.0), "types": held}]


def smooth(options: Options, artificial: float, damping: float, sound: float) -> dict[str, float]:
    """Return the pair terms that keep a flow smooth: artificial viscosity, and density diffusion given over h c."""
    return {"artificial_visc": artificial, "rho_damp": damping * options.cut / 3 * sound}


def time_step(options: Options, speed: float, nu: float = 0.0) -> float:
    r"""Return the longest stable step, :math:`f\min(h/4(c+U),\,h^2/8\nu)`; h = cut/3, f the fraction of the options.

    Source: Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997).

    Parameters
    ----------
    speed : float
        Speed of sound plus that of the flow.
    nu : float
        Largest diffusivity: kinematic viscosity, conductivity/(rho cv).
    """
    h = options.cut / 3
    return options.dt_fraction * min(0.25 * h / speed, 0.125 * h**2 / nu if nu else math.inf)


def start(
    name: str,
    scene: Mapping[str, Any],
    x_nc: FloatArray,
    high_c: Sequence[float],
    low_c: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    options: Options,
    times: Sequence[float],
    timestep: float,
    type_n: IntArray | None = None,
    v_nc: FloatArray | None = None,
    rho_n: FloatArray | None = None,
    e_n: FloatArray | None = None,
    periodic: tuple[bool, ...] = (True, True, True),
    body: Body | None = None,
    held: tuple[int, ...] = (),
) -> Start:
    """Return the start of a flow, particles at about unit spacing.

    Parameters
    ----------
    name : str
        Of the case.
    scene : mapping
        Keys of a scene: types, and pressure (default: linear), forces, pair, rheo beyond the options.
    x_nc, v_nc : (n, d)
        Positions in the plane or in space, velocities (default: at rest).
    low_c, high_c, periodic : one for each axis
        The box.
    times : sequence of float
        When fields are read, increasing. The first falls on a step, the others on the nearest one. None: no step.
    timestep : float
        Longest step.
    type_n, rho_n, e_n : (n,)
        Types (default 1), densities (default: those of equilibrium; none where they are summed), energies per mass.
    body : Body, optional
        A force that depends on place or temperature.
    """
    n, d = x_nc.shape
    dt = times[0] / math.ceil(times[0] / timestep) if times else timestep
    steps = tuple(round(t / dt) for t in times) or (0,)
    parsed = _scene({"dimension": d, **scene}, options, steps, dt, with_energy=e_n is not None)
    types_n = np.ones(n, int) if type_n is None else type_n
    mass_n = np.array([t.mass for t in parsed.types])[types_n - 1]
    rho0_n = np.array(parsed.rho0 or (1.0,) * len(parsed.types))[types_n - 1]
    plane = (np.zeros((n, 1)),) * (3 - d)  # the third axis of a flow in the plane
    first, second, third = (*periodic[:d], True)[:3]
    atoms = Atoms(
        id_n=np.arange(1, n + 1),
        type_n=types_n,
        x_nc=np.hstack([x_nc, *plane]),
        mass_n=mass_n,
        low_c=np.array([*low_c[:d], -0.5][:3]),
        high_c=np.array([*high_c[:d], 0.5][:3]),
        periodic=(first, second, third),
        spacing=1.0,
        v_nc=np.zeros((n, 3)) if v_nc is None else np.hstack([v_nc, *plane]),
        rho_n=None if options.rho_sum else rho0_n if rho_n is None else rho_n,
        energy_n=None if e_n is None else mass_n * e_n,
    )
    return Start(Case(name, "", (), parsed, Path("flows")), atoms, steps, dt, body, held)


def _scene(
    scene: Mapping[str, Any], options: Options, steps: tuple[int, ...], timestep: float, with_energy: bool
) -> Scene:
    """Return the scene of a flow without its particles."""
    rheo = {"kernel": options.kernel, "cut": options.cut, "zmin": options.zmin, "rho_sum": options.rho_sum}
    d = scene["dimension"]
    return Scene.model_validate(
        {
            "positions": {"lattice": "sq" if d == 2 else "sc", "spacing": 1.0, "cells": (1,) * d},  # it must have some
            "pressure": ({"types": "*", "style": "linear"},),
            "rho": None if options.rho_sum else {"ratio": (1.0, 1.0)},
            "energy": {"constant": 1.0} if with_energy else None,
            "evolve": {"steps": steps[-1], "timestep": timestep, "compare_at": steps} if any(steps) else None,
            **scene,
            "compare": tuple(dict.fromkeys((*ALWAYS, *["energy"] * with_energy, *scene.get("compare", ())))),
            "rheo": {**rheo, **scene.get("rheo", {})},
        }
    )
