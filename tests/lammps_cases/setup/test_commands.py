"""The exact lines that LAMMPS is given for small scenes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from syrupy.assertion import SnapshotAssertion

from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import Plan, plan

Write = Callable[..., Path]
WALL = {
    "mass": 1.0,
    "rho0": 1.5,
    "cs": 2.0,
    "phase": "solid",
    "viscosity": {"eta": 0.5, "gd0": 0.75, "K": 0.2, "n": 0.6},
}
EVERYTHING: dict[str, Any] = {
    "types": [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}, WALL],
    "compare": ["f", "grad/v"],
    "velocity": {"random": 0.3},
    "evolve": {"steps": 4, "timestep": 0.125, "compare_at": [0, 1, 4]},
    "pair": {"artificial_visc": 0.5, "rho_damp": 0.25, "harmonic_means": True},
    "rheo": {
        "kernel": "RK1",
        "cut": 2.0,
        "zmin": 3,
        "interface_reconstruct": True,
        "surface_detection": {"style": "coordination", "limit": 18, "splash": 5},
        "shift": {"exclude": ["2"], "scale_cross_type": [0.3, 0.35, 0.2]},
    },
    "pressure": [
        {"types": "1", "style": "linear"},
        {"types": "2", "style": "cubic", "A3": -1.0},
        {"types": "*", "style": "background", "P_b": 0.5},
    ],
    "forces": [
        {"style": "gravity", "vector": [0.25, -1.5]},
        {"style": "setforce", "vector": [None, 0.5], "types": "2"},
        {"style": "addforce", "vector": [1.0, 0.0], "types": "2*"},
    ],
    "engine": {"newton": False, "skin": 0.5, "every": 5, "delay": 10, "check": False},
}


def prepared(file: Path) -> PreparedCase:
    (case,) = casefile.load((file,))
    return prepared_case.prepare(case)


def job_of(file: Path, **options: bool) -> Job:
    ready = prepared(file)
    return job(ready.case.scene, ready.atoms, plan(ready.case.scene), **options)


def plan_of(file: Path) -> Plan:
    return plan(prepared(file).case.scene)


# --- commands


SCENES: dict[str, dict[str, Any]] = {
    "a law alone": {},
    "every setting": EVERYTHING,
    "summed densities and energies in an open box": {
        "dimension": 3,
        "positions": {
            "lattice": "sc",
            "spacing": 1.0,
            "cells": [3, 3, 3],
            "periodic": [True, False, True],
            "margin": 2.0,
        },
        "types": [{"mass": 2.0, "rho0": 1.2, "cs": 3.1, "T_freeze": 1.0, "latent_heat": 0.5}],
        "pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}],
        "rho": None,
        "energy": {"constant": 2.0},
        "rheo": {"rho_sum": True, "self_mass": True},
        "compare": ["rho", "temperature"],
    },
    "a box that is tilted later": {
        "compare": ["f"],
        "evolve": {"steps": 5, "timestep": 0.1, "deform": {"xy": 0.3, "remap": "v"}},
    },
    "two processes": EVERYTHING
    | {
        "engine": {
            "ranks": 2,
            "processors": [1, 2, 1],
            "communication": "tiled",
            "balance": 3,
            "sort": 0,
            "boundary": "m",
            "search": "nsq",
        },
        "positions": {"lattice": "sq", "spacing": 0.8, "cells": [5, 4], "periodic": [True, False]},
    },
}


@pytest.mark.parametrize("name", SCENES)
def test_commands_of_a_scene(case_file: Write, name: str, snapshot: SnapshotAssertion) -> None:
    given = job_of(case_file(**SCENES[name]))
    lines = [*given.setup, "", *given.commands, "", *(run.command for run in given.runs if isinstance(run, RunCommand))]
    read = f"{given.outputs} {given.atom_arrays} {list(given.per_atom)}"
    assert "\n".join([*lines, "", read]) == snapshot


def test_energy_is_of_the_whole_particle(case_file: Write) -> None:
    given = job_of(case_file(**SCENES["summed densities and energies in an open box"]))
    np.testing.assert_array_equal(given.per_atom["esph"], 2.0 * 2.0)  # not per mass


# --- runs


def test_runs_end_at_compared_steps(case_file: Write) -> None:
    runs = job_of(case_file(**EVERYTHING)).runs
    assert runs == (RunCommand("run 0 post no"), RunCommand("run 1 pre no post no"), RunCommand("run 3 pre no post no"))


def test_deformed_runs_give_start_and_stop_in_every_piece(case_file: Write) -> None:
    """fix deform works from the beginning to the end of a run, in LAMMPS' own count of steps."""
    evolve = {"steps": 5, "timestep": 0.1, "deform": {"x": 0.3, "y": -0.2}, "stops": [{"at": 2, "count": 70}]}
    given = job_of(case_file(compare=["f"], evolve=evolve))
    assert "fix deform all deform 1 x erate 0.3 y erate -0.2 remap x" in given.commands
    told = [run.command for run in given.runs if isinstance(run, RunCommand)]
    before, after = "start 0 stop 2", "start 70 stop 73"
    pieces = [("0", "", before), ("1", "pre no ", before), ("1", "pre no ", before), ("0", "", after)]
    assert told == [f"run {n} {pre}post no {ends}" for n, pre, ends in (*pieces, ("3", "pre no ", after))]


