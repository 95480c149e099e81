"""Speed of the particle model against LAMMPS: the same scene, one core each, in turns."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import eos_ref.jit  # noqa: F401  chooses the registers before anything is compiled
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.state import State
from lammps_cases.engine.session import Session
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.chart.bench import Ratio, against
from lammps_cases.studies.flows.flow import rows

OPTIONS: dict[str, dict[str, Any]] = {
    "quintic": {},
    "shift": {"rheo": {"shift": True}},
    "RK1": {"rheo": {"kernel": "RK1"}},
    "RK2": {"rheo": {"kernel": "RK2"}},
    "rho/sum": {"rheo": {"rho_sum": True}, "rho": None},
    "thermal": {"energy": {"range": [0.9, 1.1]}},
}
EDGE = {2: 200, 3: 31}  # particles along an edge: 40 000 and 29 791
STEPS = {2: 10, 3: 4}
TIMESTEP = 0.002


def scene(option: str, dimension: int, edge: int) -> Case:
    """Return a fluid of unit volumes, so that LAMMPS' forces are those of the reference, cutoff of 3 spacings."""
    lattice = "sq" if dimension == 2 else "sc"
    data = {
        "dimension": dimension,
        "types": [{"mass": 1.0, "rho0": 1.0, "cs": 10.0}],
        "positions": {"lattice": lattice, "spacing": 1.0, "cells": [edge] * dimension, "disorder": 0.1},
        "pressure": [{"types": "*", "style": "linear"}],
        "rho": {"ratio": [0.99, 1.01]},
        "velocity": {"random": 0.1},
        "evolve": {"steps": 1, "timestep": TIMESTEP},
        "compare": ["f"],
        **OPTIONS[option],
    }
    parsed = Scene.model_validate({key: value for key, value in data.items() if value is not None})
    return Case(f"bench-{option}", "", (), parsed, Path("bench"))


def simulation(case: Case, fields: Sequence[str] = ()) -> Simulation:
    """Return the compiled reference at the start of a case."""
    return reference_side.simulation(case.scene, build(case, case.scene.eos()), fields, case.where)


def against_lammps(dimensions: tuple[int, ...] = (2, 3), repeats: int = 5) -> Iterator[Ratio]:
    """Yield the time per particle and step of the reference and of LAMMPS, for every option."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    session = Session()
    for dimension in dimensions:
        for option in OPTIONS:
            case, steps = scene(option, dimension, EDGE[dimension]), STEPS[dimension]
            atoms = build(case, case.scene.eos())
            session.run(job(case.scene, atoms, plan(case.scene)))
            yield against(
                f"{dimension}D {option}, {len(atoms):,} particles",
                "LAMMPS",
                partial(simulation(case).run, steps, TIMESTEP),
                partial(session.advance, steps),
                repeats,
                steps * len(atoms),
            )


# --- memory


def bytes_per_particle(option: str = "RK1", edge: int = 1000) -> float:
    """Return the peak memory that a million particles add to a process that has everything loaded, per particle."""
    code = f"from lammps_cases.studies.chart.bench_model import grown; print(grown({option!r}, {edge}))"
    process = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return float(process.stdout.split()[-1]) / edge**2


def grown(option: str, edge: int) -> float:
    """Return the peak resident bytes of a simulation of ``edge`` squared particles, beyond those of a small one."""
    _run_lattice(option, 40)
    # A new process inherits the peak of the one that started it: count from here (Linux).
    Path("/proc/self/clear_refs").write_text("5")
    before = _peak()
    _run_lattice(option, edge)
    return 1024.0 * (_peak() - before)


def _peak() -> int:
    """Return the peak resident memory of this process (kB)."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def _run_lattice(option: str, edge: int) -> None:
    """Run two steps from a state made here, so that the arrays of a scene do not count."""
    from eos_ref.compiled.evaluator import CompiledEvaluator

    random, x_nc = np.random.default_rng(1), rows(0, edge, edge)
    x_nc += random.uniform(-0.1, 0.1, x_nc.shape)
    v_nc, n = random.uniform(-0.1, 0.1, x_nc.shape), len(x_nc)
    state = State(x_nc, v_nc, np.ones(n), np.ones(n, np.int32), np.zeros(n, bool), None)
    box = Box((0.0, 0.0), (float(edge), float(edge)), (True, True))
    Simulation(simulation(scene(option, 2, 10)).model, box, state, (), CompiledEvaluator).run(2, TIMESTEP)
