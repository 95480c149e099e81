"""Scenes of the whole particle model: input and output of real LAMMPS, on one rank and on two."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.trajectory import predict
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.case_arrays import snapshot
from lammps_cases.verdict.model_fields import nearest_image
from lammps_cases.verdict.problems import problem_of
from tests.support.outcome import Solver

pytestmark = pytest.mark.lammps

FLUID = {"mass": 1.3, "rho0": 1.3, "cs": 10.0, "viscosity": 0.2}
WALL = {
    "mass": 0.8,
    "rho0": 0.9,
    "cs": 8.0,
    "phase": "solid",
    "viscosity": {"eta": 0.1, "gd0": 0.02, "K": 0.3, "n": 0.9},
}
COMMON = ["pressure", "rho", "coordination", "grad/v", "viscosity", "stress/v", "stress/t", "phase", "status"]
STATE = ["x", "v", "f", "drho", "pressure_used"]
SURFACE = ["surface", "surface/r", "surface/n", "surface/divr"]
HEAT = ["temperature", "heatflow", "energy", "conductivity", "cv"]
BASE: dict[str, Any] = {
    "dimension": 2,
    "types": [FLUID, WALL],
    "positions": {
        "lattice": "sq",
        "spacing": 1.0,
        "cells": [12, 12],
        "disorder": 0.1,
        "regions": [{"type": 2, "low": [0, 0], "high": [1, 0.25]}],
    },
    "pressure": [{"types": 1, "style": "linear"}, {"types": 2, "style": "tait/water"}],
    "rho": {"ratio": [0.98, 1.03]},
    "velocity": {"random": 0.1, "uniform": [0.05, 0.0]},
    "forces": [{"style": "gravity", "vector": [0.3, -1.7]}, {"style": "setforce", "vector": [0.0, None], "types": 2}],
    "pair": {"artificial_visc": 0.5, "rho_damp": 0.1, "harmonic_means": True},
    "evolve": {"steps": 12, "timestep": 0.005},
    "compare": [*COMMON, *STATE],
}
SCENES: dict[str, dict[str, Any]] = {
    "plain": {},
    "everything": {
        "rheo": {
            "interface_reconstruct": True,
            "surface_detection": {"style": "divergence", "limit": 1.6, "splash": 10},
            "shift": True,
        },
        "compare": [*COMMON, *STATE, *SURFACE, "chi", "shift/v"],
    },
    "open": {
        "positions": BASE["positions"]
        | {
            "periodic": [True, False],
            "regions": [
                {"type": 2, "low": [0, 0], "high": [1, 0.25]},
                {"type": None, "low": [0, 0.7], "high": [1, 1]},
            ],
        },
        "rheo": {
            "kernel": "RK1",
            "zmin": 8,
            "surface_detection": {"style": "coordination", "limit": 20, "splash": 4},
            "shift": {"exclude": 2, "scale_cross_type": [0.3, 0.05, 0.05]},
        },
        "compare": [*COMMON, *STATE, *SURFACE, "shift/v"],
    },
    "heat": {
        "types": [
            FLUID | {"conductivity": 0.7, "specific_heat": 1.5, "latent_heat": 0.2, "T_freeze": 0.6},
            WALL | {"specific_heat": 1.2},
        ],
        "energy": {"range": [0.8, 1.3]},
        "compare": [*COMMON, *STATE, *HEAT],
    },
    "solid-3d": {
        "dimension": 3,
        "positions": {
            "lattice": "sc",
            "spacing": 1.0,
            "cells": [7, 7, 8],
            "disorder": 0.1,
            "regions": [{"type": 2, "low": [0, 0, 0], "high": [1, 1, 0.375]}],
        },
        "types": [FLUID, WALL | {"velocity": [0.1, 0.0, -0.2]}],
        "velocity": {"random": 0.1},
        "forces": [{"style": "addforce", "vector": [0.1, 0.2, 0.3]}],
        "rheo": {"kernel": "RK2", "zmin": 20, "interface_reconstruct": True, "rho_sum": True},
        "rho": None,
        "compare": [*COMMON, *STATE, "chi"],
    },
    "static": {"evolve": None, "rheo": {"shift": True}, "compare": ["f", "grad/v", "shift/v"]},
}
VECTORS, TENSORS = ("surface/n", "shift/v"), ("grad/v", "stress/v", "stress/t")

Make = Callable[..., Case]
Told = tuple[prepared_case.PreparedCase, Job]


@pytest.fixture
def make(case_file: Callable[..., Path]) -> Make:
    """Return a case of `SCENES` with changes."""

    def case(name: str, **changes: Any) -> Case:
        (made,) = casefile.load_file(case_file(**{**BASE, **SCENES[name], **changes}))
        return made

    return case


def tell(case: Case, every_step: bool = False) -> Told:
    ready = prepared_case.prepare(case)
    return ready, job(case.scene, ready.atoms, plan(case.scene), every_step)


@pytest.mark.parametrize("name", SCENES)
def test_every_field_is_read_for_every_atom_at_every_step(name: str, make: Make, solver: Solver) -> None:
    case = make(name)
    ready, told = tell(case)
    answer, d, n = solver(told), case.scene.dimension, len(ready.atoms)
    assert answer.steps == case.scene.snapshots == ((0,) if name == "static" else (0, 1, 10, 12))
    for arrays in answer.snapshots:
        assert np.array_equal(arrays["id"], ready.atoms.id_n)
        for field in case.scene.compare:
            array = arrays[{"pressure_used": "pressure"}.get(field, field) if field in STATE else f"q.{field}"]
            shape = (3,) if field in ("x", "v", "f") else (d,) * (field in VECTORS) + (d, d) * (field in TENSORS)
            assert array.shape == (n, *shape), field
            assert np.isfinite(array).all(), field
    first = answer.snapshots[0]
    assert np.array_equal(first["x"], ready.atoms.x_nc), "the doubles of the scene"
    if ready.atoms.rho_n is not None and not case.scene.rheo.interface_reconstruct:
        assert np.array_equal(first["rho"], ready.atoms.rho_n)
    assert not any(np.shares_memory(first["x"], arrays["x"]) for arrays in answer.snapshots[1:])


def test_tensor_components_are_in_the_order_of_their_names(make: Make, solver: Solver) -> None:
    """The gradient of a linear velocity field away from edges, within the rounding bound of a reproducing kernel."""
    case = make("static", rheo={"kernel": "RK1"}, compare=["grad/v"], rho={"constant": 1.3})
    ready, told = tell(case)
    slope_cc = np.array([[0.1, 0.2], [0.3, -0.4]])
    v_nc = np.zeros((len(ready.atoms), 3))
    v_nc[:, :2] = ready.atoms.x_nc[:, :2] @ slope_cc.T
    got = solver(replace(told, v_nc=v_nc)).arrays
    middle_n = (np.abs(ready.atoms.x_nc[:, :2] - 6) < 2.5).all(axis=1)
    assert middle_n.any()
    given = problem_of(case.scene, ready.atoms, case.where, (0,))
    state = replace(given.state, v_nc=v_nc[:, :2])
    sim = Simulation(given.model, given.box, state, ("grad/v",))
    sim.setup()
    # The velocities are rounded products; their distance from the linear field is within the bound of one evaluation.
    bound_ncc = 2 * sim.rounded().output("grad/v").error
    assert np.all(np.abs(got["q.grad/v"] - slope_cc)[middle_n] <= bound_ncc[middle_n])


def test_halting_does_not_change_the_run(make: Make, solver: Solver) -> None:
    halted = solver(tell(make("everything"))[1])
    whole = solver(tell(make("everything", evolve=BASE["evolve"] | {"compare_at": [12]}))[1])
    stepped = solver(tell(make("everything"), every_step=True)[1])
    assert stepped.steps == tuple(range(13))
    for other in (whole, stepped):
        assert all(np.array_equal(halted.arrays[name], other.arrays[name]) for name in halted.arrays)
    for step, arrays in zip(halted.steps, halted.snapshots, strict=True):
        assert all(np.array_equal(arrays[name], stepped.snapshots[step][name]) for name in arrays)


@pytest.mark.parametrize("name", ["plain", "everything", "heat", "solid-3d"])
def test_two_ranks_agree_with_one(name: str, make: Make, solver: Solver) -> None:
    """Each lies within the reference's bound of the exact result, so they are at most two bounds apart."""
    case = make(name)
    one, two = (solver(tell(make(name, engine={"ranks": ranks}))[1]) for ranks in (1, 2))
    assert one.steps == two.steps
    scene = problem_of(case.scene, tell(case)[0].atoms, case.where, one.steps)
    bounds = predict(scene).bounds
    for at, (here, there) in enumerate(zip(one.snapshots, two.snapshots, strict=True)):
        assert here.keys() == there.keys()
        ours, theirs = (snapshot(case.scene, arrays) for arrays in (here, there))
        for field in set(scene.fields) - {"status"}:  # its layer bit follows the order of neighbours
            other = nearest_image(scene.box, theirs[field], ours[field]) if field == "x" else theirs[field]
            assert np.all(np.abs(other - ours[field]) <= 2 * bounds[at][field]), (field, one.steps[at])


