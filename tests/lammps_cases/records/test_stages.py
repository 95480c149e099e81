"""Processor time by stage: time of a nested stage is not counted in the outer one, and none is lost."""

from __future__ import annotations

import pytest

from lammps_cases.cli import shared
from lammps_cases.records.case_parts import Seconds
from lammps_cases.records.progress import REST, Stages
from lammps_cases.records.run_record import CaseRecord, RunRecord


@pytest.fixture
def clock() -> list[float]:
    return [0.0]


@pytest.fixture
def stages(clock: list[float]) -> Stages:
    return Stages(lambda: clock[0])


def test_nested_stages(clock: list[float], stages: Stages) -> None:
    clock[0] += 1
    with stages.stage("comparison"):
        clock[0] += 2
        with stages.stage("bounds"):
            clock[0] += 4
        clock[0] += 8
    with stages.stage("writing"):
        clock[0] += 16
    assert stages.taken() == {"comparison": 10, "bounds": 4, "writing": 16, REST: 1}
    clock[0] += 32
    assert stages.taken() == {REST: 32}


def test_bounds_of_variants_count_as_variants(clock: list[float], stages: Stages) -> None:
    with pytest.raises(ZeroDivisionError), stages.stage("comparison"), stages.stage("variants"), stages.stage("bounds"):
        clock[0] += 3
        _ = 1 / 0
    with stages.stage("bounds"):
        clock[0] += 1
    assert stages.taken() == {"variants": 3, "bounds": 1, "comparison": 0, REST: 0}


def test_the_table_adds_up_and_names_lammps(
    clock: list[float], stages: Stages, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lammps_cases.records.progress.taken", stages.taken)
    with stages.stage("report"):
        clock[0] += 1
    clock[0] += 1
    times = Seconds(lammps=2.0, stages={"bounds": 4.0, REST: 3.0})
    case = CaseRecord.model_construct(case="a", seconds=times)  # type: ignore[call-arg]
    run = RunRecord.model_construct(cases=[case])  # type: ignore[call-arg]
    rows = [line.split() for line in shared.stages(run)]
    assert [row[0] for row in rows] == ["bounds", "LAMMPS", "starting,", "report"]
    assert rows[0][1:4] == ["4.00", "s", "44.4%"] and rows[0][4] == "2.00"
    assert sum(float(row[row.index("s") - 1]) for row in rows) == 9.0
