"""Planted faults turn cases red by the ordinary verdict; without one nothing is red; undetected ones are reported."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.engine import cluster, installations
from lammps_cases.engine.session import Answer
from lammps_cases.records.progress import SILENT
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.changes import Change, catalogue
from lammps_cases.scene.particles import AtomType
from lammps_cases.scene.values import Dim, Positive
from tests.support import dask_cluster
from tests.workshop import power
from tests.workshop.faults import (
    collect,
    input_faults,
    output_faults,
    record,
    scene_faults,
    schedule,
    substitute,
    tasks,
)
from tests.workshop.faults.alarms import Alarm, AlarmRun
from tests.workshop.faults.fault import FAMILIES, KINDS, Detection, files
from tests.workshop.faults.perturbed import PerturbedJudge
from tests.workshop.faults.record import ControlRecord, FaultRecord, Power
from tests.workshop.faults.schedule import MutationPool
from tests.workshop.faults.tasks import Control

CASES = {case.name: case for case in casefile.load()}
# Small cases without time steps: laws of several types, a gas, viscosities, surfaces, a refusal.
NAMES = ("ranges.background-override", "ideal-gas.beside-tait", "strain.thinning.2d", "power-status.divergence")
REFUSED = "refused.no-fix-rheo"
LAW, GAS, FLUID, SURFACE = NAMES
ENGINE = "2025.7.22.4.0"
# fault: the case that detects it first, the verdict, the field it names
SEEN: dict[str, tuple[str, str, str] | None] = {
    "told.cs-off": (LAW, "differs", "pressure_used"),
    "told.range-ends-early": (LAW, "differs", "pressure_used"),
    "told.energy-not-per-mass": (GAS, "differs", "esph"),
    "told.no-pressure-fix": (LAW, "crashed", ""),
    "told.power-gd0": (FLUID, "differs", "viscosity"),
    "told.refusal-not-asked": (REFUSED, "differs", ""),
    "read.single-rho": (LAW, "differs", "rho"),
    "read.one-off-output-grad-v": (FLUID, "differs", "grad/v"),
    "read.one-more-output-status": (SURFACE, "differs", "status"),
    "read.id-repeated": (LAW, "differs", "id"),
    "formula.lint-background-dropped": (LAW, "differs", "pressure_used"),
    "formula.lint-masses-ignored": (FLUID, "differs", "grad/v"),
    "formula.strain-half": (FLUID, "differs", "viscosity"),
    "formula.status-without-layer": (SURFACE, "differs", "status"),
    "formula.kick-missing": None,  # no time step here
    "formula.hangs": (LAW, "timeout", ""),
    "formula.dies": (LAW, "crashed", ""),
    "formula.raises": (LAW, "crashed", ""),
}
# Faults in the law of the first case.
STATEMENTS = {"hangs": "while True: pass", "dies": "import os; os._exit(3)", "raises": "raise ValueError('no')"}
LINEAR = ("eos_ref.eos.laws:linear", "return cs * cs * (rho - rho0)")
OWN = {
    f"formula.{name}": substitute.FormulaFault(
        f"formula.{name}", "option", name, Change(name, name, function=LINEAR[0], replace=LINEAR[1], by=by)
    )
    for name, by in STATEMENTS.items()
}
Planted = tuple[list[Control], dict[str, tuple[Detection, ...]]]


@pytest.fixture(scope="module")
def planted() -> Iterator[Planted]:
    """The control, and all faults of SEEN planted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(schedule, "CASE_LIMIT", 2.0)
        with MutationPool(installations.resolve("env"), 2, None) as pool:
            control = pool.prepare([CASES[name] for name in (*NAMES, REFUSED)], SILENT)
            faults = collect.faults() | OWN
            yield control, {fault.id: found for fault, found in pool.plant([faults[name] for name in SEEN])}


@pytest.mark.lammps
def test_without_a_fault_nothing_is_red(planted: Planted) -> None:
    expected = [*((name, True, True, ()) for name in NAMES), (REFUSED, True, None, ())]
    assert [(c.case, c.answered, c.played, c.red) for c in planted[0]] == expected


