"""Tasks run in a fork, isolated from this process: results, exceptions, deaths and time limits."""

from __future__ import annotations

import os
import signal
import time

import pytest

from lammps_cases.engine import apart
from lammps_cases.engine.session import EngineCrashed


def twice(number: int) -> int:
    return 2 * number


def refuse() -> None:
    raise ValueError("no")


def die(number: int) -> None:
    os.write(1, b"last words\n")
    os.kill(os.getpid(), number)


def test_result_and_exception() -> None:
    assert apart.call(twice, 21, time_limit=10.0) == 42
    with pytest.raises(ValueError, match="no"):
        apart.call(refuse, time_limit=10.0)
    assert apart.call(os.getpid, time_limit=10.0) != os.getpid()


def test_death_is_reported_with_the_last_output() -> None:
    with pytest.raises(EngineCrashed, match="LAMMPS' process was killed by SIGKILL: last words"):
        apart.call(die, signal.SIGKILL, time_limit=10.0)
    with pytest.raises(EngineCrashed, match="exited with code 7"):
        apart.call(os._exit, 7, time_limit=10.0)


def test_time_limit() -> None:
    begin = time.monotonic()
    with pytest.raises(TimeoutError, match="did not finish within the time limit"):
        apart.call(time.sleep, 60.0, time_limit=0.2)
    assert time.monotonic() - begin < 30
