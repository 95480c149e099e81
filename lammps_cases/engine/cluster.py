"""Tasks on the workers of a Dask cluster, in place of processes of this machine.

Every worker keeps processes with a LAMMPS each, as this machine would (`lammps_cases.engine.pool.LocalPool`): a
segfault, a hang or a time limit costs the same there as here. A task whose worker has gone is given to another.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, InvalidStateError
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lammps_cases.engine.pool import MEMORY, LocalPool, Pool
from lammps_cases.engine.session import EngineMissing

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 30  # seconds to wait for the scheduler, and for its first worker
DEATHS = 10  # workers that may be lost with a task before it is given up
_address: ContextVar[str] = ContextVar("cluster", default="")


def address() -> str:
    """Return the address of the scheduler whose workers are used; empty: this machine's own."""
    return _address.get()


@contextmanager
def used(scheduler: str) -> Iterator[None]:
    """Use the workers of a scheduler within a block."""
    token = _address.set(scheduler)
    try:
        yield
    finally:
        _address.reset(token)


# --- inside a worker of the cluster

_pools: dict[tuple[str | None, str], LocalPool] = {}
_lock = threading.Lock()


@dataclass(frozen=True)
class Answered:
    """A task's result, or the exception that it raised."""

    value: Any


def relay(
    memory: str, function: Callable[..., Any], arguments: tuple[Any, ...], time_limit: float
) -> Answered | BaseException:
    """Run a task in a process of this worker, which may take the given memory."""
    try:
        return Answered(_pool(arguments[0], memory).schedule(function, arguments, time_limit).result())
    except BaseException as error:
        return error


def _pool(site: str | None, memory: str) -> LocalPool:
    """Return the processes with this LAMMPS, as many as the worker has threads."""
    from distributed import get_worker

    with _lock:
        if (kind := (site, memory)) not in _pools:
            os.environ[MEMORY] = memory
            _pools[kind] = LocalPool(get_worker().state.nthreads)
            atexit.register(_pools[kind].stop)
        return _pools[kind]


# --- in the parent


def _is_gone(answer: object) -> bool:
    """Return whether a worker had lost its connection, as opposed to a missing file or permission."""
    return isinstance(answer, OSError) and (answer.errno is None or isinstance(answer, ConnectionError))


class ClusterPool:
    """The workers of a cluster.

    Raises
    ------
    InputError
        No dask.distributed, no scheduler, or a scheduler without workers.
    """

    local = False

    def __init__(self, scheduler: str) -> None:
        from eos_ref.errors import InputError

        self._scheduler = scheduler
        try:
            import dask
            from distributed import Client
            from distributed.comm import get_address_host_port
        except ImportError:
            raise InputError("--cluster", "needs dask.distributed: pip install 'eos-ref[cluster]'") from None
        for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
            logging.getLogger(name).setLevel(logging.CRITICAL)  # failures are reported through the futures
        try:
            if not scheduler.startswith("inproc:"):  # an address without a host leaves threads of a client behind
                get_address_host_port(scheduler if "://" in scheduler else f"tcp://{scheduler}", strict=True)
            with dask.config.set({"distributed.admin.low-level-log-length": 0}):  # of 1000 messages, with content
                self._client: Client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error).partition("\n")[0]
            raise InputError("--cluster", f"must be the address of a scheduler: {reason}", scheduler) from None
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            self._client.close()
            raise InputError("--cluster", f"has no worker after {PATIENCE} s", scheduler) from None
        except OSError:
            self._client.close()
            raise self._gone() from None
        self._under_way: dict[Future[Any], Any] = {}

    @property
    def count(self) -> int:
        """Return the number of tasks that the cluster runs at a time, now."""
        try:
            threads: dict[str, int] = self._client.nthreads()
        except OSError:
            raise self._gone() from None
        return max(1, sum(threads.values()))

    def check_shared(self, folder: Path) -> None:
        """Raise `InputError` if a present worker does not see a folder that tasks write into."""
        from eos_ref.errors import InputError

        try:
            sights = self._client.run(Path.is_dir, folder, on_error="return")
        except OSError:
            raise self._gone() from None
        blind = [worker for worker, sees in sights.items() if sees is not True and not _is_gone(sees)]
        if blind:
            raise InputError("--cluster", f"its workers must see {folder}; it is missing for", blind[0])

    def schedule(self, function: Callable[..., Any], arguments: tuple[Any, ...], time_limit: float) -> Future[Any]:
        """Queue a task."""
        future: Future[Any] = Future()
        self._submit(future, (function, arguments, time_limit), DEATHS)
        return future

    def _submit(self, future: Future[Any], task: tuple[Any, ...], left: int) -> None:
        from distributed import KilledWorker

        def settle(remote: Any) -> None:
            killed = remote.status == "error" and isinstance(remote.exception(), KilledWorker)
            # An answer lost with its worker, while the scheduler still runs.
            lost = remote.status == "lost" and self._client.status == "running"
            if (killed or lost) and left > 1:
                self._submit(future, task, left - 1)
                return
            self._under_way.pop(future, None)
            with contextlib.suppress(InvalidStateError):  # no one waits any more
                try:
                    self._hand_over(future, remote)
                except OSError:
                    future.set_exception(self._gone())

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about large arguments
            remote = self._client.submit(relay, os.environ.get(MEMORY, ""), *task, pure=False)
        self._under_way[future] = remote
        remote.add_done_callback(settle)

    def _gone(self) -> EngineMissing:
        return EngineMissing(f"the scheduler at {self._scheduler} is gone")

    def _hand_over(self, future: Future[Any], remote: Any) -> None:
        if remote.status == "finished":
            answer = remote.result()
            if isinstance(answer, Answered):
                future.set_result(answer.value)
            else:
                future.set_exception(answer)
        elif remote.status == "error":
            future.set_exception(remote.exception())
        else:
            future.set_exception(self._gone())

    def stop(self) -> None:
        """Drop the queued tasks, and leave the cluster."""
        with contextlib.suppress(OSError):
            self._client.cancel(list(self._under_way.values()), force=True)
        for future in list(self._under_way):
            future.cancel()
        self.finish()

    def finish(self) -> None:
        """Leave the cluster."""
        self._client.close()


def pool(count: int) -> Pool:
    """Return the pool of the cluster in use, or else of so many processes of this machine."""
    return ClusterPool(scheduler) if (scheduler := address()) else LocalPool(count)