@pytest.mark.lammps
@pytest.mark.parametrize("fault", SEEN)
def test_planted_fault_is_detected(fault: str, planted: Planted) -> None:
    seen, expected = planted[1][fault], SEEN[fault]
    assert [(one.case, one.verdict, one.field) for one in seen[:1]] == ([] if expected is None else [expected])
    assert len(seen) == len(files(seen)) <= schedule.WITNESSES, "no more than it takes to know two scenes"


@pytest.mark.lammps
def test_every_case_that_detects_a_fault() -> None:
    with MutationPool(installations.resolve("env"), 1, None, every=True) as pool:
        pool.prepare([CASES[LAW], CASES[GAS]], SILENT)
        planted = list(pool.plant([collect.faults()[name] for name in ("told.cs-off", "formula.linear-of-rho")]))
    assert {fault.id: sorted(one.case for one in detections) for fault, detections in planted} == {
        "told.cs-off": sorted((LAW, GAS)),
        "formula.linear-of-rho": [LAW],
    }


@pytest.mark.lammps
@pytest.mark.slow
def test_faults_are_planted_in_the_same_cases_on_a_cluster() -> None:
    cases = casefile.select(casefile.load(), ["ranges.star", "walls.stored.damped"])
    controls = []
    with dask_cluster.running(1, nanny=True) as steady:
        for address in ("", steady.address):
            with cluster.used(address), MutationPool(installations.resolve("env"), 2, None) as pool:
                controls.append(pool.prepare(cases, SILENT))
    assert controls[0] == controls[1] and [control.answered for control in controls[0]] == [True, True]


# --- controls: cases without a fault, with which faults are compared


def _control(name: str, folder: Path) -> tuple[Control, PerturbedJudge]:
    judge = PerturbedJudge(EngineRecord(name="env", distribution=ENGINE))
    return tasks.answer_case(None, judge, folder, prepared_case.prepare(CASES[name])), judge


@pytest.mark.lammps
def test_case_that_depends_on_lists_is_a_green_control(tmp_path: Path) -> None:
    """It detects a corrupted output, and a fault in the input, whose run is read with its lists."""
    name = "virials-twins.relabel"
    control, judge = _control(name, tmp_path)
    assert (control.answered, control.played, control.red) == (True, True, ())

    def detected(fault: str) -> list[str]:
        return [one.case for one in tasks.detect(None, judge, tmp_path, fault, [name], None)]

    assert detected("read.axis-lost-f") == detected("told.mass-doubled") == [name]
    assert detected("told.no-deform") == []  # has none


@pytest.mark.lammps
def test_mistake_hidden_by_a_finding_is_detected_for_a_lammps_without_it(tmp_path: Path) -> None:
    name = "twins-units.fluids.real"
    control, judge = _control(name, tmp_path)
    assert (control.answered, control.played, control.manual, control.red) == (True, True, True, ())
    mistake = catalogue()["units-k-unconverted"]
    assert substitute.answer_cases(mistake, tmp_path, [name], ENGINE, 1, 30.0) == []
    (played,) = substitute.answer_cases(mistake, tmp_path, [name], None, 1, 30.0)
    detection = tasks.judge_substitution(None, judge, tmp_path, played)
    assert detection and (detection.verdict, detection.field, detection.manual) == ("differs", "viscosity", True)


@pytest.mark.lammps
def test_twin_of_the_same_problem_uses_the_same_findings(tmp_path: Path) -> None:
    """Read at other steps, a finding would be fitted to another snapshot."""
    assert _control("twins-cross-type.split", tmp_path)[0].played


# --- the faults themselves


@pytest.mark.slow
def test_faults_are_many_and_of_all_kinds() -> None:
    faults = collect.faults()
    assert len(faults) >= 500
    assert {fault.family for fault in faults.values()} == set(FAMILIES)
    assert {fault.kind for fault in faults.values()} == set(KINDS)
    assert all(name == fault.id and fault.what for name, fault in faults.items())
    assert set(record.arguments()) <= {(fault.id, fault.what) for fault in faults.values()}


