"""A pool of processes that tells the death of a worker of the task which the worker had begun last."""

from __future__ import annotations

import threading
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pebble import ProcessPool
from pebble.pool.process import PoolManager


class OrderedPool(ProcessPool):  # type: ignore[misc]
    """`pebble.ProcessPool`, in which a death is told after all that the worker had said before.

    Pebble looks for dead workers in one thread and reads their messages in another. Where the reader is late, a death
    is that of the task before, whose result lies unread, and the task that died is waited for until its time limit.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._pool_manager = _OrderedManager(self._context, options["context"])


class _OrderedManager(PoolManager):  # type: ignore[misc]
    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._reading = threading.Lock()

    def process_next_message(self, timeout: float) -> None:
        """Process a message if there is one in time; one thread at a time does."""
        if self._is_waiting(timeout):
            with self._reading:
                super().process_next_message(0)

    def handle_worker_expiration(self, expiration: tuple[int, int]) -> None:
        """Tell a death, after the messages that lie unread and the one that is being processed."""
        with self._reading:
            while self._is_waiting(0):
                super().process_next_message(0)
        super().handle_worker_expiration(expiration)

    def _is_waiting(self, timeout: float) -> bool:
        try:
            return bool(self.worker_manager.pool_channel.poll(timeout))
        except OSError as error:  # the pool was stopped meanwhile
            raise BrokenProcessPool from error
