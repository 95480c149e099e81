"""kill -9 of a run or of a worker at random moments: nothing lost or torn, nothing left, the same report."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.kills import campaign

pytestmark = [pytest.mark.kills, pytest.mark.lammps, pytest.mark.slow]


def test_a_few_kills(tmp_path: Path) -> None:
    counts = campaign(3, 2, tmp_path)
    assert counts["kills of a worker"] + counts["kills of the main process"] == 3
    assert counts["files of MPICH left"] == 0


def test_three_hundred_kills(tmp_path: Path) -> None:
    counts = campaign(300, 1, tmp_path)
    assert counts["kills of a worker"] > 50 and counts["kills of the main process"] > 50, "both were tried"
    assert counts["files of MPICH left"] == 0
