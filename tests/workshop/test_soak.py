"""Thousands of cases in one campaign, here and through Dask: memory, speed, workers, report, store, history."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lammps_cases.comparison import store
from lammps_cases.engine.pool import RECYCLED
from lammps_cases.records.run_record import read_run
from lammps_cases.report.history import store as history
from tests.support import dask_cluster
from tests.workshop import soak

pytestmark = [pytest.mark.soak, pytest.mark.lammps, pytest.mark.slow]
CASES, JOBS = int(os.environ.get("EOS_REF_SOAK", "20000")), 2


@pytest.mark.parametrize("where", ["here", "dask"])
def test_soak(where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "store"))
    monkeypatch.setenv(history.VARIABLE, str(tmp_path / "history.sqlite"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    command = [sys.executable, "-m", "tests.workshop.soak", str(tmp_path), str(CASES), str(JOBS)]
    if where == "here":
        subprocess.run(command, check=True)
    else:
        with dask_cluster.running(JOBS) as cluster:
            subprocess.run([*command, cluster.address], check=True)
    check(tmp_path)


def check(folder: Path) -> None:
    """Compare a campaign with the limits promised for long ones."""
    run, samples = read_run(folder / "report"), soak.samples(folder)
    assert len(run.cases) == samples[-1].cases == CASES and all(case.as_expected for case in run.cases)
    opened = min(
        soak.opening(folder / "report", folder / "tmp" / "chromium") for _ in range(10)
    )  # the quickest: other programs compute, too
    growth, slowing, last = soak.growth(samples), soak.slowing(folder), samples[-1]
    print(f"\n{last}\nmemory x {growth:.3f}, cost of a case x {slowing:.3f}, report opens in {opened:.2f} s")
    assert growth < 1.1 and slowing < 1.1 and opened < 2.0
    assert max(sample.store for sample in samples) <= store.LIMIT
    assert last.workers >= 2 * CASES // RECYCLED, "two tasks of every case"
    with history.History(folder / "history.sqlite") as kept:
        assert len(kept.results([stored.id for stored in kept.runs()])) == CASES