@pytest.mark.slow
def test_mistakes_equal_to_findings_of_the_engine_are_not_planted() -> None:
    findings = {"formula.lint-velocity-of-walls-lost", "formula.lint-no-volume-in-the-force"}
    assert set(substitute.faults()) - set(collect.faults()) == findings
    assert "formula.lint-no-volume-in-the-force" not in collect.faults(ENGINE)
    assert "formula.lint-no-volume-in-the-force" in collect.faults("2025.7.22.1.0")
    assert "formula.lint-heat-divided-by-the-density" in collect.faults(ENGINE)


@pytest.mark.slow
def test_faults_are_chosen_by_name_or_by_a_reproducible_sample() -> None:
    faults = collect.faults()
    assert [f.id for f in collect.select(faults, ("told.cs-o*",))] == ["told.cs-off", "told.cs-of-one"]
    with pytest.raises(InputError, match=r"mean 'told\.cs-off"):
        collect.select(faults, ("told.cs-of",))
    drawn = collect.select(faults, (), sample=7)
    assert drawn == collect.select(faults, (), sample=7) and len(drawn) == 7


def test_new_number_of_a_type_is_planted_without_an_edit() -> None:
    class SizedType(AtomType):
        size: Annotated[Positive, Dim("x")]

    new = set(scene_faults.numbers(SizedType, "types")) - set(scene_faults.numbers(AtomType, "types"))
    assert new == {"types.size"}


def test_fault_without_effect_does_not_apply() -> None:
    ready = prepared_case.prepare(CASES[FLUID])
    assert input_faults.jobs(input_faults.faults()["told.A3-sign"], ready) is None
    assert input_faults.jobs(input_faults.faults()["told.mass-off"], ready) is not None


def test_corrupting_an_answer_keeps_the_correct_one() -> None:
    right = {"id": np.arange(1, 5), "f": np.arange(12.0).reshape(4, 3)}
    answer = Answer(right, 0.0, (right,), (0,))
    for fault in output_faults.faults().values():
        faulty = output_faults.applied(fault, answer)
        assert right["f"].tolist() == np.arange(12.0).reshape(4, 3).tolist(), fault.id
        assert faulty is None or set(faulty.arrays) == set(right)


# --- the record


def _power(*faults: FaultRecord, **more: Any) -> Power:
    whole = {"whole": False, "quick_only": False, "controls": (), "resolution": (), "alarms": ()} | more
    return Power("power", {"cores": "2"}, {"name": "env"}, seconds=1.0, faults=faults, **whole)


def _fault(name: str, *cases: str, quick: bool = True, argued: str = "") -> FaultRecord:
    seen = tuple(Detection(case, "differs", "f", "") for case in cases)
    return FaultRecord(f"told.{name}", "told", "constant", name, cases, quick and bool(cases), seen, argued)


def _alarmed(finding: str) -> AlarmRun:
    alarm = Alarm("x", "ranks", "differs", "f", finding)
    return AlarmRun("ranks", "two", cases=1, same_bits=0, within=0, verdicts={"differs": 1}, alarms=(alarm,))


@pytest.mark.parametrize(
    ("fault", "more", "complaint"),
    [
        (_fault("a", "x"), {}, ""),
        (_fault("a", argued="equal"), {}, ""),
        (_fault("a"), {}, "unseen: told.a"),
        (_fault("a", "x"), {"controls": (ControlRecord("told", 3, ("x: differs",)),)}, "told: x"),
        (_fault("a", "x"), {"alarms": (_alarmed("walls-after-rebuild"),)}, ""),
        (_fault("a", "x"), {"alarms": (_alarmed(""),)}, "false alarm, ranks: x"),
    ],
)
def test_complaints(fault: FaultRecord, more: dict[str, Any], complaint: str) -> None:
    found = _power(fault, **more).complaints
    assert len(found) == bool(complaint) and all(complaint in line for line in found)


