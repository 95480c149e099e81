"""Progress of long commands away from a terminal, and processor time by stage, of which none is lost."""

from __future__ import annotations

import time

import pytest

from lammps_cases.cli import shared
from lammps_cases.records import progress
from lammps_cases.records.case_parts import Seconds
from lammps_cases.records.progress import REST, SILENT, Bar, Stages
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord


def test_complaints_are_printed_at_once_and_progress_rarely(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    with Bar(prefix="env: ", complaints=True) as bar:
        for now, done, total, complaint in ((0.0, 1, 3, ""), (1.0, 2, 3, "differs b"), (6.5, 3, None, "")):  # noqa: B007
            bar.advance(done, total, "a", complaint)
    assert capsys.readouterr().err == "differs b\n3/? env: a\n"
    monkeypatch.setattr(progress, "PLAIN_EVERY", -1.0)
    for unwanted in (Bar(quiet=True, complaints=True), SILENT, Bar()):
        unwanted.advance(1, 2, "a", "differs a")
    assert capsys.readouterr().err == "1/2 a\n", "without complaints only the last counts"


def test_time_left_is_estimated_from_work_done_since_the_start(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    monkeypatch.setattr(progress, "PLAIN_EVERY", -1.0)
    with Bar(prefix="env: ") as bar:
        for at, done, total in (
            *((50.0, 40, 100), (60.0, 42, 100), (120.0, 80, 100), (130.0, 100, 100)),  # resumed after 40
            *((140.0, 1, None), (150.0, 3, None)),  # the total is unknown
            *((160.0, 0, 3), (3760.0, 1, 3), (10960.0, 2, 3)),  # another task
        ):
            now = at
            bar.advance(done, total, "x")
    assert [line.removesuffix("env: x") for line in capsys.readouterr().err.splitlines()] == [
        *("40/100 ", "42/100 about 5 min left: ", "80/100 about 35 s left: ", "100/100 "),
        *("1/? ", "3/? "),
        *("0/3 ", "1/3 about 2 h left: ", "2/3 about 90 min left: "),
    ]


def test_time_of_a_nested_stage_is_not_counted_in_the_outer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    stages = Stages(lambda: clock[0])
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
    with pytest.raises(ZeroDivisionError), stages.stage("comparison"), stages.stage("variants"), stages.stage("bounds"):
        clock[0] += 3
        _ = 1 / 0
    with stages.stage("bounds"):
        clock[0] += 1
    assert stages.taken() == {"variants": 3, "bounds": 1, "comparison": 0, REST: 0}, "bounds of variants are variants"

    monkeypatch.setattr("lammps_cases.records.progress.taken", stages.taken)
    with stages.stage("report"):
        clock[0] += 1
    clock[0] += 1
    times = Seconds(lammps=2.0, stages={"bounds": 4.0, REST: 3.0})
    case = CaseRecord(case="a", verdict="pass", seconds=times)
    rows = [line.split() for line in shared.stages(RunRecord(engine=EngineRecord(), reference={}, cases=[case]))]
    assert [row[0] for row in rows] == ["bounds", "LAMMPS", "starting,", "report"]
    assert rows[0][1:4] == ["4.00", "s", "44.4%"] and rows[0][4] == "2.00"
    assert sum(float(row[row.index("s") - 1]) for row in rows) == 9.0, "the table adds up"
