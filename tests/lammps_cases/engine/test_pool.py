"""A worker's death is attributed to the task it was running and reported after its last result."""

from __future__ import annotations

import os

import pytest

from lammps_cases.engine.pool import LocalPool
from lammps_cases.engine.session import EngineCrashed

LONG = 20.0  # seconds


@pytest.mark.slow
@pytest.mark.parametrize("fresh", [False, True])
def test_worker_death_is_reported_after_its_last_result(fresh: bool) -> None:
    pool = LocalPool(1, fresh)
    try:
        tasks = [(abs, (-2,)), (os._exit, (3,)), (abs, (-4,))]
        done, died, after = (pool.schedule(*task, LONG) for task in tasks)
        assert done.result(LONG) == 2
        with pytest.raises(EngineCrashed) as death:
            died.result(LONG)
        assert death.value.died == "exit code 3"
        assert after.result(LONG) == 4
    finally:
        pool.stop()
    with pytest.raises(RuntimeError, match="has ended"):
        pool.schedule(abs, (-5,), LONG)
