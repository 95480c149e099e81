"""A pool of processes that tells the death of a worker of the task which the worker had begun last."""

from __future__ import annotations

import fcntl
import os
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import reduction
from typing import Any

from pebble import CONSTS, ProcessPool
from pebble.pool.channel import ChannelError, ChannelMutex
from pebble.pool.process import PoolManager

SIZE = 8  # bytes of the number of a process
CONSTS.sleep_unit = 0.02  # seconds between two looks at the workers: Pebble's 0.1 are what a death, or the end, costs


class OrderedPool(ProcessPool):  # type: ignore[misc]
    """`pebble.ProcessPool`, in which a death is told after all that the worker had said before.

    Pebble looks for dead workers in one thread and reads their messages in another. Where the reader is late, a death
    is that of the task before, whose result lies unread, and the task that died is waited for until its time limit.

    All workers share two pipes. One that is killed while it reads or writes leaves a message in two and, with Pebble's
    semaphores, the pipe locked for the others, which end after a minute: here the pool breaks down at once.

    Parameters
    ----------
    broken : what is called in a thread of its own when the pool breaks down, which may leave queued tasks open for ever
    """

    def __init__(self, broken: Callable[[], None] | None = None, **options: Any) -> None:
        super().__init__(**options)
        self._pool_manager = _OrderedManager(self._context, options["context"])
        self._pool_manager.broken = broken


class _OrderedManager(PoolManager):  # type: ignore[misc]
    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._reading = threading.Lock()
        self.broken: Callable[[], None] | None = None

    def handle_broken_pool(self, error: BrokenProcessPool) -> None:
        """End the tasks that were handed out, and tell."""
        super().handle_broken_pool(error)
        if self.broken:
            threading.Thread(target=self.broken, daemon=True).start()

    def start(self) -> None:
        """Start the workers, whose pipes are locked by what tells in whose hands they were."""
        self.worker_manager.create_channels()
        self.worker_manager.workers_channel.mutex = _Mutex()
        self.worker_manager.create_workers()

    def process_next_message(self, timeout: float) -> None:
        """Process a message if there is one in time; one thread at a time does."""
        if self._is_waiting(timeout):
            with self._reading:
                super().process_next_message(0)

    def handle_worker_expiration(self, expiration: tuple[int, int]) -> None:
        """Tell a death, after the messages that lie unread and the one that is being processed."""
        alive = {0, os.getpid(), *self.worker_manager.workers}
        if self.worker_manager.workers_channel.mutex.holders() - alive:
            raise BrokenProcessPool("one ended while it took a task or gave an answer")
        with self._reading:
            while self._is_waiting(0):
                super().process_next_message(0)
        super().handle_worker_expiration(expiration)

    def _is_waiting(self, timeout: float) -> bool:
        try:
            return bool(self.worker_manager.pool_channel.poll(timeout))
        except OSError as error:  # the pool was stopped meanwhile
            raise BrokenProcessPool from error


class _Mutex(ChannelMutex):  # type: ignore[misc]
    """Pebble's pair of locks, of the pipe to the workers and the one from them."""

    def __init__(self) -> None:
        self.__setstate__((_RecordLock(), _RecordLock()))

    def holders(self) -> set[int]:
        """Return the processes that have them, or died with them."""
        return {self.reader_mutex.holder(), self.writer_mutex.holder()}

    def unlink(self) -> None:
        """Let the locks go, with their pool."""
        self.reader_mutex.close()
        self.writer_mutex.close()


class _RecordLock:
    """A lock among processes, each of one thread, that the system releases when its holder dies; a POSIX record lock.

    Its file holds the process that has it, for who finds it dead.
    """

    def __init__(self, handle: int | None = None) -> None:
        self._file = os.fdopen(_unnamed() if handle is None else handle, "r+b", buffering=0)
        self._depth = 0

    def __getstate__(self) -> Any:
        return reduction.DupFd(self._file.fileno())

    def __setstate__(self, copy: Any) -> None:
        self.__init__(copy.detach())  # type: ignore[misc]

    def acquire(self, block: bool = True, timeout: float | None = None) -> bool:
        """Take the lock, once more if this process has it; wait for it as long as its holder lives.

        Raises
        ------
        ChannelError
            Somebody died with it: what it guards is in a state that nobody knows.
        """
        if not self._depth:
            try:
                fcntl.lockf(self._file, fcntl.LOCK_EX | (0 if block else fcntl.LOCK_NB), SIZE)
            except BlockingIOError:
                return False
            if self.holder():
                raise ChannelError("somebody died with the lock")
            self._write(os.getpid())
        self._depth += 1
        return True

    def release(self) -> None:
        self._depth -= 1
        if not self._depth:
            self._write(0)
            fcntl.lockf(self._file, fcntl.LOCK_UN, SIZE)

    def holder(self) -> int:
        """Return the process that has the lock, or died with it; 0: none."""
        return int.from_bytes(os.pread(self._file.fileno(), SIZE, 0))

    def close(self) -> None:
        self._file.close()

    def _write(self, process: int) -> None:
        os.pwrite(self._file.fileno(), process.to_bytes(SIZE), 0)


def _unnamed() -> int:
    """Return a file that goes with its last process, where there can be one without a disk."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("eos-ref-lock")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
