"""Random scenes against real LAMMPS: red ones are kept so that they can be run alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lammps_cases import findings
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import ModelFinding
from lammps_cases.records.case_parts import Beyond, Blame
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from tests.support.small_scene import small_scene
from tests.workshop.fuzz import hunt
from tests.workshop.fuzz.__main__ import main
from tests.workshop.fuzz.draw import draw
from tests.workshop.fuzz.hunt import is_lost, is_unbounded, known_gap, loses


@pytest.mark.lammps
def test_red_scene_is_kept_as_a_case_and_can_be_drawn_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    judged = hunt.record_of

    def faulty(drawn: Any, outcome: Any, engine: Any) -> CaseRecord:
        blame = Blame(field="f", stage="pair", step=0, atom=1, lammps=1.0, reference=2.0, bound=1e-9, outside=1, of=1)
        found = judged(drawn, outcome, engine)
        return found.model_copy(update={"verdict": "differs", "blame": blame}) if found.verdict == "exact" else found

    monkeypatch.setattr(hunt, "record_of", faulty)
    scenes = ((k, draw(3, k).case.scene) for k in range(200))
    number = next(k for k, scene in scenes if scene.compare == ("pressure",) and scene.engine == type(scene.engine)())
    code = main(["--seed", "3", "--draw", str(number), "--jobs", "1", "--out", str(tmp_path)])
    record = json.loads((tmp_path / "fuzz.json").read_text())
    assert (code, record["drawn"], record["verdicts"]) == (1, 1, {"differs": 1})
    (red,) = record["red"]
    assert (red["draw"], red["failure"]) == (number, "differs in f (stage pair)")
    assert "must be red" in red["note"] and not red["small"]  # the fault is not in LAMMPS, so it disappears
    (case,) = casefile.load((Path(red["file"]),))
    assert case.scene == draw(3, number).case.scene
    assert red["reproduce"] == f"eos-ref run --cases {red['file']} drawn-3-{number}"


def test_gaps_belong_to_findings_of_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = (draw(1, k).case.scene for k in range(200))
    scene = next(one for one in drawn if one.rheo.kernel == "RK1" and one.rheo.zmin and not one.pair.harmonic_means)
    (entry,) = (entry for entry in LEDGER if entry.id == "stale-gradient-below-zmin")
    monkeypatch.setattr(findings, "LEDGER", (replace(entry, engines=("2025.7.22.4.0",)),))
    record = CaseRecord(case="drawn", verdict="differs", ended="answered")
    assert known_gap(record, scene, "2025.7.22.4.0") == entry.id
    assert known_gap(record.model_copy(update={"ended": "crashed", "verdict": "crashed"}), scene, "2025.7.22.4.0") == ""
    assert known_gap(record, scene, "2026.7.4") == ""
    plain = scene.model_copy(update={"rheo": scene.rheo.model_copy(update={"zmin": 0})})
    assert known_gap(record, plain, "2025.7.22.4.0") == ""


def test_gap_covers_the_fields_that_its_finding_reaches(monkeypatch: pytest.MonkeyPatch) -> None:
    """The judgement names such limits."""
    (entry,) = (entry for entry in LEDGER if entry.id == "wall-velocity-lost")
    assert isinstance(entry, ModelFinding)
    anywhere = replace(entry, gaps=(replace(entry.gaps[0], applies=lambda scene: True),), engines=("2025.7.22.4.0",))
    monkeypatch.setattr(findings, "LEDGER", (anywhere,))
    scene, record = draw(1, 0).case.scene, CaseRecord(case="drawn", verdict="differs", ended="answered")
    assert known_gap(record, scene, "2025.7.22.4.0") == ""
    assert known_gap(record.model_copy(update={"limits": [entry.id]}), scene, "2025.7.22.4.0") == entry.id


QUINTIC, RK1 = {"kernel": "quintic", "interface_reconstruct": True}, {"kernel": "RK1", "interface_reconstruct": True}
CLOSED = {"lattice": "sq", "spacing": 1.0, "cells": [8, 8], "periodic": [False, False]}


@pytest.mark.parametrize(
    ("changed", "by", "known"),
    [
        ({"rheo": QUINTIC}, "minimize", True),
        ({"rheo": QUINTIC, "positions": CLOSED | {"periodic": [True, False]}}, "minimize", True),
        ({"rheo": QUINTIC, "positions": CLOSED}, "minimize", False),
        ({"rheo": QUINTIC, "positions": CLOSED, "engine": {"ranks": 2}}, "minimize", True),
        ({"rheo": RK1, "positions": CLOSED}, "minimize", True),
        ({"rheo": {"kernel": "RK1"}, "positions": CLOSED}, "minimize", False),
        ({"rheo": RK1}, "set", False),
    ],
)
def test_gap_applies_to_the_scenes_of_its_reason(changed: dict[str, Any], by: str, known: bool) -> None:
    """A minimisation next to reconstructed walls, with images or a corrected kernel."""
    (entry,) = (entry for entry in LEDGER if entry.id == "walls-begin-with-pressure")
    assert isinstance(entry, ModelFinding)
    scene = small_scene(
        [[1.0, 1.0]], (8, 8), evolve={"steps": 2, "timestep": 1e-3, "stops": [{"at": 1, "by": by}]}, **changed
    )
    assert any(gap.applies(scene.scene) for gap in entry.gaps) == known


@pytest.mark.parametrize(
    ("change", "engine", "unbounded"),
    [
        ({}, "2025.7.22.2.0", True),
        ({}, "2026.7.4", False),  # not known to have it
        ({"bound": 1e-9}, "2025.7.22.2.0", False),
    ],
)
def test_only_known_findings_leave_scenes_without_bounds(change: Any, engine: str, unbounded: bool) -> None:
    left = {
        "field": "x",
        "stage": "integration",
        "step": 1,
        "atom": 1,
        "lammps": 1.0,
        "reference": 1.0,
        "bound": np.inf,
    }
    blame = Blame(**(left | {"outside": 8, "of": 8} | change))
    beyond = Beyond(findings=["cross-type-normal"], blame=blame)
    record = CaseRecord(case="drawn", verdict="differs", ended="answered", beyond=beyond)
    assert is_unbounded(record, engine) == unbounded
    assert not is_unbounded(record.model_copy(update={"beyond": None}), engine)


@pytest.mark.parametrize(
    ("error", "lost"),
    [
        ("ERROR: Lost atoms: original 36 current 35", True),
        ("ERROR: Non-numeric atom coords - simulation unstable", True),
        ("ERROR: Expected floating point parameter instead of 'nan' in input script", True),  # a state put back
        ("ERROR: Expected floating point parameter instead of '-nan' in input script", True),
        ("ERROR: Expected floating point parameter instead of 'nanometre' in input script", False),
        ("ERROR: Replicate did not assign all atoms correctly", True),
        ("ERROR: Unknown pair style", False),
    ],
)
def test_errors_caused_by_nan(error: str, lost: bool) -> None:
    record = CaseRecord(case="drawn", verdict="refused", ended="refused", engine_error=error)
    assert is_lost(record) == lost
    assert not is_lost(record.model_copy(update={"verdict": "differs"}))


@pytest.mark.parametrize(
    ("periodic", "boundary", "speed", "lost"),
    [
        (False, "f", 3.0, True),
        (False, "f", 0.5, False),
        (True, "f", 3.0, False),  # the next image, to which LAMMPS moves it
        (True, "f", 11.0, True),
        (False, "m", 9.0, False),
        (False, "m", 1e10, True),
        (True, "f", 1e309, True),
    ],
)
def test_scenes_that_lose_particles(periodic: bool, boundary: str, speed: float, lost: bool, tmp_path: Path) -> None:
    """Two particles in the middle of a box of 5, parting for two steps of 0.5."""
    scene = {
        "dimension": 2,
        "types": [{"mass": 1.0}],
        "positions": {"x": [[2.5, 2.0], [2.5, 3.0]], "low": [0, 0], "high": [5, 5], "periodic": [periodic] * 2},
        "pressure": [{"types": "*", "style": "linear"}],
        "rho": {"constant": 1.0},
        "velocity": {"values": [[min(speed, 1e308), 0.0], [-min(speed, 1e308), 0.0]]},
        "evolve": {"steps": 2, "timestep": 0.5 if speed < 1e308 else 1e308},
        "engine": {"boundary": boundary},
        "compare": ["x"],
    }
    file = tmp_path / "case.yaml"
    file.write_text(json.dumps({"name": "moving", "about": "x", "tags": ["model"], "scene": scene}))
    assert loses(prepared_case.prepare(casefile.load_file(file)[0]), "2025.7.22.4.0") == lost


@pytest.mark.parametrize("arguments", [("--seconds", "0"), ("--draw", "-1")])
def test_wrong_numbers_are_refused(
    arguments: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--out", str(tmp_path)]) == 2 and capsys.readouterr().err.count("\n") == 1


def test_scene_with_particles_lost_by_the_reference_is_counted_separately() -> None:
    """Steps too long by design, and forces that lack a factor in LAMMPS: it continues where the reference cannot."""
    ready = draw(401, 12).ready
    assert loses(ready) and not loses(draw(401, 13).ready)
