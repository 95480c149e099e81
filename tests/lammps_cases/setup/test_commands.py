"""The exact lines that LAMMPS is given for small scenes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
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


def test_scene_of_a_law_has_the_minimal_commands(case_file: Write) -> None:
    given = job_of(case_file())
    assert given.setup == (
        "units lj",
        "dimension 2",
        "atom_style rheo",
        "boundary p p p",
        "neighbor 0.24 bin",
        "neigh_modify binsize 2.4000000000000004",
        "region box block 0.0 4.0 0.0 3.2 -0.4 0.4",
        "create_box 1 box",
    )
    assert given.commands == (
        "mass 1 1.31",
        "fix rheo all rheo 2.4000000000000004 quintic 0 density 1.2 speed/sound 3.1",
        "fix viscosity all rheo/viscosity * constant 0.1",
        "fix pressure all rheo/pressure * tait/general 2.3",
        "compute q all rheo/property/atom pressure",
    )
    assert given.runs == (RunCommand("run 0 post no"),)
    assert (given.outputs, list(given.per_atom)) == ({"pressure": ()}, ["rho"])


def test_every_setting_appears_in_the_commands(case_file: Write) -> None:
    given = job_of(case_file(**EVERYTHING))
    assert given.setup == (
        "units lj",
        "dimension 2",
        "atom_style rheo",
        "newton off off",
        "boundary p p p",
        "comm_modify vel yes",
        "neighbor 0.4 bin",
        "neigh_modify every 5 delay 10 check no",
        "region box block 0.0 4.0 0.0 3.2 -0.4 0.4",
        "create_box 2 box",
    )
    assert given.commands == (
        "mass 1 1.31",
        "mass 2 1.0",
        "set type 2 rheo/status 1",
        "pair_style rheo 2.0 artificial/visc 0.5 rho/damp 0.25 harmonic/means",
        "pair_coeff * *",
        "timestep 0.125",
        "fix rheo all rheo 2.0 RK1 3 interface/reconstruct surface/detection coordination 18 5 "
        "shift exclude/type 2 scale/cross/type 0.3 0.35 0.2 density 1.2 1.5 speed/sound 3.1 2.0",
        "fix viscosity all rheo/viscosity 1 constant 0.1 2 power 0.5 0.75 0.2 0.6",
        "fix pressure all rheo/pressure 1 linear 2 cubic -1.0 * background 0.5",
        "fix force1_1 all gravity 0.25 vector 1 0 0",
        "fix force1_2 all gravity 1.5 vector 0 -1 0",
        "group types_2 type 2",
        "fix force2_1 types_2 setforce NULL 0.5 0.0",
        "fix force3_1 types_2 addforce 1.0 0.0 0.0",
        "fix flat all enforce2d",
        "compute q all rheo/property/atom grad/v/*",
    )
    assert given.outputs == {"grad/v": (2, 2)}
    assert given.atom_arrays == ("type", "x", "v", "rho", "pressure", "f")


def test_summed_densities_and_energies_in_an_open_box(case_file: Write) -> None:
    given = job_of(
        case_file(
            dimension=3,
            positions={
                "lattice": "sc",
                "spacing": 1.0,
                "cells": [3, 3, 3],
                "periodic": [True, False, True],
                "margin": 2.0,
            },
            types=[{"mass": 2.0, "rho0": 1.2, "cs": 3.1, "T_freeze": 1.0, "latent_heat": 0.5}],
            pressure=[{"types": "*", "style": "ideal/gas", "gamma": 1.4}],
            rho=None,
            energy={"constant": 2.0},
            rheo={"rho_sum": True, "self_mass": True},
            compare=["rho", "temperature"],
        )
    )
    assert "atom_style rheo/thermal" in given.setup
    assert "boundary p f p" in given.setup
    assert "region box block 0.0 3.0 -2.0 5.0 0.0 3.0" in given.setup
    assert "fix rheo all rheo 3.0 quintic 0 thermal rho/sum self/mass density 1.2 speed/sound 3.1" in given.commands
    assert (
        "fix thermal all rheo/thermal conductivity * constant 0.1 specific/heat * constant 1.0 "
        "Tfreeze * constant 1.0 latent/heat * constant 0.5" in given.commands
    )
    assert "fix flat all enforce2d" not in given.commands
    assert list(given.per_atom) == ["esph"]
    np.testing.assert_array_equal(given.per_atom["esph"], 2.0 * 2.0)  # of the whole particle, not per mass


@pytest.mark.parametrize(
    ("violation", "gone", "come"),
    [
        ("no-fix-pressure-read", "fix pressure all rheo/pressure * tait/general 2.3", None),
        ("rheo-group", None, "group some id 1"),
        ("missing-argument", None, "fix pressure all rheo/pressure * tait/general"),
        ("unknown-pressure-style", None, "fix pressure all rheo/pressure * taitwater 2.3"),
    ],
)
def test_violation_changes_its_line_alone(case_file: Write, violation: str, gone: str | None, come: str) -> None:
    right = job_of(case_file()).commands
    wrong = job_of(case_file(violate=violation, expect={"refused": "some words"})).commands
    if gone:
        assert set(right) - set(wrong) == {gone}
    if come:
        assert come in set(wrong) - set(right)
    assert len(set(right) ^ set(wrong)) <= 3


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


def test_box_that_is_tilted_later_is_created_as_a_prism(case_file: Write) -> None:
    evolve = {"steps": 5, "timestep": 0.1, "deform": {"xy": 0.3, "remap": "v"}}
    given = job_of(case_file(compare=["f"], evolve=evolve))
    assert "fix deform all deform 1 x erate 0.0 y erate 0.0 xy erate 0.3 remap v" in given.commands
    assert "box tilt large" in given.setup and any(line.endswith(" 0.0 0.0 0.0") for line in given.setup)


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


def test_decomposition_settings_appear_in_the_commands(case_file: Write) -> None:
    engine = {"ranks": 2, "processors": [1, 2, 1], "communication": "tiled", "balance": 3, "sort": 0, "boundary": "m"}
    open_box = {"lattice": "sq", "spacing": 0.8, "cells": [5, 4], "periodic": [True, False]}
    given = job_of(case_file(**EVERYTHING | {"engine": engine | {"search": "nsq"}, "positions": open_box}))
    for line in ("boundary p m p", "processors 1 2 1", "atom_modify sort 0 0.0", "comm_style tiled"):
        assert given.setup.count(line) == 1, line
    assert any(line.startswith("neighbor ") and line.endswith(" nsq") for line in given.setup)
    assert given.commands[-2:] == ("balance 1.0 rcb", "fix balance all balance 3 1.0 rcb")


@pytest.mark.parametrize(
    ("engine", "rule"),
    [
        ({"processors": [2, 1, 1]}, r"processors must be as many as ranks \(1\), found \[2, 1, 1\]"),
        ({"balance": 2}, r"balance \(style rcb\) needs communication tiled, found brick"),
    ],
)
def test_inconsistent_decomposition_is_refused(case_file: Write, engine: dict[str, object], rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        casefile.load_file(case_file(engine=engine))
