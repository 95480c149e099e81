"""Controls: cases without a fault, with which faults are compared."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.changes import catalogue
from tests.workshop.faults import substitute, tasks
from tests.workshop.faults.perturbed import PerturbedJudge

pytestmark = pytest.mark.lammps


def test_case_that_depends_on_lists_is_a_green_control(tmp_path: Path) -> None:
    """It detects a corrupted output, and a fault in the input, whose run is read with its lists."""
    judge = PerturbedJudge(EngineRecord(name="env", distribution="2025.7.22.4.0"))
    (case,) = casefile.select(casefile.load(), ("virials-twins.relabel",))
    control = tasks.answer_case(None, judge, tmp_path, prepared_case.prepare(case))
    assert (control.answered, control.played, control.red) == (True, True, ())
    read = tasks.detect(None, judge, tmp_path, "read.axis-lost-f", [case.name], None)
    assert [detection.case for detection in read] == [case.name]
    assert tasks.detect(None, judge, tmp_path, "told.no-deform", [case.name], None) == []  # has none
    assert tasks.detect(None, judge, tmp_path, "told.mass-doubled", [case.name], None)


def test_mistake_hidden_by_a_finding_is_detected_for_a_lammps_without_it(tmp_path: Path) -> None:
    judge = PerturbedJudge(EngineRecord(name="env", distribution="2025.7.22.4.0"))
    (case,) = casefile.select(casefile.load(), ("twins-units.fluids.real",))
    control = tasks.answer_case(None, judge, tmp_path, prepared_case.prepare(case))
    assert (control.answered, control.played, control.manual, control.red) == (True, True, True, ())
    mistake = catalogue()["units-k-unconverted"]
    found = {
        engine: substitute.answer_cases(mistake, tmp_path, [case.name], engine, 1, 30.0)
        for engine in (judge.engine.distribution, None)
    }
    assert found["2025.7.22.4.0"] == []
    (played,) = found[None]
    detection = tasks.judge_substitution(None, judge, tmp_path, played)
    assert detection and (detection.verdict, detection.field, detection.manual) == ("differs", "viscosity", True)


def test_twin_of_the_same_problem_uses_the_same_findings(tmp_path: Path) -> None:
    """Read at other steps, a finding would be fitted to another snapshot."""
    judge = PerturbedJudge(EngineRecord(name="env", distribution="2025.7.22.4.0"))
    (case,) = casefile.select(casefile.load(), ("twins-cross-type.split",))
    assert tasks.answer_case(None, judge, tmp_path, prepared_case.prepare(case)).played
