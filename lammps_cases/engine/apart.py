"""A task in a fork of this process: it begins with all that is loaded here, and what it breaks ends with it."""

from __future__ import annotations

import os
import pickle
import signal
import tempfile
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from lammps_cases.engine import ranks

T = TypeVar("T")
PAUSE = 0.001  # seconds between two looks at the fork


def call(task: Callable[..., T], *arguments: Any, time_limit: float) -> T:
    """Run ``task(*arguments)`` in a fork, and return its result.

    Raises
    ------
    EngineCrashed
        The fork died; the text is what it left.
    TimeoutError
    Exception
        That of the task.
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
    """Run a task, and return whether it succeeded with its result or its exception, pickled."""
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
    """Run the task and end the process; nothing of the parent's is left to run here."""
    try:
        threading.Thread(target=ranks.die_with, args=(parent,), daemon=True).start()
        os.dup2(output, 1)
        os.dup2(output, 2)
        with os.fdopen(answer, "wb") as file:
            file.write(outcome(task, *arguments))
    finally:
        os._exit(0)


def _wait(child: int, time_limit: float) -> int:
    deadline = time.monotonic() + time_limit
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise TimeoutError(beyond(time_limit))
        time.sleep(PAUSE)
