"""Cases without a fault, as faults are held against them."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import campaign
from lammps_cases.scene import casefile
from lammps_cases.studies.mutation import tasks
from lammps_cases.studies.mutation.perturbed import PerturbedJudge

pytestmark = pytest.mark.lammps


def test_a_case_that_follows_lists_is_no_red_control(tmp_path: Path) -> None:
    """A corrupted output is seen in it; a fault in the input is not asked for, as that run would have no lists."""
    judge = PerturbedJudge(EngineRecord(name="env", distribution="2025.7.22.4.0"))
    (case,) = casefile.select(casefile.load(), ("virials-twins.relabel",))
    control = tasks.answer_case(None, judge, tmp_path, campaign.prepare(case))
    assert (control.answered, control.played, control.red) == (True, True, ())
    read = tasks.detect(None, judge, tmp_path, "read.axis-lost-f", [case.name], None)
    assert [detection.case for detection in read] == [case.name]
    assert tasks.detect(None, judge, tmp_path, "told.mass-doubled", [case.name], None) == []
