"""A case must detect the changes of the reference that it names; otherwise the case is in error."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from eos_ref import InputError
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.store import Store
from lammps_cases.records import case_wording
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict import exercise
from lammps_cases.verdict.exercise import count_outside
from lammps_cases.verdict.mistakes import changes
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
    """Write a case file that names the changes its cases must detect."""

    def write(exercises: dict[str, list[str]], **changes: Any) -> Path:
        path = case_file(**{**BLOCK, **changes})
        data = yaml.safe_load(path.read_text()) | {"exercises": exercises}
        path.write_text(yaml.safe_dump(data))
        return path

    return write


def exercised(case: Case, predictor: Predictor, names: tuple[str, ...] = ()) -> dict[str, int]:
    ready = prepared_case.prepare(case)
    return exercise.exercised(case, ready.eos, ready.atoms, predictor, names or case.exercises)


def test_affected_particles_are_counted_and_the_count_is_stored(written: Callable[..., Path], tmp_path: Path) -> None:
    """Every particle has at least five neighbours, so none is a splash."""
    vacuum = {**BLOCK["positions"], **VACUUM}
    names = ["surface-never-by-coordination", "splash-never-by-coordination", "surface-never-by-divergence"]
    (case,) = casefile.load_file(written({"*": names}, positions=vacuum))
    kept = Predictor(Store(tmp_path / "store", "context"))
    moved = exercised(case, kept)
    assert list(moved) == names and list(moved.values()) == [moved[names[0]], 0, 0] and moved[names[0]] > 4
    again = Predictor(Store(tmp_path / "store", "context"))
    assert exercised(case, again) == moved and (again.computed, again.stored) == (0, 1)


def test_laws_are_changed_for_states_of_any_sign(case_file: Write) -> None:
    (case,) = casefile.load_file(case_file(pressure=CUBE, rho={"ratio": [-1.4, 1.4]}))
    names = (
        "tait-not-over-gamma",
        "lint-sign-of-the-pressure",
        "water-of-six",
        "lint-masses-ignored",
        "slope-sign",
    )
    assert list(exercised(case, Predictor(), names).values()) == [20, 20, 0, 0, 0]


def test_unbounded_and_nan_particles_are_no_evidence() -> None:
    """This holds for an infinite bound and for NaN in the reference; NaN caused by the change is evidence."""
    reference, bound = np.array([1.0, np.nan, 1.0, 1.0]), np.array([0.1, 0.1, np.inf, 0.1])
    assert count_outside([(np.array([9.0, 9.0, 9.0, np.nan]), reference, bound)]) == 2
    assert count_outside([(5.0, 1.0, 0.1), (np.ones(6), np.zeros(6), np.full(6, 0.5))]) == 6, "global values"


@pytest.mark.lammps
def test_undetected_change_is_an_error_of_the_case(
    written: Callable[..., Path], eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    path = written({"*": ["surface-everywhere", "surface-never-by-divergence"]})
    outcome = eos_ref_command("run", "--cases", path, "--out", tmp_path / "out")
    assert outcome.code == 2
    (line,) = re.findall(r"error +mine: (.*)", outcome.out)
    assert line.startswith("no field that the case compares shows surface-never-by-divergence")
    page = unpacked((tmp_path / "out" / "report.html").read_text())
    assert "54 particles" in page and "all fluid at the surface" in page


def test_exit_code_of_a_bad_case_precedes_that_of_a_difference() -> None:
    bad = CaseRecord(case="a", verdict="error", dimension=3, exercises={"self-value": 0, "slope-sign": 7})
    differs = CaseRecord(case="b", verdict="differs", exercises={"self-value": 0})
    assert bad.unexercised == ["self-value"]
    assert case_wording.message(bad) == "no field that the case compares shows self-value, which it names in exercises"
    assert RunRecord(engine=EngineRecord(), reference={}, cases=[differs, bad]).exit_code() == 2
    assert RunRecord(engine=EngineRecord(), reference={}, cases=[differs]).exit_code() == 1, "what it compares is wrong"


def test_unknown_labels_and_changes_are_refused(written: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match=r"no such change: 'surfaces-never' \(did you mean 'surface-never'\?\)"):
        casefile.load_file(written({"*": ["surfaces-never"]}))
    with pytest.raises(InputError, match=r"exercises: a pattern must be of labels .* found 'rk1'"):
        casefile.load_file(written({"rk1": ["slope-sign"]}))


def test_patterns_select_cases_by_their_labels(case_file: Write) -> None:
    axes = {"1": {"quintic": {}, "rk1": {}}, "2": {"2d": {}, "same": {}}}
    path = case_file(matrix=axes)
    named = {"*": ["slope-sign"], "rk1.*": ["self-value"], "*.same": ["rho0-of-one", "self-value"]}
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"exercises": named}))
    assert {case.name: case.exercises for case in casefile.load_file(path)} == {
        "mine.quintic.2d": ("slope-sign",),
        "mine.quintic.same": ("slope-sign", "rho0-of-one", "self-value"),
        "mine.rk1.2d": ("slope-sign", "self-value"),
        "mine.rk1.same": ("slope-sign", "rho0-of-one", "self-value"),
    }


def test_comparison_reuses_the_prediction() -> None:
    """The bounds that a change must exceed are computed once per case."""
    (case,) = casefile.select(casefile.load(), ("forces.all.rk1.2d",))
    predictor = Predictor()
    assert 0 not in exercised(case, predictor).values()
    computed = predictor.computed
    atoms = prepared_case.prepare(case).atoms
    problem = problem_of(case.scene, atoms, case.where, case.scene.snapshots, predictor)
    predictor.predict(problem, seed=seed(f"{case.name}/moved runs"))
    assert predictor.computed == computed


def test_changed_search_finds_its_own_neighbours() -> None:
    """The runs of a case share neighbours; those of the prediction have all images."""
    (case,) = casefile.select(casefile.load(), ("boundaries.fixed.3d",))
    assert exercised(case, Predictor(), ("pairs-first-image",)) == {"pairs-first-image": 36}


@pytest.mark.slow
def test_all_changes_are_tried_whose_functions_a_run_goes_through() -> None:
    """Of the whole catalogue only those are left out that one by one move nothing."""
    (case,) = casefile.select(casefile.load(), ("images.quintic.two",))
    every = exercised(case, Predictor(), tuple(changes()))
    names = [name for name, moved in every.items() if not moved and changes()[name].function][::20]
    assert names and not any(exercised(case, Predictor(), tuple(names)).values())
    assert len(names) <= exercise.FEW and sum(map(bool, every.values())) > len(case.exercises)


def test_change_that_fails_is_not_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mistake in the catalogue, such as a name that the function does not have, is no evidence."""
    wrong = replace(changes()["slope-sign"], id="slope-unknown", by="no_such_name")
    monkeypatch.setitem(changes(), wrong.id, wrong)
    (case,) = casefile.select(casefile.load(), ("images.quintic.two",))
    assert exercised(case, Predictor(), ("slope-sign", wrong.id))[wrong.id] == 0