@pytest.mark.parametrize(
    ("slow", "unseen", "quick_only", "wrong"),
    [
        (10, 0, False, []),
        (11, 0, False, ["quick"]),
        (0, 1, False, []),
        (0, 2, False, ["all"]),
        (11, 0, True, ["quick"]),
    ],
)
def test_rates_are_checked_for_all_faults_together(slow: int, unseen: int, quick_only: bool, wrong: list[str]) -> None:
    faults = [_fault(str(k), "x", quick=k >= slow) for k in range(100 - unseen)]
    faults += [_fault(f"unseen-{k}", argued="equal") for k in range(unseen)]
    found = _power(*faults, whole=True, quick_only=quick_only).complaints
    assert [line.split()[0] for line in found] == wrong
    assert _power(*faults).complaints == []


def test_red_control_belongs_to_the_families_that_use_it() -> None:
    found = record.controls([Control("x", True, False, ("played: differs",)), Control("y", True, None)])
    counts = {c.family: (c.cases, len(c.red)) for c in found}
    assert counts == {"told": (2, 0), "read": (2, 0), "formula": (1, 1)}


def test_finished_faults_are_kept_after_a_kill(tmp_path: Path) -> None:
    one, other = _fault("a", "x"), _fault("b")
    record.planted(tmp_path).add("key a", one)
    with (tmp_path / "planted.jsonl").open("ab") as file:
        file.write(b'{"key": "key b", "res')  # killed here
    record.planted(tmp_path).add("key b", other)
    again = record.planted(tmp_path)
    assert [again.get(key) for key in ("key a", "key b", "other sources a")] == [one, other, None]
    with record.planted(tmp_path).resumed(False):
        assert record.planted(tmp_path).get("key a") is None


# --- the command


@pytest.mark.lammps
def test_command_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(casefile, "load", lambda *_: [CASES[LAW], replace(CASES[FLUID], tags=("model",))])
    out = ("--out", str(tmp_path), "--jobs", "1")
    asked = ("told.cs-off", "told.power-n", "told.kappa-off", *out)
    assert power.main(asked) == 1  # no case conducts heat
    found = json.loads((tmp_path / "power.json").read_text())
    assert {fault["id"]: fault["caught_by"] for fault in found["faults"]} == {
        "told.cs-off": [LAW, FLUID],
        "told.power-n": [FLUID],
        "told.kappa-off": [],
    }
    assert found["resolution"] == []
    assert " 2 of    3 caught,    1 by quick cases" in capsys.readouterr().out
    kept = (tmp_path / "planted.jsonl").read_bytes()
    assert power.main(asked) == 1
    assert "unseen: told.kappa-off" in capsys.readouterr().out
    assert (tmp_path / "planted.jsonl").read_bytes() == kept
    assert json.loads((tmp_path / "power.json").read_text())["faults"] == found["faults"]
    assert power.main(("told.cs-off", *out)) == 0


@pytest.mark.parametrize(
    ("name", "meant"), [("falts", "faults"), ("told.cs-doubld", "told.cs-doubled"), ("told.*xx", ""), ("what.is", "")]
)
def test_typo_is_refused_before_anything_starts_or_is_deleted(
    name: str, meant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(collect, "MutationPool", None)
    kept = tmp_path / "planted.jsonl"
    kept.write_text("what other runs planted")
    assert power.main(["faults", name, "--fresh", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"no such section or fault: {name!r}" in said and said.count("\n") == 1
    assert (f"did you mean {meant!r}?" in said) or not meant
    assert kept.exists()


@pytest.mark.parametrize("done", [False, True])
def test_interrupted_run_reports_what_is_kept(
    done: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any) -> None:
        if done:
            (tmp_path / "planted.jsonl").write_text("{}\n")
        raise KeyboardInterrupt

    monkeypatch.setattr(collect, "collect", interrupted)
    assert power.main(["--out", str(tmp_path)]) == 130
    kept = f"interrupted: what is done is in {tmp_path / 'planted.jsonl'}; the same command, without --fresh, resumes"
    assert capsys.readouterr().err == (f"{kept}\n" if done else "interrupted\n")
