"""Vortices on a lattice in a periodic box, for the reference."""

from __future__ import annotations

import numpy as np

from eos_ref import EOS, EOSTable, parse_fix_rheo
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State
from lammps_cases.comparison.problem import Problem

EDGE = 32  # spacings


def vortices(mass: float = 1.0, timestep: float = 0.1, words: str = "quintic 0", speed: float = 0.05) -> Problem:
    """A square lattice in a periodic box, rho0 being 1; the time step is in units of the spacing."""
    spacing = mass**0.5
    model = Model(
        2,
        parse_fix_rheo(f"fix 1 all rheo {3 * spacing} {words}"),
        (mass,),
        EOSTable((EOS("linear"),)),
        PairRheo(3 * spacing, artificial_viscosity=1.0),
        (Viscosity("constant", 0.05 * spacing),),
    )
    x_nc = np.stack(np.meshgrid(np.arange(EDGE), np.arange(EDGE), indexing="ij"), -1).reshape(-1, 2) + 0.5
    k = 2 * np.pi / EDGE * x_nc
    v_nc = speed * np.column_stack([-np.cos(k[:, 0]) * np.sin(k[:, 1]), np.sin(k[:, 0]) * np.cos(k[:, 1])])
    n = len(x_nc)
    state = State(x_nc * spacing, v_nc, np.ones(n), np.ones(n, int), np.zeros(n, bool))
    box = Box((0.0, 0.0), (EDGE * spacing,) * 2, (True, True))
    return Problem(model, box, state, timestep * spacing, ("f",), (0,))
