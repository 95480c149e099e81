"""kill -9 of a run or of a worker at random moments: nothing lost or torn, nothing left, the same report."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.workshop.kills import DaskKills, Kills, campaign

pytestmark = [pytest.mark.kills, pytest.mark.lammps, pytest.mark.slow]


def test_few_kills(tmp_path: Path) -> None:
    counts = campaign(3, Kills(tmp_path, 2))
    assert counts["kills of a worker"] + counts["kills of the main process"] == 3
    assert counts["files of MPICH left"] == 0


def test_three_hundred_kills(tmp_path: Path) -> None:
    counts = campaign(300, Kills(tmp_path, 1))
    assert counts["kills of a worker"] > 50 and counts["kills of the main process"] > 50, "both were tried"
    assert counts["files of MPICH left"] == 0


def test_hundred_kills_of_a_cluster(tmp_path: Path) -> None:
    with ExitStack() as stack:
        counts = campaign(100, DaskKills(tmp_path, 1, stack))
    victims = ("the main process", "a Dask worker", "the Dask scheduler")
    assert min(counts[f"kills of {victim}"] for victim in victims) > 15, "all were tried"
    assert counts["files of MPICH left"] == 0
