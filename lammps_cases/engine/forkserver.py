"""The clean server process that workers are forked from, started before anything heavy is imported here.

Workers are as isolated as spawned ones, and are back sooner after a crash, as the server has imported
what they need. It loads while this process imports its own modules.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext, ForkServerProcess
from multiprocessing.popen_forkserver import Popen
from multiprocessing.process import BaseProcess
from types import ModuleType

FIRST = "lammps_cases.engine.beginning"
OF_WORKERS = "lammps_cases.engine.workers"
OF_JUDGING = ("lammps_cases.verdict.cases", "lammps_cases.run.flow", "lammps_cases.report.page")
OF_PAIRS = "scipy.spatial"  # as long to import as a third of all the rest
_starting = threading.RLock()


@contextmanager
def without_main() -> Iterator[None]:
    """Hide the user's script, which a process that starts meanwhile would run again before its task.

    All tasks are functions of modules: a script needs no ``if __name__ == "__main__"`` to run cases.
    """
    with _starting:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


class _Process(ForkServerProcess):
    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Popen:  # where a start comes to, of a pool's thread too
        with without_main():
            return Popen(process_obj)


class _Context(ForkServerContext):
    Process = _Process


_second = forkserver.ForkServer()


class _SecondPopen(Popen):
    def _launch(self, process_obj: BaseProcess) -> None:
        first = forkserver.connect_to_new_process  # one process starts at a time: see `without_main`
        forkserver.connect_to_new_process = _second.connect_to_new_process
        try:
            super()._launch(process_obj)  # type: ignore[misc]
        finally:
            forkserver.connect_to_new_process = first


class _SecondProcess(ForkServerProcess):
    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Popen:
        with without_main():
            return _SecondPopen(process_obj)


class _SecondContext(ForkServerContext):
    Process = _SecondProcess


@contextmanager
def _safe_path() -> Iterator[None]:
    """Keep the current folder off the path of processes that are started: its files may have any name."""
    before = os.environ.get("PYTHONSAFEPATH", "")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        os.environ["PYTHONSAFEPATH"] = before  # "" is the same as none


def second_context(*modules: str) -> ForkServerContext:
    """Return the context of a second server, which has imported the modules named, whatever the first one has."""
    _second.set_forkserver_preload([*modules])
    with _safe_path():
        _second.ensure_running()
    return _SecondContext()


def context(*modules: str) -> ForkServerContext:
    """Return the multiprocessing context of the server; start it if it does not run, without waiting for it.

    Workers begin with the modules named, which the server imports once for all of them.
    """
    forkserver.set_forkserver_preload([FIRST, OF_WORKERS, *modules])
    with _safe_path():
        forkserver.ensure_running()
    return _Context()


def start_for_judging(pairs: bool = True) -> None:
    """Start the process that workers which judge cases are forked from, while this one imports the rest.

    Without ``pairs`` a worker imports what finds neighbours itself, when a case asks for them.
    """
    context(*OF_JUDGING, *([OF_PAIRS] if pairs else []))
