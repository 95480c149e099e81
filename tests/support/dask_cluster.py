"""A Dask cluster on loopback: a scheduler and workers in separate processes, which a test may kill."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil

PATIENCE = 60.0  # seconds that a scheduler may take to start
PAUSE = 0.05


@dataclass
class DaskCluster:
    """A scheduler and its workers, in the order of their start."""

    address: str
    folder: Path
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def add_worker(self, nanny: bool = False) -> None:
        """Start a worker, alone or with the nanny of `dask worker`, which would restart it."""
        options = [
            "--nanny" if nanny else "--no-nanny",
            "--nthreads",
            "1",
            "--no-dashboard",
            "--local-directory",
            str(self.folder),
        ]
        self.workers.append(_started(self.folder / f"worker-{len(self.workers)}", "worker", self.address, *options))

    def kill_worker(self) -> list[psutil.Process]:
        """Kill the oldest worker; return the processes that it had started."""
        worker = self.workers.pop(0)
        started: list[psutil.Process] = psutil.Process(worker.pid).children(recursive=True)
        worker.send_signal(signal.SIGKILL)
        worker.wait()
        return started


@contextmanager
def running(workers: int = 2, nanny: bool = False) -> Iterator[DaskCluster]:
    """Start a cluster, and end it."""
    with ExitStack() as stack:
        folder = Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="eos-ref-dask-", ignore_cleanup_errors=True))
        )
        log = folder / "scheduler"
        scheduler = _started(log, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        until = time.monotonic() + PATIENCE
        while not (found := re.search(r"tcp://127\.0\.0\.1:\d+", log.read_text())):
            assert time.monotonic() < until, log.read_text()
            time.sleep(PAUSE)
        cluster = DaskCluster(found[0], folder, scheduler)
        stack.callback(_end, cluster)
        for _ in range(workers):
            cluster.add_worker(nanny)
        yield cluster


def _started(log: Path, what: str, *options: str) -> subprocess.Popen[bytes]:
    with log.open("wb") as output:
        command = [sys.executable, "-m", "distributed.cli.dask_" + what, *options]
        return subprocess.Popen(command, stdout=output, stderr=output, env={**os.environ, "PYTHONWARNINGS": ""})


def _end(cluster: DaskCluster) -> None:
    for process in (*cluster.workers, cluster.scheduler):
        process.terminate()
    for process in (*cluster.workers, cluster.scheduler):
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
