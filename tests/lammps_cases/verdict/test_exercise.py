"""A case that does not do what it says it is for is an error of the case; what it does is counted."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from eos_ref import InputError
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.store import Store
from lammps_cases.records import wording
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict import problems
from lammps_cases.verdict.problems import problem_of
from tests.support.outcome import Outcome
from tests.support.pages import unpacked

Write = Callable[..., Path]
BLOCK: dict[str, Any] = {
    "positions": {"lattice": "sq", "spacing": 0.9, "cells": [9, 6], "disorder": 0.1},
    "pressure": [{"types": "*", "style": "linear"}],
    "rheo": {"surface_detection": {"style": "coordination", "limit": 16, "splash": 5}},
    "compare": ["surface", "surface/n"],
}
CUBE = [{"types": "*", "style": "tait/general", "gamma": 3}]
VACUUM = {"regions": [{"type": None, "low": [0.5, 0], "high": [1, 1]}]}


@pytest.fixture
def written(case_file: Write) -> Callable[..., Path]:
    """Write a case file that says what its cases are for."""

    def write(exercises: dict[str, list[str]], **changes: Any) -> Path:
        path = case_file(**{**BLOCK, **changes})
        data = yaml.safe_load(path.read_text()) | {"exercises": exercises}
        path.write_text(yaml.safe_dump(data))
        return path

    return write


def test_what_a_case_names_is_counted_and_kept(written: Callable[..., Path], tmp_path: Path) -> None:
    vacuum = {**BLOCK["positions"], **VACUUM}
    (case,) = casefile.load_file(written({"*": ["surface-normal", "splash-by-coordination"]}, positions=vacuum))
    ready = prepared_case.prepare(case)
    named = problems.exercised(case, ready.atoms, Predictor())
    assert list(named) == ["surface-normal", "splash-by-coordination"]
    assert named["surface-normal"] > 4 and named["splash-by-coordination"] == 0
    every = problems.counts(case, ready.atoms, Predictor())
    assert every["surface-normal"] == named["surface-normal"] and 0 not in every.values()
    kept = Predictor(Store(tmp_path / "store", "context"))
    assert problems.counts(case, ready.atoms, kept) == every and kept.computed == 1
    again = Predictor(Store(tmp_path / "store", "context"))
    assert problems.counts(case, ready.atoms, again) == every and again.stored == 1


def test_a_law_has_states_of_any_sign(case_file: Write) -> None:
    (case,) = casefile.load_file(case_file(pressure=CUBE, rho={"ratio": [-1.4, 1.4]}))
    counts = problems.counts(case, prepared_case.prepare(case).atoms, Predictor())
    assert (counts["law-tait-general"], counts["field/pressure"]) == (20, 20)
    assert "images" not in counts, "nobody asks for neighbours"


@pytest.mark.lammps
def test_a_case_that_does_not_do_what_it_says_is_an_error_of_the_case(
    written: Callable[..., Path], eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    path = written({"*": ["surface-normal", "surface-bulk"]})
    outcome = eos_ref_command("run", "--cases", path, "--out", tmp_path / "out")
    assert outcome.code == 2
    (line,) = re.findall(r"error +mine: (.*)", outcome.out)
    assert line.startswith("the case says it exercises surface-normal, but nothing in its 2D scene does")
    page = unpacked((tmp_path / "out" / "report.html").read_text())
    assert "54 particles" in page and "Fluid that is not at the surface is bulk." in page


def test_the_exit_code_of_a_bad_case_goes_before_that_of_a_difference() -> None:
    bad = CaseRecord(case="a", verdict="error", dimension=3, exercises={"layer": 0, "shift": 7})
    differs = CaseRecord(case="b", verdict="differs", exercises={"layer": 0})
    assert bad.unexercised == ["layer"]
    assert wording.message(bad) == "the case says it exercises layer, but nothing in its 3D scene does"
    assert RunRecord(engine=EngineRecord(), reference={}, cases=[differs, bad]).exit_code() == 2
    assert RunRecord(engine=EngineRecord(), reference={}, cases=[differs]).exit_code() == 1, "what it compares is wrong"


def test_patterns_are_of_labels_and_rules_of_the_reference(written: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match=r"no such rule: 'surface-normals' \(did you mean 'surface-normal'\?\)"):
        casefile.load_file(written({"*": ["surface-normals"]}))
    with pytest.raises(InputError, match=r"exercises: a pattern must be of labels .* found 'rk1'"):
        casefile.load_file(written({"rk1": ["shift"]}))


def test_patterns_pick_cases_by_their_labels(case_file: Write) -> None:
    axes = {"1": {"quintic": {}, "rk1": {}}, "2": {"2d": {}, "same": {}}}
    path = case_file(matrix=axes)
    named = {"*": ["law-tait-general"], "rk1.*": ["above-rho0"], "*.same": ["rho0", "above-rho0"]}
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"exercises": named}))
    assert {case.name: case.exercises for case in casefile.load_file(path)} == {
        "mine.quintic.2d": ("law-tait-general",),
        "mine.quintic.same": ("law-tait-general", "rho0", "above-rho0"),
        "mine.rk1.2d": ("law-tait-general", "above-rho0"),
        "mine.rk1.same": ("law-tait-general", "rho0", "above-rho0"),
    }


@pytest.mark.parametrize("name", ["forces.all.rk1.2d", "walls.stored.gravity", "runs.thermal.anew"])
def test_the_run_whose_rules_are_counted_is_that_of_the_prediction(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (case,) = casefile.select(casefile.load(), (name,))
    atoms, run = prepared_case.prepare(case).atoms, list[str]()
    problem = problem_of(case.scene, atoms, case.where, case.scene.snapshots)
    alone = Predictor().predict(problem, seed=1)
    setup = Simulation.setup

    def counted(sim: Simulation) -> None:
        run.append(type(sim).__name__ + type(sim.state.x_nc).__name__)
        setup(sim)

    monkeypatch.setattr(Simulation, "setup", counted)
    predictor = Predictor()
    assert problems.counts(case, atoms, predictor)
    begun = run.count("Simulationndarray")
    shared = predictor.predict(problem, seed=1)
    assert run.count("Simulationndarray") == begun > 0
    for ours, theirs in ((shared.fields, alone.fields), (shared.bounds, alone.bounds)):
        for one, other in zip(ours, theirs, strict=True):
            assert all(np.array_equal(one[f], other[f], equal_nan=True) for f in problem.fields)
