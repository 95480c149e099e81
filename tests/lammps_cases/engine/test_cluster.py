"""Tasks on a Dask cluster: a real scheduler and real workers on loopback, some killed during a run."""

from __future__ import annotations

import contextlib
import errno
import gc
import json
import os
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from distributed.comm import CommClosedError
from distributed.protocol import Serialized

from eos_ref import InputError
from lammps_cases.engine import cluster
from lammps_cases.engine.pool import limited
from lammps_cases.engine.session import EngineMissing
from lammps_cases.engine.workers import Workers
from lammps_cases.studies.chart import codes, laws
from tests.support import dask_cluster
from tests.support.dask_cluster import PAUSE, DaskCluster
from tests.support.outcome import Outcome
from tests.support.same_reports import assert_same

pytestmark = [pytest.mark.lammps, pytest.mark.slow]

Run = Callable[..., Outcome]
# Laws, a crash that is expected, a model, two ranks.
CASES = ("near-rho0.linear", "ranges", "refused.range-two-stars", "walls.stored.damped", "virials.rest.two-ranks")
LIMIT = 60.0


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("local") / "report"
    _done("run", *CASES, "--out", out)
    return out


@pytest.fixture(scope="module")
def steady() -> Iterator[DaskCluster]:
    """A cluster in which nothing is killed; a nanny starts its worker, as with `dask worker`."""
    with dask_cluster.running(1, nanny=True) as one:
        yield one


@pytest.fixture
def dask() -> Iterator[DaskCluster]:
    with dask_cluster.running() as one:
        yield one


