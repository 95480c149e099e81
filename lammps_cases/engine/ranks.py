"""Jobs and decks on several MPI ranks: mpiexec starts this module on each of them.

``python -m lammps_cases.engine.ranks FOLDER SITE PARENT`` is what a rank runs, job after job: each leaves its own
atoms, and `solve` joins them. LAMMPS initialises MPI itself, and files carry the jobs and the answers, so that this
package needs no MPI. ``python -m lammps_cases.engine.ranks DECK SITE`` runs a deck.
"""

from __future__ import annotations

import atexit
import fcntl
import itertools
import os
import pickle
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np

from lammps_cases.engine import mpi
from lammps_cases.engine.interlude import Carried
from lammps_cases.engine.session import (
    Answer,
    Array,
    EngineCrashed,
    EngineLacks,
    EngineMissing,
    EngineRefused,
    Job,
    Session,
    death,
    how_it_died,
    kept,
    package_directory,
)

PAUSE = 0.002  # seconds between two checks for the answers of all ranks
RUN = re.compile(r"^[ \t]*run\s.*", re.MULTILINE)


def die_with(parent: int, folder: str = "") -> None:
    """End this process, and remove a folder, when another has ended: LAMMPS in a long run notices no closed pipe."""
    while True:
        try:
            os.kill(parent, 0)
        except OSError:
            mpi.remove_shared_memory(os.getpid())
            if folder:
                shutil.rmtree(folder, ignore_errors=True)
            if os.getpgrp() == os.getpid():  # a worker, and the processes its engine started
                os.killpg(0, signal.SIGKILL)
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.5)


# The command that runs this module in its own process, given its arguments.
PROGRAM = (sys.executable, "-P", "-m", "lammps_cases.engine.ranks")


