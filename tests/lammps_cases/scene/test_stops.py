"""Stops of a run in a scene: their routes, valid and invalid settings, and how LAMMPS counts steps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.scene import casefile
from lammps_cases.scene.runs import AS_TEXT, FOR_EACH_ATOM, REDEFINED, ROUTES, Stop, Stretch, counted, upper_corners
from lammps_cases.scene.settings import Evolve

CaseFile = Callable[..., Path]


def test_groups_of_routes_are_subsets_of_the_routes() -> None:
    assert {*AS_TEXT, *REDEFINED, *FOR_EACH_ATOM} <= set(ROUTES)


def test_shipped_cases_cover_every_route() -> None:
    cases = [case.scene.evolve for case in casefile.load()]
    assert {stop.by for evolve in cases if evolve for stop in evolve.stops} == set(ROUTES)


def test_step_count_continues_from_the_value_set_at_a_stop() -> None:
    stops = (Stop(at=2, count=100), Stop(at=4), Stop(at=5, count=7))
    assert counted((0, 1, 2, 3, 4, 5, 6), stops) == (0, 1, 100, 101, 102, 7, 8)


@pytest.mark.parametrize(("by", "renewed"), [("run", 0), ("restart", 0), ("recreated", 2), ("redefined", 9)])
def test_number_of_recreated_atoms_by_route(by: str, renewed: int) -> None:
    assert Stop.model_validate({"at": 0, "by": by}).count_recreated_atoms(9) == renewed


def test_stretches_accumulate_in_upper_corners() -> None:
    stops = [Stop(at=1, stretch=Stretch(x=2.0)), Stop(at=3), Stop(at=4, stretch=Stretch(x=0.5, z=1.5))]
    assert upper_corners(stops, (-1.0, -1.0, 0.1), (2.0, 0.7, 2.1)) == {1: [5.0, 0.7, 2.1], 4: [2.0, 0.7, 3.1]}
    assert upper_corners([Stop(at=1, stretch=Stretch())], (0.1,) * 3, (0.3,) * 3) == {1: [0.3] * 3}


def test_stops_are_compared_unless_compare_at_is_given() -> None:
    stops = [{"at": 3}, {"at": 5}]
    assert Evolve.model_validate({"steps": 6, "timestep": 0.1, "stops": stops}).snapshots == (0, 1, 3, 5, 6)
    chosen = {"steps": 6, "timestep": 0.1, "stops": stops, "compare_at": [5, 6]}
    assert Evolve.model_validate(chosen).snapshots == (5, 6)


def test_every_restarts_at_stops_and_is_read_at_the_end() -> None:
    scene = Evolve.model_validate({"steps": 7, "timestep": 0.1, "every": 2, "stops": [{"at": 3, "by": "set"}]})
    assert [(stop.at, stop.by) for stop in scene.beginnings] == [(2, "run"), (3, "set"), (5, "run")]
    assert scene.snapshots == (7,)
    assert scene.model_copy(update={"every": None}).beginnings == scene.stops


@pytest.mark.parametrize(
    ("evolve", "scene", "rule"),
    [
        ({"stops": [{"at": 2}, {"at": 1}]}, {}, r"must increase and lie within 0 to steps \(4\), found \[2, 1\]"),
        ({"stops": [{"at": 5}]}, {}, r"found \[5\]"),
        ({"every": 2, "compare_at": [0, 4]}, {}, r"read at the last step alone \(4\), found \[0, 4\]"),
        ({"every": 2}, {"twin": {"split": True}}, "twin.split goes without evolve.every"),
        ({}, {"compare": ["press"], "twin": {"boost": [0.1, 0.0]}}, "press has a kinetic part"),
        ({"stops": [{"at": 1}]}, {"compare": ["pressure"]}, "more in compare than pressure"),
        ({"stops": [{"at": 1, "by": "set"}]}, {"engine": {"ranks": 2}}, "set needs all atoms on one rank"),
        ({"stops": [{"at": 1, "displace": {"z": 0.5}}]}, {}, r"displace.z must be 0 in 2D, found 0.5"),
        ({"stops": [{"at": 1, "displace": {"x": 0.5, "types": 3}}]}, {}, "must lie within the atom types 1 to 1"),
        ({"stops": [{"at": 1, "stretch": {"z": 1.5}}]}, {}, r"stretch.z must be 1 in 2D, found 1.5"),
        ({"stops": [{"at": 1, "stretch": {"x": 2.5}}]}, {}, "stretch.x: must be at most 2.0, found 2.5"),
        (
            {"stops": [{"at": 1, "stretch": {"x": 1.5}}]},
            {"positions": {"lattice": "sq", "spacing": 1.0, "cells": [6, 6], "tilt": [0.5]}},
            "stretch needs a box without tilt",
        ),
        (
            {"stops": [{"at": 1, "stretch": {"x": 1.5}}]},
            {"engine": {"boundary": "fs"}},
            "stretch needs faces that are periodic or fixed, found boundary fs",
        ),
        (
            {"stops": [{"at": 1, "by": "restart", "stretch": {"x": 1.5}}]},
            {"mass": {"range": [0.9, 1.4]}},
            "stretch needs another stop than a restart with per-particle masses",
        ),
        ({"stops": [{"at": 1}]}, {"twin": {"skin": 0.7}}, "stops go with no twin"),
        (
            {"stops": [{"at": 1, "by": "replaced"}]},
            {"rheo": {"rho_sum": True}},
            "with neither interface_reconstruct nor",
        ),
        (
            {"stops": [{"at": 1, "by": "replaced"}]},
            {"types": [{"mass": 1.2}], "pressure": [{"types": "*", "style": "linear"}]},
            "replaced needs rho0 and cs",
        ),
        (
            {"stops": [{"at": 1, "by": "by hand"}, {"at": 2, "stretch": {"x": 1.5}}]},
            {},
            "a box that is upright and stays",
        ),
        ({"stops": [{"at": 1, "by": "by hand"}]}, {"engine": {"ranks": 2}}, "by hand needs all atoms on one rank"),
        ({"stops": [{"at": 1, "by": "dt/reset"}]}, {}, "dt/reset needs the time step that it sets"),
        ({"stops": [{"at": 1, "by": "continued", "displace": {"x": 0.5}}]}, {}, "continued goes with neither displace"),
        ({"stops": [{"at": 1, "by": "continued"}], "every": 2, "compare_at": [4]}, {}, "with neither every nor deform"),
        ({"stops": [{"at": 1, "by": "continued"}], "deform": {}}, {}, "with neither every nor deform, found one at 1"),
        (
            {"stops": [{"at": 1, "by": "dt/reset", "timestep": 0.1}, {"at": 2, "timestep": 0.2}]},
            {},
            r"dt/reset keeps its time step to the end, found \[0.1, 0.2\]",
        ),
        (
            {"stops": [{"at": 1, "by": "dt/reset", "timestep": 0.1}, {"at": 2, "count": 7}]},
            {},
            "dt/reset goes with no count",
        ),
        ({"deform": {"x": -200.0}}, {}, r"deform must leave every run a box: .* is -.* of an edge"),
        ({"deform": {"z": 0.5}}, {}, r"deform.z must be 0 in 2D, found 0.5"),
        ({"deform": {}, "every": 2, "compare_at": [4]}, {}, "deform goes without every, .* of their own: 2"),
        ({"deform": {}}, {"compare": ["pressure"]}, "deform compares fields of the whole model"),
        ({"deform": {}}, {"engine": {"boundary": "fs"}}, "deform needs faces that are periodic or fixed"),
        ({"deform": {}, "stops": [{"at": 1, "by": "data"}]}, {}, "neither stretch nor a stop by data, found one at 1"),
        ({"deform": {}, "stops": [{"at": 2, "stretch": {}}]}, {}, "neither stretch nor a stop by data, found one at 2"),
        ({"deform": {"yz": 0.5}}, {}, r"deform.xz and deform.yz must be 0 in 2D, found 0.0 and 0.5"),
        (
            {"deform": {"xy": 0.5}},
            {"positions": {"lattice": "sq", "spacing": 1.0, "cells": [6, 6], "periodic": [False, True]}},
            "deform: xy, xz and yz must be 0 but between periodic axes",
        ),
        ({"deform": {"remap": "v"}}, {"rheo": {"shift": True}}, "remap v goes without shift"),
        ({"deform": {"remap": "v"}}, {"compare": ["f", "press"]}, "press has a kinetic part"),
        ({"deform": {"remap": "v"}}, {"compare": ["v"]}, "compare v needs compare x, which tells the image"),
        ({"deform": {"remap": "v"}, "stops": [{"at": 2}]}, {}, "remap v goes without stops, found one at 2"),
        ({"deform": {}}, {"twin": {"boost": [0.1, 0.0]}}, "is another one under twin.boost"),
    ],
)
def test_invalid_stops_are_refused(
    case_file: CaseFile, evolve: dict[str, Any], scene: dict[str, Any], rule: str
) -> None:
    base = {"compare": ["f"], "evolve": {"steps": 4, "timestep": 0.004} | evolve}
    with pytest.raises(InputError, match=rule):
        casefile.load((case_file(**(base | scene)),))
