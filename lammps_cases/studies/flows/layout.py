"""Particles of a flow, laid by hand: a scene with positions, velocities and densities of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, IntArray
from lammps_cases.scene.casefile import Case
from lammps_cases.studies.flows.flow import Body, Options, Start


def rows(first: int, last: int, width: int) -> FloatArray:
    """Return the square lattice of unit spacing, ``width`` columns from x = 0 on; row k lies at y = k + 1/2."""
    x_nn, y_nn = np.meshgrid(np.arange(width) + 0.5, np.arange(first, last) + 0.5)
    return np.stack([x_nn.ravel(), y_nn.ravel()], axis=1)


def fluid(**values: float | str) -> dict[str, float | str]:
    """Return the keys of an atom type of mass, density and speed of sound 1, but for the values given."""
    return {"mass": 1.0, "rho0": 1.0, "cs": 1.0, **values}


def under(background: float) -> list[dict[str, Any]]:
    """Return the entries of the linear equation of state under a background pressure."""
    return [{"types": "*", "style": "linear"}, {"types": "*", "style": "background", "P_b": background}]


def forces(held: str = "2", gravity: tuple[float, float] | None = None) -> list[dict[str, Any]]:
    """Return the gravity of a scene, if it has one, and the force 0 that holds the solids of some types."""
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
    low_c: Sequence[float] = (0.0, 0.0),
    *,
    options: Options,
    times: Sequence[float],
    timestep: float,
    type_n: IntArray | None = None,
    v_nc: FloatArray | None = None,
    rho_n: FloatArray | None = None,
    e_n: FloatArray | None = None,
    periodic: tuple[bool, bool] = (True, True),
    body: Body | None = None,
) -> Start:
    """Return the start of a flow in the plane, particles at unit spacing more or less.

    Parameters
    ----------
    name : str
        Of the case.
    scene : mapping
        Keys of a scene: types, and pressure (default: linear), forces, pair, rheo beyond the options.
    x_nc, v_nc : (n, 2)
        Positions, velocities (default: at rest).
    low_c, high_c, periodic : two each
        The box.
    times : sequence of float
        When fields are read, increasing. The first falls on a step, the others on the nearest one.
    timestep : float
        Longest step.
    type_n, rho_n, e_n : (n,)
        Types (default 1), densities (default: those of equilibrium; none where they are summed), energies per mass.
    body : Body, optional
        A force that depends on place or temperature.
    """
    n = len(x_nc)
    dt = times[0] / math.ceil(times[0] / timestep)
    steps = tuple(round(t / dt) for t in times)
    parsed = _scene(scene, options, steps, dt, with_energy=e_n is not None)
    types_n = np.ones(n, int) if type_n is None else type_n
    mass_n = np.array([t.mass for t in parsed.types])[types_n - 1]
    rho0_n = np.array(parsed.rho0 or (1.0,) * len(parsed.types))[types_n - 1]
    flat_n1 = np.zeros((n, 1))
    atoms = Atoms(
        id_n=np.arange(1, n + 1),
        type_n=types_n,
        x_nc=np.hstack([x_nc, flat_n1]),
        mass_n=mass_n,
        low_c=np.array([*low_c, -0.5]),
        high_c=np.array([*high_c, 0.5]),
        periodic=(*periodic, True),
        spacing=1.0,
        v_nc=np.zeros((n, 3)) if v_nc is None else np.hstack([v_nc, flat_n1]),
        rho_n=None if options.rho_sum else rho0_n if rho_n is None else rho_n,
        energy_n=None if e_n is None else mass_n * e_n,
    )
    return Start(Case(name, "", (), parsed, Path("flows")), atoms, steps, dt, body)


def _scene(
    scene: Mapping[str, Any], options: Options, steps: tuple[int, ...], timestep: float, with_energy: bool
) -> Scene:
    """Return the scene of a flow, but for its particles."""
    rheo = {"kernel": options.kernel, "cut": options.cut, "zmin": options.zmin, "rho_sum": options.rho_sum}
    return Scene.model_validate(
        {
            "dimension": 2,
            "positions": {"lattice": "sq", "spacing": 1.0, "cells": (1, 1)},  # a scene must have some
            "pressure": ({"types": "*", "style": "linear"},),
            "rho": None if options.rho_sum else {"ratio": (1.0, 1.0)},
            "energy": {"constant": 1.0} if with_energy else None,
            "evolve": {"steps": steps[-1], "timestep": timestep, "compare_at": steps},
            "compare": ("x", "v", "rho", "pressure", *(["energy"] if with_energy else [])),
            **scene,
            "rheo": {**rheo, **scene.get("rheo", {})},
        }
    )
