"""Progress of long commands away from a terminal."""

from __future__ import annotations

import time

import pytest

from lammps_cases.records import progress
from lammps_cases.records.progress import SILENT, Bar


def test_complaints_are_printed_at_once_and_progress_rarely(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    with Bar(prefix="env: ", complaints=True) as bar:
        bar.advance(1, 3, "a")
        now = 1.0
        bar.advance(2, 3, "b", "differs b")
        now = 6.5
        bar.advance(3, None, "c")
    assert capsys.readouterr().err == "differs b\n3/? env: c\n"


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


def test_unwanted_lines_are_not_printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "PLAIN_EVERY", -1.0)
    for bar in (Bar(quiet=True, complaints=True), SILENT):
        bar.advance(1, 2, "a", "differs a")
    with Bar() as bar:
        bar.advance(1, 2, "a", "differs a")
    assert capsys.readouterr().err == "1/2 a\n"
