"""A process pool in which each process has its own pipe, so that its death is attributed to the task it was running."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import multiprocessing
import os
import pickle
import queue
import re
import resource
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from multiprocessing import connection
from pathlib import Path
from typing import IO, Any, NamedTuple, Protocol

from lammps_cases.engine import apart, forkserver, mpi, ranks

MEMORY = "EOS_REF_MEMORY"  # environment variable: memory of each process, in place of its share of the machine
LARGEST = 2**32  # bytes of a file that a worker may write, such as an engine's endless output
TAIL = 2**16  # bytes of it that are read
RECYCLED = 5000  # tasks after which a process, which grows by some 10 kB with each, is replaced
FOLDER = "eos-ref-workers-"  # prefix of the folders of pools
OWNER = "owner"  # file in it
DYING = 5.0  # seconds that a process may take to end after its end of the pipe is closed
PAUSE = 0.1  # seconds before another process takes a task: the cause of the first one's end may persist
MAPPED = 2**22  # bytes from which on freed memory goes back to the system, whatever follows it
LEFT = 2**25  # bytes of smaller arrays that do not, where nothing follows them: the next arrays take them
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of malloc.h
# Exit codes that an engine hardly gives itself: by signals that nothing raises in its own process, and that of a
# worker whose end no one reported, or that did not start.
FROM_OUTSIDE = (-signal.SIGKILL, -signal.SIGTERM, forkserver.UNKNOWN)


class Pool(Protocol):
    """An executor of tasks: processes of this machine, or of others."""

    @property
    def count(self) -> int:
        """Return the number of tasks at a time, now."""

    @property
    def local(self) -> bool:
        """Return whether tasks run in processes of this machine."""

    def check_shared(self, folder: Path) -> None:
        """Raise `InputError` if tasks that write into a folder cannot."""

    def schedule(self, function: Callable[..., Any], arguments: tuple[Any, ...], time_limit: float) -> Future[Any]:
        """Queue a task; its future raises what the task raises, `EngineCrashed` or `TimeoutError`."""

    def stop(self) -> None:
        """End all processes at once, and cancel the queued tasks."""

    def finish(self) -> None:
        """End the processes after all tasks; may follow `stop`."""


# --- memory


def memory_share(workers: int) -> int:
    """Return the bytes of memory that each of some processes may take: `MEMORY`, or its share of the machine."""
    if text := os.environ.get(MEMORY):
        return size(text)
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return int(0.8 * total / workers)


def size(text: str) -> int:
    """Return the bytes of a text such as 4G.

    Raises
    ------
    InputError
    """
    match = re.fullmatch(r"(\d{1,15})([MGT])", text, re.ASCII)
    if match is None or not (most := int(match[1]) << {"M": 20, "G": 30, "T": 40}[match[2]]) < 2**63:
        from eos_ref.errors import InputError  # workers load a mutated reference after this module

        raise InputError("memory", "must be a whole number of M, G or T bytes, as 4G", text)
    return most


@contextlib.contextmanager
def limited(text: str) -> Iterator[None]:
    """Set the memory of each process of the pools that start within a block.

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


# --- inside a process of the pool


def _return_memory() -> None:
    """Keep glibc from raising that size to 32 MB, below which gaps between arrays stay in this process.

    It then would return all but the last 128 kB after every operation on arrays, and ask for them at the next one.
    """
    with contextlib.suppress(AttributeError):  # another C library
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, MAPPED)
        ctypes.CDLL(None).mallopt(_M_TRIM_THRESHOLD, LEFT)


def _prepare(folder: str, memory: int, parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    _return_memory()
    threading.Thread(target=ranks.die_with, args=(parent, folder), daemon=True).start()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # at once, where Python would wait for LAMMPS to return
    tempfile.tempdir = folder  # a killed worker's files are removed with the pool
    # Output of LAMMPS or the C++ runtime at its death belongs to the case, not on the terminal.
    handle = os.open(Path(folder) / str(os.getpid()), os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o600)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    with contextlib.suppress(OSError):
        os.setsid()  # the engine's processes are known by its group
    for limit, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_FSIZE, LARGEST)):
        _, hard = resource.getrlimit(limit)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(limit, (most, hard))


def _do(content: bytes, pipe: connection.Connection) -> Any:
    """Run a task after truncating the output of earlier ones, so that the last message is its own."""
    os.ftruncate(1, 0)
    function, arguments = pickle.loads(content)
    pipe.send_bytes(b"")  # started
    return function(*arguments)


def _work(handle: int, folder: str, memory: int, parent: int) -> None:
    _prepare(folder, memory, parent)
    pipe = connection.Connection(handle)
    with contextlib.suppress(EOFError, OSError):  # no one waits any more
        while True:
            pipe.send_bytes(apart.outcome(_do, pipe.recv_bytes(), pipe))


# --- in the parent