def test_faults_of_ranks_affect_only_their_case(make: Make, workers: Workers, solver: Solver) -> None:
    told = tell(make("plain", engine={"ranks": 2}))[1]
    faults = {
        "no_such_command": ("refused", "Unknown command: no_such_command"),
        "quit 7": ("crashed", "LAMMPS on several ranks ended with code 7"),
    }
    for command, (verdict, message) in faults.items():
        got = workers.outcome(workers.submit(replace(told, runs=(RunCommand(command),)), 60.0))
        assert isinstance(got, Failure) and got.verdict == verdict
        assert message in got.message
    endless = replace(told, runs=(RunCommand("run 100000000 post no"),))
    got = workers.outcome(workers.submit(endless, 4.0))
    assert isinstance(got, Failure) and got.verdict == "timeout"
    assert solver(told).steps == (0, 1, 10, 12)
    end = time.monotonic() + 10
    while _ranks_left() and time.monotonic() < end:
        time.sleep(0.2)
    assert not _ranks_left(), "processes of a run that timed out live on"


def _ranks_left() -> list[str]:
    """Return ranks whose last argument, the worker that started them, no longer exists."""
    processes = subprocess.run(["ps", "axww", "-o", "args"], capture_output=True, text=True, check=True).stdout
    ranks = [line.split() for line in processes.splitlines() if "-m lammps_cases.engine.ranks" in line]
    return [" ".join(words) for words in ranks if not Path(f"/proc/{words[-1]}").exists()]


