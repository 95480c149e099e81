"""Particles of a chart on either engine: a periodic, disordered lattice in 2D, in the reference and in LAMMPS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.time_step import Simulation
from eos_ref.kernels.styles import KernelStyle
from lammps_cases.engine.session import Answer, Session
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

STILL = 1e-12  # time step in which no particle moves enough to matter


@dataclass(frozen=True)
class LatticeSetup:
    """Particles of one kernel and cutoff, for either engine."""

    case: Case
    atoms: Atoms

    def simulation(self, fields: Sequence[str]) -> Simulation:
        """Return the compiled reference, evaluated once."""
        from eos_ref.compiled.evaluator import CompiledEvaluator

        scene, where = self.case.scene, self.case.where
        sim = reference_side.simulation(scene, self.atoms, fields, where, evaluator=CompiledEvaluator)
        sim.evaluate()
        return sim

    def started(self, session: Session) -> Answer:
        """Run the scene in LAMMPS, which keeps it, and return its answer."""
        scene = self.case.scene
        return session.run(job(scene, self.atoms, plan(scene)))


def prepared(
    kernel: KernelStyle, cut: float, disorder: float, edge: int, rho_sum: bool = False, **more: Any
) -> LatticeSetup:
    """Return unit masses on a disordered square lattice of unit spacing, at rest; ``more`` are keys of a scene."""
    data = {
        "dimension": 2,
        "types": [{"mass": 1.0, "rho0": 1.0, "cs": 1.0, "viscosity": 0.0}],
        "positions": {"lattice": "sq", "spacing": 1.0, "cells": [edge, edge], "disorder": disorder},
        "pressure": [{"types": "*", "style": "linear"}],
        "rheo": {"kernel": kernel, "cut": cut, "rho_sum": rho_sum},
        "rho": None if rho_sum else {"constant": 1.0},
        "velocity": {"uniform": [0.0, 0.0]},
        "evolve": {"steps": 1, "timestep": STILL, "compare_at": [0, 1]},
        "compare": ["rho"] if rho_sum else ["grad/v"],
        **more,
    }
    # One name for all: the same particles for every kernel and cutoff.
    case = Case("chart-kernels", "", (), Scene.model_validate(data), Path("chart"))
    return LatticeSetup(case, build(case, case.scene.eos()))


def moving(setup: LatticeSetup, v_nc: FloatArray) -> LatticeSetup:
    """Return the same particles with velocities (n, 2)."""
    return replace(setup, atoms=replace(setup.atoms, v_nc=np.hstack([v_nc, np.zeros((len(v_nc), 1))])))


def worst(error_n: FloatArray, scale_n: FloatArray) -> float:
    """Return the largest error over the root mean square of its scale."""
    return float(np.max(np.abs(error_n)) / np.sqrt(np.mean(np.square(scale_n))))


def still_step(session: Session) -> Callable[[], object]:
    """Return a call that takes a step of LAMMPS in which nothing moves."""
    session.open().command(f"timestep {STILL!r}")
    return partial(session.advance, 1)


def opened(session: Session | None, stack: ExitStack) -> Session | None:
    """Return one more LAMMPS, closed with the stack, so that all methods can be timed in turns; None without LAMMPS."""
    return session and stack.enter_context(closing(Session(session.site)))
