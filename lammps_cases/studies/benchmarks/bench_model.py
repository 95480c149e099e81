"""Speed of the particle model against LAMMPS: the same scene, one core each, in turns."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Box, State
from lammps_cases.engine import session
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.benchmarks.bench import Ratio, against
from lammps_cases.studies.benchmarks.measure import in_turns

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


def scene(option: str, dimension: int, edge: int) -> Case:
    """Return a fluid of unit volumes, so that LAMMPS' forces are those of the reference, cutoff of 3 spacings."""
    data = {
        "dimension": dimension,
        "types": [{"mass": 1.0, "rho0": 1.0, "cs": 10.0}],
        "positions": {
            "lattice": "sq" if dimension == 2 else "sc",
            "spacing": 1.0,
            "cells": [edge] * dimension,
            "disorder": 0.1,
        },
        "pressure": [{"types": "*", "style": "linear"}],
        "rho": {"ratio": [0.99, 1.01]},
        "velocity": {"random": 0.1},
        "evolve": {"steps": 1, "timestep": 0.002},
        "compare": ["f"],
        **OPTIONS[option],
    }
    parsed = Scene.model_validate({key: value for key, value in data.items() if value is not None})
    return Case(f"bench-{option}", "", (), parsed, Path("bench"))


def simulation(case: Case, stages: Literal["compiled", "plain"] = "compiled") -> Simulation:
    """Return the reference, ready to step."""
    evaluator: Any = ArrayEvaluator
    if stages == "compiled":
        from eos_ref.compiled.evaluator import CompiledEvaluator as evaluator

    atoms = build(case, case.scene.eos())
    model, box = reference_side.model(case.scene, atoms, case.where), reference_side.box(case.scene, atoms)
    sim = Simulation(model, box, reference_side.state(case.scene, atoms, case.where), (), evaluator)
    sim.run(1, _dt(case))
    return sim


def _dt(case: Case) -> float:
    assert case.scene.evolve is not None
    return case.scene.evolve.timestep


def against_lammps(dimensions: tuple[int, ...] = (2, 3), repeats: int = 5) -> Iterator[Ratio]:
    """Yield the time per particle and step of the reference and of LAMMPS, for every option."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    lmp = session.open_lammps()
    for dimension in dimensions:
        for option in OPTIONS:
            case, steps = scene(option, dimension, EDGE[dimension]), STEPS[dimension]
            atoms = build(case, case.scene.eos())
            session.run(lmp, job(case.scene, atoms, plan(case.scene)))
            sim = simulation(case)
            yield against(
                f"{dimension}D {option}, {len(atoms):,} particles",
                "LAMMPS",
                _steps(sim, steps, _dt(case)),
                _commands(lmp, f"run {steps} pre no post no"),
                repeats,
                steps * len(atoms),
            )


def _steps(sim: Simulation, steps: int, dt: float) -> Callable[[], None]:
    return lambda: sim.run(steps, dt)


def _commands(lmp: Any, text: str) -> Callable[[], None]:
    return lambda: lmp.command(text)


def growth(edges: tuple[int, ...] = (100, 316, 1000), steps: int = 4) -> Iterator[Ratio]:
    """Yield the time per particle and step of a large scene against one of 10 000 particles."""
    small = scene("quintic", 2, edges[0])
    first = simulation(small)
    for edge in edges[1:]:
        case = scene("quintic", 2, edge)
        sim, n = simulation(case), edge * edge
        rounds = max(1, n // edges[0] ** 2)
        took = in_turns({"large": _steps(sim, steps, _dt(case)), "small": _steps(first, steps * rounds, _dt(small))}, 3)
        large, few = took["large"], took["small"]
        per_large, per_small = 1 / (steps * n), 1 / (steps * rounds * edges[0] ** 2)
        yield Ratio(
            f"2D quintic, {n:,} particles",
            f"{edges[0] ** 2:,} particles",
            large.seconds.scaled(1e9 * per_large),
            few.seconds.scaled(1e9 * per_small),
            large.against(few).scaled(per_large / per_small),
        )


def full_model_for_pressure(edge: int = 300) -> Ratio:
    """Time a scene that compares pressures alone, against all that the model could evaluate for it."""
    from eos_ref.compiled.evaluator import CompiledEvaluator

    case = scene("RK1", 2, edge)
    atoms = build(case, case.scene.eos())
    model, box = reference_side.model(case.scene, atoms, ""), reference_side.box(case.scene, atoms)
    state = reference_side.state(case.scene, atoms)
    alone = Simulation(model, box, state, ("pressure",), CompiledEvaluator)
    whole = Simulation(
        model, box, state, ("coordination", "grad/v", "pressure", "viscosity", "f", "drho"), CompiledEvaluator
    )
    n = len(atoms)
    return against(f"pressure alone, {n:,} particles", "whole model", alone.evaluate, whole.evaluate, 3, n)


def bytes_per_particle(option: str = "RK1", edge: int = 1000) -> float:
    """Return the peak memory that a million particles add to a process that has everything loaded, per particle."""
    code = f"from lammps_cases.studies.benchmarks.bench_model import grown; print(grown({option!r}, {edge}))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1]) / edge**2


def grown(option: str, edge: int) -> float:
    """Return the peak resident bytes of a simulation of ``edge`` squared particles, beyond those of a small one."""
    _lattice_simulation(option, 40)
    # A new process inherits the peak of the one that started it: count from here (Linux).
    Path("/proc/self/clear_refs").write_text("5")
    before = _peak()
    _lattice_simulation(option, edge)
    return 1024.0 * (_peak() - before)


def _peak() -> int:
    """Return the peak resident memory of this process (kB)."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def _lattice_simulation(option: str, edge: int) -> None:
    """Two steps from a state made in place: what the scene's own arrays take is not the reference's."""
    from eos_ref.compiled.evaluator import CompiledEvaluator

    case = scene(option, 2, 10)
    model = reference_side.model(case.scene, build(case, case.scene.eos()), "")
    random = np.random.default_rng(1)
    x_nc = np.stack(np.meshgrid(np.arange(edge), np.arange(edge), indexing="ij"), axis=-1).reshape(-1, 2) + 0.5
    x_nc += random.uniform(-0.1, 0.1, x_nc.shape)
    n = len(x_nc)
    state = State(
        x_nc, random.uniform(-0.1, 0.1, x_nc.shape), np.ones(n), np.ones(n, np.int32), np.zeros(n, bool), None
    )
    box = Box((0.0, 0.0), (float(edge), float(edge)), (True, True))
    Simulation(model, box, state, (), CompiledEvaluator).run(2, 0.002)
