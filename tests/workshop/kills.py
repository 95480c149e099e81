"""A campaign of kills: ``eos-ref run`` is killed at random moments and resumed, until its report is whole."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import psutil

from lammps_cases.comparison import store
from lammps_cases.engine import mpi
from lammps_cases.records import folders
from lammps_cases.report.history import store as history
from tests.support import dask_cluster
from tests.support.resumed import report

NAMES = ("near-rho0", "ranges", "units.si", "refused.range-two-stars")
COMMAND = [sys.executable, "-m", "lammps_cases.cli.main", "run", *NAMES, "--json"]
PATIENCE = 120.0  # seconds that a run may take on a busy machine
GONE = 20.0  # seconds after which no process of a killed run may exist


class Kills:
    """Runs in a folder that are killed; what is wrong is an AssertionError.

    Attributes
    ----------
    counts : what was killed, and the outcome
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.random, self.counts = folder, random.Random(seed), Counter[str]()
        self.out = folder / "report"
        self.making = folders.making(self.out)
        self._seen = set[int]()
        self.mark = f"eos-ref-kills-{os.getpid()}-{seed}"
        (folder / "tmp").mkdir(parents=True)
        own = {store.VARIABLE: str(folder / "store"), history.VARIABLE: str(folder / "history.sqlite")}
        self.environment = {**os.environ, **own, "TMPDIR": str(folder / "tmp"), "EOS_REF_MARK": self.mark}
        begin = time.monotonic()
        self._finish(self._started(resume=False))
        self.seconds = time.monotonic() - begin
        self.expected = report(self.out, folder / "scratch")
        self.cases = [case["case"] for case in json.loads((self.out / "run.json").read_text())["cases"]]

    def round(self, most: int) -> int:
        """Run once, killed at most so often, to the whole report; return how often it was killed."""
        last = self.out.with_name("last")
        self.out.rename(last)
        for count in itertools.count():
            process = self._started(resume=True)
            if count == most or not self._killed(process):
                break
        self._finish(process)
        self.counts["whole reports"] += 1
        self._check()
        subprocess.run(["rm", "-rf", str(last)], check=True)
        return count

    def _started(self, resume: bool) -> subprocess.Popen[bytes]:
        options = [*self._options(), *(["--resume"] if resume else [])]
        fresh = ["--fresh"] if self.random.random() < 0.5 else []  # everything is judged again, or looked up
        words = [*COMMAND, "--out", str(self.out), *options, *fresh]
        with (self.folder / "printed").open("wb") as printed:
            return subprocess.Popen(
                words, env=self.environment, stdin=subprocess.DEVNULL, stdout=printed, stderr=printed
            )

    def _options(self) -> list[str]:
        """Return the number of concurrent LAMMPS processes, and where they run."""
        return ["--jobs", "2"]

    def _killed(self, process: subprocess.Popen[bytes]) -> bool:
        """Kill at a random moment; False if the run had ended before."""
        self._wait_for_the_moment(process)
        if not self._kill(process):
            return False
        self.counts["cases kept over a kill"] += len(list(self.making.glob("journal/cases/*.json")))
        return True

    def _kill(self, process: subprocess.Popen[bytes]) -> bool:
        """Kill the main process or a worker; False if the run has ended."""
        workers = [pid for pid in self._alive() if _is_worker(pid)]
        victim = self.random.choice([process.pid, *workers[:1]])
        if process.poll() is not None:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
        if victim != process.pid:
            self.counts["kills of a worker"] += 1
            self._finish(process)
            return True
        self.counts["kills of the main process"] += 1
        process.wait()
        self._await_end()
        return True

    def _wait_for_the_moment(self, process: subprocess.Popen[bytes]) -> None:
        """Wait for a random time, or for a random number of cases and a little longer, or for the end."""
        entries = self.making / "journal" / "cases"
        before = len(list(entries.glob("*.json")))
        many = self.random.choice([0, self.random.randint(before, len(self.cases))])
        deadline = time.monotonic() + self.random.uniform(0, 1) * self.seconds
        while process.poll() is None:
            if len(list(entries.glob("*.json"))) >= many if many else time.monotonic() > deadline:
                time.sleep(self.random.uniform(0, 0.1))
                break
            time.sleep(0.005)

    def _finish(self, process: subprocess.Popen[bytes]) -> None:
        """Wait for the end of a run that is not killed."""
        code = process.wait(PATIENCE)
        assert code == 0, (code, _wrong(self.folder / "printed"))
        self._await_end()

    def _await_end(self) -> None:
        deadline = time.monotonic() + GONE
        while alive := self._alive():
            assert time.monotonic() < deadline, f"processes are left behind: {alive}"
            time.sleep(0.02)

    def _alive(self) -> list[int]:
        """Return the processes of the run."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if f"EOS_REF_MARK={self.mark}".encode() in (process / "environ").read_bytes():
                    found.append(int(process.name))
        self._seen.update(found)
        return found

    def _check(self) -> None:
        """Compare the report with that of an undisturbed run, and look for leftovers."""
        scratch = Path(tempfile.mkdtemp(dir=self.folder))
        assert report(self.out, scratch) == self.expected, "not the report of an undisturbed run"
        subprocess.run(["rm", "-rf", str(scratch)], check=True)
        names = [case["case"] for case in json.loads((self.out / "run.json").read_text())["cases"]]
        assert names == self.cases, "lost or doubled"
        beside = {path.name for path in self.folder.iterdir()} - {"last", "scratch", "store", "history.sqlite"}
        assert beside == {"report", "tmp", "printed"}, beside
        shared = [pid for pid in self._seen if list(mpi.SHARED.glob(f"mpich_shm_{pid:x}_*")) and not _exists(pid)]
        self.counts["files of MPICH left"] += len(shared)
        self._seen.clear()
        self.counts["folders left among temporary files"] = len(list((self.folder / "tmp").glob("eos-ref-*")))


def _wrong(printed: Path) -> str:
    """Return the messages of a run that did not end well."""
    try:
        cases = json.loads(printed.read_text())["cases"]
    except (ValueError, KeyError):
        return printed.read_text()[-2000:]
    return "; ".join(
        f"{case['case']}: {case['verdict']} {case['message']}" for case in cases if case["verdict"] == "error"
    )


def _exists(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def _is_worker(pid: int) -> bool:
    """Return whether a process is a fork of a watch, which is one of the server, which is one of the run."""
    with contextlib.suppress(OSError):
        words = []
        for _ in range(4):
            words.append(Path(f"/proc/{pid}/cmdline").read_bytes())
            pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
        return len(set(words)) == 1
    return False


class DaskKills(Kills):
    """Runs on a Dask cluster, of which a worker or the scheduler is killed as well as the run itself."""

    def __init__(self, folder: Path, seed: int, stack: ExitStack) -> None:
        self._stack = stack.enter_context(ExitStack())
        self._begin_cluster()
        super().__init__(folder, seed)

    def _begin_cluster(self) -> None:
        self._stack.close()
        self._cluster = self._stack.enter_context(dask_cluster.running())

    def _options(self) -> list[str]:
        return ["--cluster", self._cluster.address]

    def _kill(self, process: subprocess.Popen[bytes]) -> bool:
        victim = self.random.choice(["the main process", "a Dask worker", "the Dask scheduler"])
        if process.poll() is not None:
            return False
        self.counts[f"kills of {victim}"] += 1
        if victim == "the main process":
            process.kill()
            process.wait()
            self._await_end()
        elif victim == "a Dask worker":
            started = self._cluster.kill_worker()
            self._cluster.add_worker()
            self._finish(process)
            assert not psutil.wait_procs(started, GONE)[1], "processes of a worker are left behind"
        else:
            self._cluster.scheduler.kill()
            code = process.wait(PATIENCE)
            # Already done, not yet connectable, or gone in between.
            assert code in (0, 2, 3), (code, _wrong(self.folder / "printed"))
            assert code != 2 or "scheduler" in (self.folder / "printed").read_text()
            self._await_end()
            self._begin_cluster()
        return True


def campaign(kills: int, runs: Kills) -> Counter[str]:
    """Kill runs so often; return the outcome."""
    while (done := sum(count for what, count in runs.counts.items() if what.startswith("kills of "))) < kills:
        runs.round(min(runs.random.randint(1, 6), kills - done))
        print(dict(runs.counts), file=sys.stderr, flush=True)
    return runs.counts
