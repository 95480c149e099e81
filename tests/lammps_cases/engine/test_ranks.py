"""LAMMPS on several ranks: the processes take one job after another, and new ones come after a failure."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from lammps_cases.engine import ranks
from lammps_cases.engine.session import EngineCrashed, EngineRefused, Job, RunCommand
from lammps_cases.run import campaign
from lammps_cases.scene import casefile

pytestmark = pytest.mark.lammps


@pytest.fixture
def job() -> Iterator[Job]:
    case = casefile.select(casefile.load(), ("twins.fluid.ranks",))[0]
    yield next(job for job in campaign.prepare(case).jobs if job.ranks > 1)
    ranks.processes(None, 2).end()
    ranks.processes.cache_clear()


def _processes() -> int:
    return ranks.processes(None, 2)._process.pid


def test_one_job_after_another_gives_the_same_bits(job: Job) -> None:
    first = ranks.solve(None, job)
    began = _processes()
    second = ranks.solve(None, job)
    assert _processes() == began
    assert np.array_equal(first.arrays["id"], job.id_n)
    for name, array in first.arrays.items():
        assert array.tobytes() == second.arrays[name].tobytes(), name


def test_refusal_ends_the_processes_and_costs_no_later_job(job: Job) -> None:
    right = ranks.solve(None, job)
    began = _processes()
    with pytest.raises(EngineRefused, match="no_such_command"):
        ranks.solve(None, replace(job, runs=(RunCommand("no_such_command"),)))
    again = ranks.solve(None, job)
    assert _processes() != began
    assert again.arrays["f"].tobytes() == right.arrays["f"].tobytes()


def test_death_is_a_crash_and_costs_no_later_job(job: Job) -> None:
    ranks.solve(None, job)
    os.kill(_processes(), signal.SIGKILL)
    with pytest.raises(EngineCrashed):
        ranks.solve(None, job)
    ranks.solve(None, job)
