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
    ranks.end_kept()


def _pid() -> int:
    return ranks.kept(None, 2).pid


def test_one_job_after_another_gives_the_same_bits(job: Job) -> None:
    first = ranks.solve(None, job)
    began = _pid()
    second = ranks.solve(None, job)
    assert _pid() == began
    assert np.array_equal(first.arrays["id"], job.id_n)
    for name, array in first.arrays.items():
        assert array.tobytes() == second.arrays[name].tobytes(), name


def test_refusal_ends_the_processes_and_costs_no_later_job(job: Job) -> None:
    right = ranks.solve(None, job)
    began = _pid()
    with pytest.raises(EngineRefused, match="no_such_command"):
        ranks.solve(None, replace(job, runs=(RunCommand("no_such_command"),)))
    again = ranks.solve(None, job)
    assert _pid() != began
    assert again.arrays["f"].tobytes() == right.arrays["f"].tobytes()


def test_a_failure_ends_its_own_ranks_and_the_end_all(job: Job) -> None:
    other = ranks.kept(None, 1)
    with pytest.raises(EngineRefused, match="no_such_command"):
        ranks.solve(None, replace(job, runs=(RunCommand("no_such_command"),)))
    assert ranks.kept(None, 1) is other
    os.kill(other.pid, 0)
    ranks.end_kept()
    with pytest.raises(ProcessLookupError):
        os.kill(other.pid, 0)


def test_death_is_a_crash_and_costs_no_later_job(job: Job) -> None:
    ranks.solve(None, job)
    os.kill(_pid(), signal.SIGKILL)
    with pytest.raises(EngineCrashed):
        ranks.solve(None, job)
    ranks.solve(None, job)
