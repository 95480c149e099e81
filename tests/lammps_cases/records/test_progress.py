"""Progress of long commands away from a terminal."""

from __future__ import annotations

import time

import pytest

from lammps_cases.records import progress
from lammps_cases.records.progress import SILENT, Bar


def test_lines_are_rare_but_complaints_are_not(
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


def test_what_is_not_wanted_is_not_shown(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "PLAIN_EVERY", -1.0)
    for bar in (Bar(quiet=True, complaints=True), SILENT):
        bar.advance(1, 2, "a", "differs a")
    with Bar() as bar:
        bar.advance(1, 2, "a", "differs a")
    assert capsys.readouterr().err == "1/2 a\n"
