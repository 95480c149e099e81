"""Long campaigns: kill -9 at random moments, thousands of cases in one run, the kit for Slurm on a real Slurm."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from lammps_cases.comparison import store
from lammps_cases.engine.pool import RECYCLED
from lammps_cases.records.run_record import read_run
from lammps_cases.report.history import store as history
from tests.support import dask_cluster
from tests.support.same_reports import assert_same
from tests.workshop import slurm, soak
from tests.workshop.kills import DaskKills, Kills, campaign
from tests.workshop.slurm import PATIENCE, PAUSE, Slurm

pytestmark = [pytest.mark.lammps, pytest.mark.slow]

# --- kills: nothing lost or torn, nothing left, the same report


@pytest.mark.kills
@pytest.mark.parametrize(
    ("kills", "seed", "cluster", "victims"),
    [
        (3, 2, False, {}),
        (300, 1, False, {"a worker": 50, "the main process": 50}),
        (100, 1, True, {"the main process": 15, "a Dask worker": 15, "the Dask scheduler": 15}),
    ],
)
def test_killed_runs_are_resumed(kills: int, seed: int, cluster: bool, victims: dict[str, int], tmp_path: Path) -> None:
    with ExitStack() as stack:
        counts = campaign(kills, DaskKills(tmp_path, seed, stack) if cluster else Kills(tmp_path, seed))
    assert sum(count for what, count in counts.items() if what.startswith("kills of ")) == kills
    assert all(counts[f"kills of {victim}"] > least for victim, least in victims.items()), "all were tried"
    assert counts["files of MPICH left"] == 0


# --- memory, speed, workers, report, store, history, here and through Dask

CASES, JOBS = int(os.environ.get("EOS_REF_SOAK", "20000")), 2


@pytest.mark.soak
@pytest.mark.parametrize("where", ["here", "dask"])
def test_soak(where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A campaign keeps to the limits promised for long ones."""
    for variable, name in ((store.VARIABLE, "store"), (history.VARIABLE, "history.sqlite"), ("TMPDIR", "tmp")):
        monkeypatch.setenv(variable, str(tmp_path / name))
    (tmp_path / "tmp").mkdir()
    command = [sys.executable, "-m", "tests.workshop.soak", str(tmp_path), str(CASES), str(JOBS)]
    with ExitStack() as stack:
        if where == "dask":
            command.append(stack.enter_context(dask_cluster.running(JOBS)).address)
        subprocess.run(command, check=True)
    run, samples = read_run(tmp_path / "report"), soak.samples(tmp_path)
    assert len(run.cases) == samples[-1].cases == CASES and all(case.as_expected for case in run.cases)
    # The quickest: other programs compute, too.
    opened = min(soak.opening(tmp_path / "report", tmp_path / "tmp" / "chromium") for _ in range(10))
    growth, slowing, last = soak.growth(samples), soak.slowing(tmp_path), samples[-1]
    print(f"\n{last}\nmemory x {growth:.3f}, cost of a case x {slowing:.3f}, report opens in {opened:.2f} s")
    assert growth < 1.1 and slowing < 1.1 and opened < 2.0
    assert max(sample.store for sample in samples) <= store.LIMIT
    assert last.workers >= 2 * CASES // RECYCLED, "two tasks of every case"
    with history.History(tmp_path / "history.sqlite") as kept:
        assert len(kept.results([stored.id for stored in kept.runs()])) == CASES


# --- Slurm: job array and allocation give the report of a local run, also after failures