def test_first_piece_precedes_the_count_set_at_a_stop(case_file: Write) -> None:
    """LAMMPS refuses a run whose start lies after the current step."""
    evolve = {"steps": 2, "timestep": 0.1, "deform": {"x": 0.3}, "stops": [{"at": 0, "count": 7}]}
    runs = job_of(case_file(compare=["f"], evolve=evolve)).runs
    told = [run.command for run in runs if isinstance(run, RunCommand)]
    assert told == [
        *("run 0 post no start 0 stop 2", "run 0 post no start 7 stop 9"),
        *("run 1 pre no post no start 7 stop 9" for _ in range(len(told) - 2)),
    ]


def test_every_step_option_reads_each_step(case_file: Write) -> None:
    given = job_of(case_file(**EVERYTHING), every_step=True, lists=True)
    assert given.runs == (RunCommand("run 0 post no"), *[RunCommand("run 1 pre no post no")] * 4)
    assert given.lists


def test_law_is_evaluated_once_more_after_its_steps(case_file: Write) -> None:
    runs = job_of(case_file(evolve={"steps": 7, "timestep": 0.001})).runs
    assert runs == (RunCommand("run 7 post no", read=False), RunCommand("run 0 post no"))


# --- the plan


@pytest.mark.parametrize(
    ("changes", "needed"),
    [
        ({}, set()),
        ({"evolve": {"steps": 1, "timestep": 0.001}}, {"pair rheo", "fix enforce2d", "time steps"}),
        ({"rho": None, "rheo": {"rho_sum": True}}, {"pair rheo"}),
        ({"compare": ["coordination"]}, {"pair rheo"}),
    ],
)
def test_only_motion_sums_and_neighbours_need_more_commands(
    case_file: Write, changes: dict[str, Any], needed: set[str]
) -> None:
    found = {item.name for item in plan_of(case_file(**changes)).lammps if item.needed}
    assert found == needed | {"fix rheo", "fix rheo/pressure", "fix rheo/viscosity"}


def test_plan_names_dependents_of_each_quantity(case_file: Write) -> None:
    items = {item.name: item for item in plan_of(case_file(compare=["viscosity"], types=[WALL])).reference}
    assert (items["viscosity"].needed, items["viscosity"].why) == (True, "compared")
    assert items["grad/v"].needed and "for viscosity" in items["grad/v"].why
    assert (items["forces"].needed, items["forces"].why) == (False, "nothing compared depends on it")
    assert (items["time steps"].needed, items["time steps"].why) == (False, "one evaluation of the state given")


def test_unplanned_items_are_not_needed(case_file: Write) -> None:
    assert not plan_of(case_file()).needs("no such item")
