"""LAMMPS on several ranks: the processes take one job after another and are replaced after a failure."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lammps_cases.engine import ranks
from lammps_cases.engine.session import Array, EngineCrashed, EngineRefused, Job, RunCommand
from lammps_cases.engine.workers import solve
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile

pytestmark = pytest.mark.lammps


@pytest.fixture
def job() -> Iterator[Job]:
    case = casefile.select(casefile.load(), ("twins.fluid.ranks",))[0]
    yield next(job for job in prepared_case.prepare(case).jobs if job.ranks > 1)
    ranks.end_kept()


def _pid() -> int:
    return ranks.kept_ranks(None, 2).pid


def test_one_job_after_another_gives_the_same_bits(job: Job) -> None:
    first = ranks.solve(None, job)
    began = _pid()
    second = ranks.solve(None, job)
    assert _pid() == began
    assert np.array_equal(first.arrays["id"], job.id_n)
    for name, array in first.arrays.items():
        assert array.tobytes() == second.arrays[name].tobytes(), name
    left = [file.name.partition(".")[0] for file in ranks.kept_ranks(None, 2)._path.iterdir()]
    assert sorted(left) == ["job", "output"], "the next job, and no file for each of the others"


def test_ranks_that_wait_take_no_processor_time(job: Job) -> None:
    ranks.solve(None, job)

    folder = os.fsencode(ranks.kept_ranks(None, 2)._path)
    own = list[Path]()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            own += [process] * (folder in (process / "cmdline").read_bytes())
    assert len(own) >= 2

    def switches() -> int:
        """Return how often the main threads of the ranks, and of what started them, have left the processor."""
        words = [word for path in own for word in (path / "status").read_text().split("\n") if "ctxt_switches" in word]
        return sum(int(word.split()[1]) for word in words)

    before = switches()
    time.sleep(1.0)
    assert switches() - before < 20


def test_rank_without_atoms_evaluates_outputs(case_file: Callable[..., Path]) -> None:
    """All ranks evaluate outputs when they are read: messages to a rank left out would reach the next job."""
    x, low, high = [[1.0, 1.0], [1.5, 1.2]], [0.0, 0.0], [9.0, 9.0]
    positions = {"x": x, "low": low, "high": high, "periodic": [False, False]}
    engine = {"ranks": 2, "processors": [2, 1, 1]}
    path = case_file(positions=positions, compare=["coordination", "stress/atom"], engine=engine)
    (asked,) = prepared_case.prepare(casefile.load((path,))[0]).jobs
    first, second = (ranks.solve(None, asked) for _ in range(2))
    assert all(array.tobytes() == second.arrays[name].tobytes() for name, array in first.arrays.items())
    assert len(first.arrays["own_stress_atom"]) == len(x)


def test_refusal_ends_the_processes_and_costs_no_later_job(job: Job) -> None:
    right = ranks.solve(None, job)
    began = _pid()
    with pytest.raises(EngineRefused, match="no_such_command"):
        ranks.solve(None, replace(job, runs=(RunCommand("no_such_command"),)))
    again = ranks.solve(None, job)
    assert _pid() != began
    assert again.arrays["f"].tobytes() == right.arrays["f"].tobytes()


def test_failure_ends_its_own_ranks_alone(job: Job) -> None:
    other = ranks.kept_ranks(None, 1)
    with pytest.raises(EngineRefused, match="no_such_command"):
        ranks.solve(None, replace(job, runs=(RunCommand("no_such_command"),)))
    assert ranks.kept_ranks(None, 1) is other
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


def _names(pid: int | str) -> list[str]:
    """Files of MPICH's shared memory that a process has mapped, with Linux' mark on deleted names."""
    lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    return [line.split(maxsplit=5)[5] for line in lines if "mpich_shm_" in line]


def _children(pid: int | str) -> list[str]:
    return Path(f"/proc/{pid}/task/{pid}/children").read_text().split()


def test_nothing_of_mpich_outlives_its_processes(job: Job) -> None:
    """The shared memory of ranks is unlinked while they run, so that no kill can leave it behind."""
    ranks.solve(None, job)  # in two processes, and this one opens LAMMPS too
    running = [str(os.getpid()), *(rank for proxy in _children(_pid()) for rank in _children(proxy))]
    assert len(running) == 3
    for pid in running:
        assert _names(pid), "MPICH of this LAMMPS shares memory by files"
        assert all(name.endswith("(deleted)") for name in _names(pid)), _names(pid)


@pytest.mark.parametrize("name", [f"ranks.{scene}.one-four" for scene in ("walls", "surface", "heat")])
def test_cases_move_particles_over_the_corner_of_four(name: str) -> None:
    """A particle whose process changes along both axes at once; LAMMPS divides the box of these cases in 2 by 2."""
    (case,) = casefile.select(casefile.load(), (name,))
    ready = prepared_case.prepare(case)
    (job,) = (job for job in ready.jobs if job.ranks == 4)
    answer = ranks.solve(None, job)
    half_c = (ready.atoms.low_c + ready.atoms.high_c)[:2] / 2
    sides_nc = [x_nc[:, :2] < half_c for x_nc in (job.x_nc, answer.arrays["x"])]
    assert (sides_nc[0] != sides_nc[1]).all(axis=1).any()
    in_place = replace(job, setup=(*job.setup[:3], "processors 2 2 1", *job.setup[3:]))
    again = ranks.solve(None, in_place)
    assert all(array.tobytes() == again.arrays[name].tobytes() for name, array in answer.arrays.items())


def test_lists_of_all_ranks_are_joined(job: Job) -> None:
    """Every pair is listed once, or for both of its particles if newton is off and two processes share it."""
    for newton, times in ((True, 1), (False, 2)):
        off = () if newton else ("newton off",)
        asked = replace(job, setup=(*job.setup[:3], *off, *job.setup[3:]), lists=True)
        one, two = (solve(None, replace(asked, ranks=count)) for count in (1, 2))
        for alone, both in zip(one.lists, two.lists, strict=True):
            assert len(both["x_sc"]) == len(both["id_s"]) > len(job.id_n)
            assert [sorted(each["id_s"][each["own_s"]]) for each in (alone, both)] == [sorted(job.id_n)] * 2
            counts = [dict(zip(*_pairs(listed), strict=True)) for listed in (alone, both)]
            assert counts[0].keys() == counts[1].keys()
            assert set(counts[1].values()) <= {1, times}


def _pairs(listed: dict[str, Array]) -> tuple[list[tuple[float, ...]], Array]:
    """Pairs of a list within the cutoff by ids and distance vectors, smaller id first, and how often each is listed."""
    one, other = listed["pair_ps"].T
    x_pc = listed["x_sc"][one] - listed["x_sc"][other]
    turn = np.where(listed["id_s"][one] < listed["id_s"][other], 1, -1)[:, None]
    ids = np.sort(np.stack([listed["id_s"][one], listed["id_s"][other]], axis=1), axis=1)
    near = np.sqrt((x_pc**2).sum(axis=1)) < 2.5
    rows, counts = np.unique(np.column_stack([ids, np.round(turn * x_pc, 9)])[near], axis=0, return_counts=True)
    return list(map(tuple, rows.tolist())), counts