SHARDS = 3
# Laws, a case that LAMMPS refuses, neighbours, two ranks under a separate launcher.
NAMES = ("ranges", "near-rho0.linear", "refused.range-two-stars", "walls.stored.damped", "virials.rest.two-ranks")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Slurm]:
    with slurm.running() as running:
        yield running


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of an undivided run."""
    out = tmp_path_factory.mktemp("local") / "report"
    assert _eos_ref("run", *NAMES, "--out", str(out)).returncode == 0
    return out


@pytest.fixture
def kit(tmp_path: Path, local: Path) -> Path:
    """The kit in a folder whose name needs quotes; its costs are those of the local run."""
    folder = tmp_path / "my campaign"
    done = _eos_ref("kit", "slurm", "--shards", str(SHARDS), "--run", " ".join(NAMES), "--out", str(folder))
    assert done.returncode == 0, done.stderr
    assert "3 shards of " in done.stderr and done.stderr.endswith("measured\n") and " 0 of" not in done.stderr
    return folder


def _eos_ref(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lammps_cases.cli.main", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _array(cluster: Slurm, kit: Path, *tasks: str) -> tuple[str, str]:
    """Submit the array, and return its job and that of the merge."""
    words = cluster.call("bash", kit / "array.sh", *tasks).split()
    return words[1].rstrip(","), words[3].rstrip(":")


def _exit_code(keys: dict[str, str]) -> int:
    return int(keys["ExitCode"].partition(":")[0])


@pytest.mark.slurm
def test_job_array(cluster: Slurm, kit: Path, local: Path) -> None:
    array, merge = _array(cluster, kit)
    assert _exit_code(cluster.wait(merge)) == 0, (kit / "log" / "merge.txt").read_text()
    assert_same(local, kit / "report")
    assert {path.name for path in (kit / "shards").iterdir()} == {f"{k}.tar" for k in range(1, SHARDS + 1)}
    assert "KNOWN BUGS" in (kit / "log" / "merge.txt").read_text()
    assert {_exit_code(cluster.wait(f"{array}_{k}")) for k in range(1, SHARDS + 1)} == {0}


@pytest.mark.slurm
def test_one_allocation_requeued_when_a_shard_is_done(cluster: Slurm, kit: Path, local: Path) -> None:
    """Finished shards are not run again."""
    job = cluster.call("bash", kit / "allocation.sh").split()[-1]
    until = time.monotonic() + PATIENCE
    while not (done := [*(kit / "shards").glob("*.tar")]):
        assert time.monotonic() < until, (kit / "log" / "allocation.txt").read_text()
        time.sleep(PAUSE / 10)
    first = done[0].stat().st_mtime_ns
    cluster.call("scontrol", "requeue", job)
    keys = cluster.wait(job, "COMPLETED", "FAILED")
    said = (kit / "log" / "allocation.txt").read_text()
    assert (_exit_code(keys), keys["Restarts"]) == (0, "1"), said
    assert f"shard {done[0].stem} is done: {done[0]}" in said and "KNOWN BUGS" in said
    assert done[0].stat().st_mtime_ns == first
    assert_same(local, kit / "report")


@pytest.mark.slurm
def test_tasks_that_are_killed_and_requeued(cluster: Slurm, kit: Path, local: Path) -> None:
    """Requeued tasks start again; killed ones are named, leave nothing behind and can be rerun."""
    array, merge = _array(cluster, kit)
    for k in (1, 2):
        cluster.wait(f"{array}_{k}", "RUNNING")
    cluster.call("scontrol", "requeue", f"{array}_1")
    cluster.call("scancel", "--signal=KILL", "--full", f"{array}_2")
    assert _exit_code(cluster.wait(merge)) == 2
    assert cluster.wait(f"{array}_1")["Restarts"] == "1"
    assert "must be complete to be merged; missing 2/3\n" in (kit / "log" / "merge.txt").read_text()
    assert not (kit / "report").exists() and {path.name for path in (kit / "shards").iterdir()} == {"1.tar", "3.tar"}
    _, merge = _array(cluster, kit, "2")
    assert _exit_code(cluster.wait(merge)) == 0, (kit / "log" / "merge.txt").read_text()
    assert_same(local, kit / "report")


@pytest.mark.slurm
def test_differing_shard_fails_alone_and_fails_the_merge(
    cluster: Slurm, case_file: Callable[..., Path], tmp_path: Path
) -> None:
    refused = {"expect": {"refused": "no such text"}, "pressure": [{"types": "1-2", "style": "linear"}]}
    file = case_file(matrix={"which": {"a": {}, "b": refused, "c": {}}})
    assert _eos_ref("run", "--cases", str(file), "--out", str(tmp_path / "local")).returncode == 1
    folder = tmp_path / "kit"
    assert _eos_ref("kit", "slurm", "--shards", "3", "--run", f"--cases {file}", "--out", str(folder)).returncode == 0
    array, merge = _array(cluster, folder)
    assert _exit_code(cluster.wait(merge)) == 1
    assert sorted(_exit_code(cluster.wait(f"{array}_{k}")) for k in (1, 2, 3)) == [0, 0, 1]
    assert_same(tmp_path / "local", folder / "report")