def test_reference_has_the_same_doubles(make: Make, solver: Solver) -> None:
    for name in ("everything", "heat", "solid-3d", "open"):
        case = make(name)
        ready, told = tell(case)
        state = reference_side.state(case.scene, ready.atoms, case.where)
        model, box = (
            reference_side.model(case.scene, ready.atoms, case.where),
            reference_side.box(case.scene, ready.atoms),
        )
        got, d = solver(told).snapshots[0], case.scene.dimension
        assert np.array_equal(state.x_nc, got["x"][:, :d])
        assert np.array_equal(state.v_nc, got["v"][:, :d])
        assert np.array_equal(state.solid_n, got["q.phase"] == 1)
        assert np.array_equal(state.type_n, got["type"])
        assert box.periodic == ready.atoms.periodic[:d]
        assert model.cut == 3.0
        if name == "heat":
            assert np.array_equal(state.energy_n, got["esph"])
            assert model.thermal is not None
            conductivity_t = np.array([t.conductivity for t in model.thermal])
            assert np.array_equal(conductivity_t[state.type_n - 1], got["q.conductivity"])
        if name == "solid-3d":
            assert np.array_equal(state.rho_n, np.where(state.solid_n, 0.9, 1.3))


def test_force_of_gravity_is_exact(make: Make, solver: Solver) -> None:
    """A particle alone feels mass times the scene's vector, to the last bit."""
    lonely = {"lattice": "sq", "spacing": 4.0, "cells": [4, 4]}
    case = make(
        "plain",
        types=[FLUID],
        pressure=[{"types": 1, "style": "linear"}],
        positions=lonely,
        rheo={"cut": 3.0},
        forces=[{"style": "gravity", "vector": [0.3, -1.7]}],
        evolve=None,
    )
    force_nc = solver(tell(case)[1]).arrays["f"]
    assert np.array_equal(force_nc, np.broadcast_to([1.3 * 0.3, 1.3 * -1.7, 0.0], force_nc.shape))


def test_velocities(make: Make) -> None:
    atoms = prepared_case.prepare(make("plain")).atoms
    assert atoms.v_nc is not None
    wall = atoms.type_n == 2
    assert np.array_equal(np.unique(atoms.v_nc[wall], axis=0), [[0.05, 0.0, 0.0]])
    assert np.ptp(atoms.v_nc[~wall, 0]) > 0.15
    moving = prepared_case.prepare(make("plain", types=[FLUID, WALL | {"velocity": [0.3, 0.0]}])).atoms
    assert moving.v_nc is not None
    assert np.array_equal(np.unique(moving.v_nc[wall], axis=0), [[0.3, 0.0, 0.0]])
    assert np.array_equal(moving.v_nc[~wall], atoms.v_nc[~wall])
