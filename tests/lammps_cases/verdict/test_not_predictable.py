"""Scenes in which LAMMPS' numbers depend on uninitialised memory, or are NaN: explained, and reported as unchecked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.engine.workers import Failure
from lammps_cases.records.run_record import CaseRecord, EngineRecord, read_run
from lammps_cases.records.yaml_files import yaml_text
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.cases import compare_case
from tests.support.outcome import Outcome

STALE, MEANS = "stale-gradient-below-zmin", "harmonic-mean-undefined"
ENGINE = EngineRecord(distribution="2025.7.22.4.0")
BLOCK: dict[str, Any] = {
    "dimension": 2,
    "types": [{"mass": 1.31, "rho0": 1.27, "cs": 6.1, "viscosity": 0.17}],
    "positions": {
        **{"lattice": "sq", "spacing": 0.9, "cells": [8, 7], "disorder": 0.15},
        **{"periodic": [False, False], "margin": 3.0},
    },
    "pressure": [{"types": 1, "style": "linear"}],
    "rho": {"ratio": [0.97, 1.04]},
    "velocity": {"random": 0.3},
    "rheo": {"cut": 2.8, "zmin": 20, "kernel": "RK1"},
    "evolve": {"timestep": 0.002, "steps": 3, "compare_at": [0, 1, 3]},
    "compare": ["coordination", "grad/v", "pressure", "f", "rho", "v", "x"],
}
PERIODIC = BLOCK | {
    "types": [BLOCK["types"][0] | {"viscosity": 0.0, "conductivity": 0.0}],
    "positions": {**{"lattice": "sq", "spacing": 0.9, "cells": [6, 5], "disorder": 0.15}},
    "energy": {"range": [0.8, 1.9]},
    "pair": {"harmonic_means": True},
    "rheo": {"cut": 2.0},
    "compare": ["coordination", "viscosity", "f", "heatflow", "rho", "v", "x"],
}


def file_of(folder: Path, scene: dict[str, Any]) -> Path:
    """Write a case file with one scene."""
    path = folder / "mine.yaml"
    path.write_text(yaml_text({"name": "mine", "about": "A scene of the tests.", "scene": scene}))
    return path


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("scene", "finding", "compared"),
    [
        (BLOCK, STALE, {"coordination", "grad/v", "f"}),
        (BLOCK | {"rheo": BLOCK["rheo"] | {"kernel": "RK2"}}, STALE, {"coordination", "grad/v", "f"}),
        (BLOCK | {"rheo": BLOCK["rheo"] | {"zmin": 60}}, STALE, {"coordination"}),
        (BLOCK | {"rheo": BLOCK["rheo"] | {"zmin": 60, "kernel": "RK2"}}, STALE, {"coordination"}),
        (PERIODIC, MEANS, {"coordination", "viscosity"}),
        (PERIODIC | {"evolve": {"timestep": 0.002, "steps": 12}}, MEANS, {"coordination", "viscosity"}),
    ],
    ids=["surface-rk1", "surface-rk2", "all-rk1", "all-rk2", "means", "means-later"],
)
def test_hardly_predictable_scenes_are_explained(
    scene: dict[str, Any], finding: str, compared: set[str], eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    """Stale memory, which varies from run to run, may also make LAMMPS lose all atoms."""
    code, _, _ = eos_ref_command("run", "--cases", file_of(tmp_path, scene), "--out", tmp_path / "out")
    (case,) = read_run(tmp_path / "out").cases
    assert (case.verdict, code) == ("explained", 0) and finding in case.findings, case.message
    if case.fields:
        said = "in steps 1 to 3, because" if scene["evolve"]["steps"] == 3 else "because"
        assert "f" in case.unchecked and said in case.message.replace("step 12,", "steps 1 to 3,")
        assert finding in case.unchecked["f"] and "inf" not in case.message
        assert compared <= {field.field for field in case.fields}


def judged(folder: Path, scene: dict[str, Any]) -> CaseRecord:
    """Judge a scene after LAMMPS has lost all its atoms."""
    (case,) = casefile.load((file_of(folder, scene),))
    ready = prepared_case.prepare(case)
    lost = Failure("refused", "ERROR: Lost atoms: original 56 current 0")
    return compare_case(ready.case, ready.eos, ready.atoms, lost, ENGINE)[0]


@pytest.mark.parametrize(("zmin", "explained_by"), [(20, [STALE]), (0, [])])
def test_stale_memory_explains_lost_atoms_only_below_zmin(zmin: int, explained_by: list[str], tmp_path: Path) -> None:
    record = judged(tmp_path, BLOCK | {"rheo": {"cut": 2.8, "zmin": zmin, "kernel": "RK1" if zmin else "quintic"}})
    assert (record.verdict, record.explained_by) == ("explained" if explained_by else "refused", explained_by)
    assert ("whose effect cannot be predicted" in record.message) == bool(explained_by)
