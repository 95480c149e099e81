"""Run a function in a fork, isolated from this process: it starts with all that is loaded here, and ends alone."""

from __future__ import annotations

import os
import pickle
import signal
import tempfile
import threading
from collections.abc import Callable
from multiprocessing import connection
from typing import Any, TypeVar

from lammps_cases.engine import ranks

T = TypeVar("T")


def call(task: Callable[..., T], *arguments: Any, time_limit: float) -> T:
    """Run ``task(*arguments)`` in a fork, and return its result.

    Raises
    ------
    EngineCrashed
        The fork died; the text is the end of its output.
    TimeoutError
    Exception
        The task's own.
    """
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as answer:
        parent = os.getpid()
        child = os.fork()
        if child == 0:
            _work(task, arguments, output.fileno(), answer.fileno(), parent)
        code = os.waitstatus_to_exitcode(_wait(child, time_limit))
        answer.seek(0)
        content = answer.read()
        if not content:
            output.seek(0)
            raise ranks.crash_of_process(code, output.read().decode(errors="replace"))
    succeeded, result = pickle.loads(content)
    if not succeeded:
        raise result
    answered: T = result
    return answered


def outcome(task: Callable[..., Any], *arguments: Any) -> bytes:
    """Run a task, and return whether it succeeded, with its result or exception, pickled."""
    try:
        return pickle.dumps((True, task(*arguments)), pickle.HIGHEST_PROTOCOL)
    except BaseException as error:
        try:
            return pickle.dumps((False, error))
        except Exception:
            return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))


def beyond(time_limit: float) -> str:
    """Return the message of a task that took too long."""
    return f"LAMMPS did not finish within the time limit of {time_limit:g} s"


def _work(task: Callable[..., T], arguments: tuple[Any, ...], output: int, answer: int, parent: int) -> None:
    """Run the task and end the process, without running any code of the parent's."""
    try:
        threading.Thread(target=ranks.die_with, args=(parent,), daemon=True).start()
        os.dup2(output, 1)
        os.dup2(output, 2)
        with os.fdopen(answer, "wb") as file:
            file.write(outcome(task, *arguments))
    finally:
        os._exit(0)


def _wait(child: int, time_limit: float) -> int:
    handle = os.pidfd_open(child)
    try:
        if not connection.wait([handle], time_limit):
            raise TimeoutError(beyond(time_limit))
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        os.close(handle)
        status = os.waitpid(child, 0)[1]
    return status