def _begun(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "lammps_cases.cli.main", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _done(*arguments: object) -> str:
    process = _begun(*arguments)
    out, err = process.communicate()
    assert process.returncode == 0, out + err
    return out


def _wait_for_cases(folder: Path, count: int, process: subprocess.Popen[str]) -> None:
    """Wait until a run has judged some cases."""
    while sum(path.parent.name == "cases" for path in folder.rglob("*.json")) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(PAUSE)


def test_killed_workers_lose_no_case_and_a_killed_scheduler_is_resumed_from(
    dask: DaskCluster, local: Path, tmp_path: Path
) -> None:
    whole = ("run", *CASES, "--cluster", dask.address, "--out", tmp_path / "whole" / "report")
    process = _begun(*whole)
    for count in (1, 4, 8):
        _wait_for_cases(tmp_path / "whole", count, process)
        dask.kill_worker()
        dask.add_worker()
    out, err = process.communicate()
    assert process.returncode == 0 and "KNOWN BUGS" in out, out + err
    assert_same(local, tmp_path / "whole" / "report")

    report = tmp_path / "cut" / "report"
    process = _begun(*whole[:-1], report)
    _wait_for_cases(tmp_path / "cut", 3, process)
    dask.scheduler.kill()
    _, err = process.communicate()
    assert process.returncode == 3 and f"the scheduler at {dask.address} is gone" in err and "Traceback" not in err
    assert not report.exists()
    _done("run", *CASES, "--resume", "--out", report)
    assert_same(local, report)


def _timeless(document: Any) -> Any:
    """Remove what depends on the time and place of making a document."""
    if isinstance(document, list):
        return [_timeless(each) for each in document]
    if isinstance(document, dict):
        return {key: _timeless(each) for key, each in document.items() if key not in ("seconds", "command", "machine")}
    return document


def test_stability_is_the_same_on_the_cluster(steady: DaskCluster, tmp_path: Path) -> None:
    """One cell of a stability map."""
    command = ("stability", "--cell", "laws-tait-overflow::0.1:2.3", "--json", "--out", tmp_path)
    here, there = (_timeless(json.loads(_done(*command, *where))) for where in ((), ("--cluster", steady.address)))
    assert here == there


def test_whole_codes_are_timed_locally_on_the_requested_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A LAMMPS other than the installed one was ignored, and the installed one timed."""
    seen = list[tuple[str, str | None]]()

    def workers(site: str | None, count: int) -> Any:
        seen.append((cluster.address(), site))
        return contextlib.nullcontext()

    monkeypatch.setattr(codes, "Workers", workers)
    monkeypatch.setattr(codes, "COMPARED", ())
    with cluster.used("tcp://127.0.0.1:1"):
        assert list(codes.codes(True, "/opt/other", None)) == []
    assert seen == [("", "/opt/other")]


# --- tasks


def process(site: str | None) -> int:
    return os.getpid()


def memory(site: str | None) -> int:
    return resource.getrlimit(resource.RLIMIT_AS)[0]


def length(site: str | None, content: bytes) -> int:
    return len(content)


def abort(site: str | None) -> None:
    print("last words", flush=True)
    os.abort()


def sleep(site: str | None) -> None:
    time.sleep(600)


def raise_memory_error(site: str | None) -> None:
    raise MemoryError


class Hidden(type(Path())):
    """A folder that a worker may not access."""

    def stat(self, **options: Any) -> Any:
        raise PermissionError(errno.EACCES, "no right")


class Unanswered(type(Path())):
    """A folder whose check fails because the worker has left."""

    def stat(self, **options: Any) -> Any:
        raise CommClosedError("in <TCP (closed)>")


def test_worst_errors_of_a_chart_are_searched_on_the_cluster(steady: DaskCluster) -> None:
    tasks = [(laws.LAWS[1], method, laws.REGIMES[2], 64) for method in ("textbook", "numpy")]
    here = laws.each(laws.worst_of, tasks)
    with cluster.used(steady.address):
        assert laws.each(laws.worst_of, tasks) == here
        assert laws.each(process, [()]) != [os.getpid()]
        with pytest.raises(EngineMissing, match="a worker of the cluster failed: out of memory"):
            laws.each(raise_memory_error, [()])


def test_workers_must_see_folders_and_keep_no_arguments(steady: DaskCluster, tmp_path: Path) -> None:
    with cluster.used(steady.address), limited("3G"), Workers(None, 1) as workers:
        assert workers.outcome(workers.call(memory, time_limit=LIMIT)) == 3 * 2**30
        workers.check_shared(tmp_path)
        workers.check_shared(Unanswered(tmp_path))  # a lost worker is ignored
        for folder in (Hidden(tmp_path), tmp_path / "none"):
            with pytest.raises(InputError, match=r"workers must see .*; it is missing for, found 'tcp://"):
                workers.check_shared(folder)
        for _ in range(30):
            assert workers.outcome(workers.call(length, bytes(1000), time_limit=LIMIT)) == 1000
        gc.collect()
        assert sum(isinstance(each, Serialized) for each in gc.get_objects()) < 5


def test_failures_equal_those_of_local_workers(steady: DaskCluster) -> None:
    def failures() -> list[Any]:
        with Workers(None, 1) as workers:
            limits = {abort: LIMIT, sleep: 1.0, raise_memory_error: LIMIT}
            futures = [workers.call(task, time_limit=limit) for task, limit in limits.items()]
            return [workers.outcome(future) for future in futures]

    here = failures()
    with cluster.used(steady.address):
        assert failures() == here
    assert [failure.verdict for failure in here] == ["crashed", "timeout", "crashed"]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "tcp://"])
def test_no_scheduler(address: str, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 1)
    code, out, err = eos_ref_command("run", "ranges.star", "--cluster", address, "--out", tmp_path / "report")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("eos-ref: --cluster: must be the address of a scheduler: ") and address in err
    assert not (tmp_path / "report").exists() and not cluster.address()


def test_address_without_a_port_leaves_no_threads() -> None:
    before = set(threading.enumerate())
    with pytest.raises(InputError, match="must be the address of a scheduler: missing port"):
        cluster.ClusterPool("nowhere")
    assert set(threading.enumerate()) <= before
