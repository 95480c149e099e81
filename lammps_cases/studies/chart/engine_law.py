"""Real LAMMPS as one more way to evaluate a law: any number of states, one per atom."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import EOS
from eos_ref.eos.table import FloatArray
from lammps_cases.engine import session
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.materials import entries
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan


class EngineLaw:
    """A law as LAMMPS evaluates it.

    Parameters
    ----------
    lmp : a living instance, see `lammps_cases.engine.session.open_lammps`
    law : EOS
    """

    def __init__(self, lmp: Any, law: EOS) -> None:
        self.lmp, self.law = lmp, law

    def pressure(self, rho_n: FloatArray, e_n: FloatArray | None = None) -> FloatArray:
        """Return pressures (n,) that LAMMPS puts out for densities and energies."""
        scene, atoms = self._scene(len(rho_n), rho_n, e_n)
        answer = session.run(self.lmp, job(scene, atoms, plan(scene)))
        return np.asarray(answer.arrays["q.pressure"][: len(rho_n)])

    def timed(self, rho_n: FloatArray, e_n: FloatArray | None = None) -> tuple[Callable[[], None], Callable[[], None]]:
        """Return two calls to be timed: the output of all pressures, and that of as many numbers that need no law.

        A new count of steps makes LAMMPS evaluate an output anew; the difference of the two is the law alone.
        """
        self.pressure(rho_n, e_n)
        self.lmp.command("compute copied all rheo/property/atom phase")

        def output(name: str) -> None:
            self.lmp.command(f"reset_timestep {int(self.lmp.extract_global('ntimestep')) + 1}")
            self.lmp.extract_compute(name, 1, 1)

        return lambda: output("q"), lambda: output("copied")

    def _scene(self, n: int, rho_n: FloatArray, e_n: FloatArray | None) -> tuple[Scene, Atoms]:
        law, edge = self.law, math.ceil(math.sqrt(n))
        data = {
            "dimension": 2,
            "types": [{"mass": 1.0, "rho0": law.rho0, "cs": law.cs}],
            "positions": {"lattice": "sq", "spacing": 1.0, "cells": [edge, edge]},
            "pressure": entries(law),
            "rho": {"constant": law.rho0},
            **({} if e_n is None else {"energy": {"constant": 1.0}}),
        }
        scene = Scene.model_validate(data)
        atoms = build(Case("states", "", (), scene, Path("states")), scene.eos())
        all_rho_n, all_e_n = np.full(len(atoms), law.rho0), np.ones(len(atoms))
        all_rho_n[:n] = rho_n
        if e_n is not None:
            all_e_n[:n] = e_n
        return scene, replace(atoms, rho_n=all_rho_n, energy_n=None if e_n is None else all_e_n)