def _with_packages(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment in which this package is found, also in the current folder, as in a checkout."""
    paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**environment, "PYTHONPATH": os.pathsep.join(paths)}


class Ranks:
    """LAMMPS on several processes, which run one job after another and die with this one.

    A context manager, which ends them.
    """

    def __init__(self, site: str | None, count: int) -> None:
        command, environment = mpi.launcher(package_directory(site).parent, count)
        self.count = count
        self._jobs = 0
        self._folder = tempfile.TemporaryDirectory(prefix="eos-ref-ranks-")
        self._path = Path(self._folder.name)
        self._next = self._held(0)
        with (self._path / "output").open("wb") as output:
            self._process = subprocess.Popen(
                [*command, *PROGRAM, self._folder.name, site or "", str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=_with_packages(environment),
            )

    @property
    def pid(self) -> int:
        """Return the id of the process that started the others."""
        return self._process.pid

    def _held(self, number: int) -> IO[bytes]:
        """Return the file of a job, locked: ranks wait for the lock, which costs nothing, until the job is in it."""
        file = (self._path / f"job.{number}").open("xb")
        fcntl.flock(file, fcntl.LOCK_EX)
        return file

    def run(self, job: Job) -> Answer:
        """Run one job; after an exception the processes have ended."""
        mask = f"rank.{self._jobs}.*"
        self._jobs += 1
        following = self._held(self._jobs)
        with self._next as job_file:
            pickle.dump(job, job_file)
            job_file.flush()
            fcntl.flock(job_file, fcntl.LOCK_UN)  # a fork of this process may have the file open, too
        self._next = following
        while self._process.poll() is None and len(list(self._path.glob(mask))) < self.count:
            time.sleep(PAUSE)
        files = sorted(self._path.glob(mask))
        answers = [pickle.loads(file.read_bytes()) for file in files]
        if len(files) == self.count:  # all of them have read the job
            for file in (*files, self._path / f"job.{self._jobs - 1}"):
                file.unlink()
        for outcome in answers:
            if isinstance(outcome, Exception):
                self._process.wait()
                raise outcome
        if len(answers) != self.count:
            raise crash((self._path / "output").read_text(errors="replace"), self._process.wait())
        return _joined(answers)

    def end(self) -> None:
        """Stop the processes."""
        self._process.terminate()
        self._process.wait()
        self._next.close()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()


_kept: dict[tuple[str | None, int], Ranks] = {}


def kept_ranks(site: str | None, count: int) -> Ranks:
    """Return the ranks that this process keeps: starting them takes as long as a dozen small jobs."""
    if (site, count) not in _kept:
        _kept[site, count] = Ranks(site, count)
    return _kept[site, count]


@atexit.register
def end_kept() -> None:
    """End the ranks that this process keeps."""
    while _kept:
        _kept.popitem()[1].end()


def solve(site: str | None, job: Job) -> Answer:
    """Run one job on ``job.ranks`` processes.

    Raises
    ------
    EngineRefused, EngineMissing
        Raised by a rank.
    EngineLacks
        LAMMPS was built without MPI, or there is no launcher of its MPI.
    EngineCrashed
        A rank died without an error message of LAMMPS.
    """
    with kept(site).use() as lmp:
        require_mpi(lmp, job.ranks)
    try:
        return kept_ranks(site, job.ranks).run(job)
    except mpi.LauncherMissing as error:
        raise EngineLacks(str(error)) from None
    except Exception:  # any exception, from LAMMPS or before it: ranks in doubt run no other job
        if failed := _kept.pop((site, job.ranks), None):
            failed.end()
        raise


def launcher_of(site: str | None, count: int = 2) -> str:
    """Task: return the command that starts some ranks.

    Raises
    ------
    EngineLacks
    """
    return shlex.join(_launcher(site, count)[0])


def _launcher(site: str | None, count: int) -> tuple[list[str], dict[str, str]]:
    with kept(site).use() as lmp:
        require_mpi(lmp, count)
    try:
        return mpi.launcher(package_directory(site).parent, count)
    except mpi.LauncherMissing as error:
        raise EngineLacks(str(error)) from None


def require_mpi(lmp: Any, count: int) -> None:
    """Raise if a LAMMPS cannot run on several ranks.

    Raises
    ------
    EngineLacks
    """
    if not lmp.has_mpi_support:
        raise EngineLacks(f"{count} ranks need MPI, and this LAMMPS was built without")


def require_size(lmp: Any, count: int) -> None:
    """Raise unless the ranks have been started as those of one LAMMPS.

    Raises
    ------
    EngineMissing
    """
    size = lmp.extract_setting("world_size")
    if size != count:
        raise EngineMissing(f"mpiexec and LAMMPS' MPI do not fit: {size} rank instead of {count}")


def last_lines(text: str) -> str:
    """Return the last lines of an output for a message: a colon and at most 300 characters, or nothing."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return f": {' / '.join(lines[-3:])[:300]}" if lines else ""


def crash_of_process(code: int, printed: str) -> EngineCrashed:
    """Return how a process ended, with the last lines of its output."""
    return EngineCrashed(f"LAMMPS' process {how_it_died(code)}{last_lines(printed)}", death(code))


def crash(text: str, code: int) -> EngineCrashed:
    """Return how mpiexec reports the end, with the last lines that the ranks printed before its banner."""
    end = re.search(r"EXIT STRING: (.*?)(?:\(signal (\d+)\))?$", text, re.MULTILINE)  # MPICH
    end = end or re.search(r"(exited) on signal (\d+)", text)  # Open MPI
    how, died = f"ended with {end[1].strip() if end else f'code {code}'}", death(code)
    if end and end[2]:  # the name it has for a single process, by which the ledger identifies a crash
        how, died = how_it_died(-int(end[2])), death(-int(end[2]))
    return EngineCrashed(f"LAMMPS on several ranks {how}{last_lines(text.split(20 * '=')[0])}", died)


def _joined(answers: list[Answer]) -> Answer:
    """Join the atoms of all ranks, sorted by id."""
    snapshots = [_atoms_of(parts) for parts in zip(*(answer.snapshots for answer in answers), strict=True)]
    carried = tuple(
        Carried(_atoms_of([part.before for part in parts]), _atoms_of([part.after for part in parts]))
        for parts in zip(*(answer.carried for answer in answers), strict=True)
    )
    seconds = max(answer.seconds for answer in answers)
    slowest = tuple(max(parts) for parts in zip(*(answer.run_seconds for answer in answers), strict=True))
    lists = tuple(_joined_list(parts) for parts in zip(*(answer.lists for answer in answers), strict=True))
    return Answer(snapshots[-1], seconds, tuple(snapshots), answers[0].steps, slowest, lists, carried)


def _joined_list(parts: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """Join the neighbour lists of all ranks, whose atoms are numbered on from those of the rank before."""
    first_s = np.cumsum([0, *(len(part["id_s"]) for part in parts[:-1])])
    pairs = [part["pair_ps"] + first for part, first in zip(parts, first_s, strict=True)]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in ("id_s", "x_sc", "own_s", "low_rc")}
    rank_s = np.repeat(np.arange(len(parts)), [len(part["id_s"]) for part in parts])
    return parts[0] | joined | {"pair_ps": np.concatenate(pairs), "rank_s": rank_s}


def _atoms_of(parts: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """Join the arrays of all ranks, sorted by id."""
    order_n = np.argsort(np.concatenate([part["id"] for part in parts]), kind="stable")
    return {name: np.concatenate([part[name] for part in parts])[order_n] for name in parts[0]}


def played(
    site: str | None,
    deck: Path,
    count: int,
    steps: int = 0,
    newton: bool | None = None,
    moved: float = 0.0,
    timeout: float = 120.0,
) -> str:
    """Task: return the log of a deck on some number of ranks, with all digits of its thermo output.

    Parameters
    ----------
    deck : Path
        It is read as far as its first run command.
    count : int
        Number of ranks.
    steps : int
        That it runs.
    newton : bool, optional
        A setting to use in place of the deck's.
    moved : float
        Largest random displacement of every atom along x and y, in units of the deck.

    Raises
    ------
    EngineLacks
        This LAMMPS was built without MPI, or there is no launcher.
    EngineRefused
        LAMMPS stopped with an error, or took too long.
    """
    command, environment = _launcher(site, count) if count > 1 else ([], dict(os.environ))
    with tempfile.TemporaryDirectory(prefix="eos-ref-played-") as folder:
        begun, log = Path(folder) / "in.begun", Path(folder) / "log"
        begun.write_text(_begun(deck.read_text(), log, steps, newton, moved))
        try:
            outcome = subprocess.run(
                [*command, *PROGRAM, str(begun), site or ""], cwd=deck.parent, stdin=subprocess.DEVNULL,
                capture_output=True, text=True, timeout=timeout, env=_with_packages(environment), check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise EngineRefused(f"no end within {timeout:g} s") from None
        text = log.read_text(errors="replace") if log.exists() else ""
    if "Loop time" in text:
        return text
    printed = [line for line in (outcome.stderr + outcome.stdout).splitlines() if line.strip()]
    raise EngineRefused(printed[-1].strip() if printed else f"LAMMPS ended with exit status {outcome.returncode}")


def _begun(text: str, log: Path, steps: int, newton: bool | None, moved: float) -> str:
    """Return a deck up to its first run, which takes some steps and is logged."""
    run = RUN.search(text)
    text = text[: run.start()] if run else text
    if newton is not None:
        text = re.sub(r"^[ \t]*newton\s.*", f"newton {'on' if newton else 'off'}", text, flags=re.MULTILINE)
    move = f"displace_atoms all random {moved} {moved} 0 1 units box\n" if moved else ""
    return f"{text}\n{move}log {log}\nthermo_modify format float %24.17g\nrun {steps}\n"


# --- inside a rank ---


def _rank(folder: Path, site: str | None) -> None:
    for number in itertools.count():
        with (folder / f"job.{number}").open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH)
            content = file.read()
        outcome: Answer | Exception
        try:
            job = pickle.loads(content)
            session = kept(site)
            with session.use() as lmp:
                require_size(lmp, job.ranks)
            outcome = session.run(job, str(folder))
        except Exception as error:
            outcome = error
        written = folder / f"part.{os.getpid()}"
        written.write_bytes(pickle.dumps(outcome))
        written.rename(folder / f"rank.{number}.{os.getpid()}")  # never half a file
        if isinstance(outcome, Exception):
            os._exit(1)  # other ranks may wait for this one for ever; mpiexec ends them


if __name__ == "__main__":
    if len(sys.argv) == 3:
        with Session(sys.argv[2] or None) as lmp:
            lmp.file(sys.argv[1])
    else:
        threading.Thread(target=die_with, args=(int(sys.argv[3]),), daemon=True).start()
        _rank(Path(sys.argv[1]), sys.argv[2] or None)