class _Slot:
    """One process at a time, and the pipe to it; one thread uses it, another may kill the process."""

    def __init__(self, folder: str, memory: int) -> None:
        self._arguments = folder, memory, os.getpid()
        self._process: forkserver.Fork | None = None
        self._changing = threading.RLock()
        self._tasks = 0
        self.stopped = False

    def ask(self, content: bytes, time_limit: float) -> bytes:
        """Return the answer to a task.

        Raises
        ------
        EOFError, OSError
            The process died without an answer.
        TimeoutError
        CancelledError
            The slot is stopped.
        """
        with self._changing:
            if self._process and (self._tasks == RECYCLED or self._process.poll() is not None):
                self.end()
            if not self._process:
                self._start()
        self._tasks += 1
        self._pipe.send_bytes(content)
        first = self._receive(None)  # its time begins when the process has started, and has imported what it needs
        return first or self._receive(time_limit)

    def _start(self) -> None:
        if self.stopped:
            raise CancelledError
        self._pipe, other = multiprocessing.Pipe()
        with other, Path(os.devnull).open("wb") as nowhere:
            self._process = forkserver.workers.fork(nowhere.fileno(), other.fileno(), _work, *self._arguments)
        self._tasks = 0

    def _receive(self, time_limit: float | None) -> bytes:
        assert self._process
        if not connection.wait([self._pipe, self._process.sentinel], time_limit):
            raise TimeoutError
        if not self._pipe.poll():  # an answer sent before its death is read first
            raise EOFError
        return self._pipe.recv_bytes()

    def end(self, within: float = 0.0) -> tuple[int, int]:
        """End the process unless it ends in time by itself; return its id and exit code, 0 if none started."""
        if not (process := self._process):
            return 0, forkserver.UNKNOWN
        connection.wait([process.sentinel], within)
        process.kill()
        code = process.wait()
        with self._changing:
            self._process = None
            self._pipe.close()
        return process.pid, code

    def kill(self) -> None:
        """Kill the process, if it runs."""
        with self._changing:
            if self._process:
                self._process.kill()


class _Task(NamedTuple):
    content: bytes
    time_limit: float
    future: Future[Any]


class LocalPool:
    """Processes of this machine, with a folder for their files.

    Parameters
    ----------
    count : number of processes, forked from `lammps_cases.engine.forkserver.workers`
    """

    local = True

    def __init__(self, count: int) -> None:
        forkserver.preload()
        remove_left()
        self._folder = tempfile.TemporaryDirectory(prefix=FOLDER)
        self._owner = _hold(Path(self._folder.name))
        self.count = count
        self._tasks = queue.SimpleQueue[_Task | None]()
        self._slots = [_Slot(self._folder.name, memory_share(count)) for _ in range(count)]
        self._threads = [threading.Thread(target=self._serve, args=(slot,), daemon=True) for slot in self._slots]
        for thread in self._threads:
            thread.start()

    def check_shared(self, folder: Path) -> None:
        """Do nothing: every process of this machine sees its folders."""

    def schedule(self, function: Callable[..., Any], arguments: tuple[Any, ...], time_limit: float) -> Future[Any]:
        """Queue a task, which another process repeats if the first is killed from outside."""
        if not self._threads:
            raise RuntimeError("the pool has ended")
        content = pickle.dumps((function, arguments), pickle.HIGHEST_PROTOCOL)
        task = _Task(content, time_limit, Future())
        self._tasks.put(task)
        return task.future

    def _serve(self, slot: _Slot) -> None:
        while task := self._tasks.get():
            if task.future.set_running_or_notify_cancel():
                self._settle(slot, task)
            del task
        slot.end()

    def _settle(self, slot: _Slot, task: _Task) -> None:
        try:
            succeeded, result = pickle.loads(self._ask(slot, task))
        except BaseException as error:
            succeeded, result = False, error.with_traceback(None)
        if succeeded:
            task.future.set_result(result)
        else:
            task.future.set_exception(result)

    def _ask(self, slot: _Slot, task: _Task) -> bytes:
        for again in (True, False):
            try:
                return slot.ask(task.content, task.time_limit)
            except TimeoutError:
                slot.end()
                raise TimeoutError(apart.beyond(task.time_limit)) from None
            except (EOFError, OSError) as error:
                process, code = slot.end(DYING)
                printed = self._printed(process) if process else str(error)
            if not again or code not in FROM_OUTSIDE:
                break
            time.sleep(PAUSE)
        raise ranks.crash_of_process(code, printed)

    def _printed(self, process: int) -> str:
        """Return the end of the output of a process."""
        file = Path(self._folder.name) / str(process)
        with contextlib.suppress(OSError), file.open("rb") as printed:
            printed.seek(max(0, file.stat().st_size - TAIL))
            return printed.read().decode(errors="replace")
        return ""

    def stop(self) -> None:
        """End all processes at once, and cancel the queued tasks."""
        for slot in self._slots:
            slot.stopped = True
        with contextlib.suppress(queue.Empty):
            while True:
                if task := self._tasks.get_nowait():
                    task.future.cancel()
                    task.future.set_running_or_notify_cancel()
        for slot in self._slots:
            slot.kill()
        self.finish()

    def finish(self) -> None:
        """End the processes after all tasks."""
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads:
            thread.join()
        self._threads = []
        for file in Path(self._folder.name).glob("[0-9]*"):  # one per worker process
            if not Path("/proc", file.name).exists():
                mpi.remove_shared_memory(int(file.name))
                with contextlib.suppress(OSError):
                    os.killpg(int(file.name), signal.SIGKILL)  # the engine's processes
        self._owner.close()
        self._folder.cleanup()


def _hold(folder: Path) -> IO[bytes]:
    """Return a file of a folder that stays locked as long as this process lives and has it open."""
    file = (folder / OWNER).open("xb")
    fcntl.flock(file, fcntl.LOCK_EX)
    return file


def remove_left() -> None:
    """Remove the folders of pools whose process was killed, with their answers."""
    for folder in Path(tempfile.gettempdir()).glob(f"{FOLDER}*"):
        with contextlib.suppress(OSError):  # another user's, or being made; or locked: its process lives
            if folder.lstat().st_uid == os.getuid():
                with (folder / OWNER).open("rb") as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(folder)
