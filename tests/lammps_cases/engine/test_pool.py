"""A worker's death is that of the task that it had begun last, however late its messages are read."""

from __future__ import annotations

import os
import threading
from typing import Any

import pytest
from pebble import ProcessExpired
from pebble.pool.process import PoolManager, WorkerManager

from lammps_cases.engine import forkserver
from lammps_cases.engine.pool import OrderedPool

LONG = 20.0  # seconds


@pytest.mark.slow
def test_a_death_is_told_after_what_was_said_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, told = threading.Event(), threading.Event()
    create, tell = WorkerManager.create_channels, PoolManager.handle_worker_expiration

    def creating(self: Any) -> None:
        create(self)
        poll = self.pool_channel.poll

        def late(timeout: float) -> bool:
            if timeout and begun.is_set():  # in the thread that reads; the one that tells deaths does not wait
                told.wait(LONG)
            return bool(poll(timeout))

        self.pool_channel.poll = late

    def telling(self: Any, expiration: tuple[int, int]) -> None:
        tell(self, expiration)
        told.set()

    monkeypatch.setattr(WorkerManager, "create_channels", creating)
    monkeypatch.setattr(PoolManager, "handle_worker_expiration", telling)
    pool = OrderedPool(max_workers=1, context=forkserver.context())
    try:
        assert pool.schedule(abs, [-1]).result(LONG) == 1
        begun.set()
        done, died, after = pool.schedule(abs, [-2]), pool.schedule(os._exit, [3]), pool.schedule(abs, [-4])
        assert done.result(LONG) == 2
        with pytest.raises(ProcessExpired) as death:
            died.result(LONG)
        assert death.value.exitcode == 3
        assert after.result(LONG) == 4
    finally:
        pool.stop()
        pool.join()
