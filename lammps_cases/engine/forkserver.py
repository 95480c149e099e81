"""The server process that workers are forked from: a clean one, or in a program of its own a fork of this process.

Workers are as isolated as spawned ones, and restart sooner after a crash, as the server has imported
what they need. A clean one loads while this process imports its own modules; a fork has them, imported once for all.
"""

from __future__ import annotations

import gc
import importlib
import multiprocessing
import os
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import connection, forkserver
from multiprocessing.context import ForkServerContext
from types import ModuleType
from typing import Any

FIRST = "lammps_cases.engine.beginning"
OF_WORKERS = "lammps_cases.engine.workers"
OF_JUDGING = ("lammps_cases.verdict.cases", "lammps_cases.run.flow", "lammps_cases.run.report_files")
OF_PAIRS = "scipy.spatial"  # its import takes a third as long as all the others
_starting = threading.RLock()


@contextmanager
def starting() -> Iterator[None]:
    """Let one thread at a time start processes, or reap them, which multiprocessing does when it starts one.

    The user's script is hidden, which a process would run again before its task: all tasks are functions of modules, so
    that a script needs no ``if __name__ == "__main__"`` to run cases. So is the current folder, whose files may have
    any name.
    """
    with _starting:
        main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
        before, os.environ["PYTHONSAFEPATH"] = os.environ.get("PYTHONSAFEPATH", ""), "1"
        try:
            yield
        finally:
            sys.modules["__main__"] = main
            os.environ["PYTHONSAFEPATH"] = before  # "" is the same as unset


def context(*modules: str) -> ForkServerContext:
    """Return the multiprocessing context of the server; start it if it does not run, without waiting for it.

    Workers begin with the named modules, which the server imports once for all of them.
    """
    found = multiprocessing.get_context("forkserver")
    found.set_forkserver_preload([FIRST, OF_WORKERS, *modules])
    with starting():
        forkserver.ensure_running()
    return found


def start_for_judging(pairs: bool = True) -> None:
    """Start the server process of judging workers, while this process imports the rest.

    Without ``pairs`` a worker imports the neighbour search itself, when a case needs it.
    """
    context(*OF_JUDGING, *([OF_PAIRS] if pairs else []))


def fork_for_judging(pairs: bool = True) -> None:
    """Import what judging workers need, and make a fork of this process their server.

    Only for a program that has one thread and no more than its imports in memory: otherwise, and where Python's server
    asks for a key, it is a clean one.
    """
    start: Any = forkserver._forkserver
    if start._forkserver_pid or threading.active_count() > 1 or hasattr(start, "_forkserver_authkey"):
        start_for_judging(pairs)
        return
    for name in (OF_WORKERS, *OF_JUDGING, *([OF_PAIRS] if pairs else [])):
        importlib.import_module(name)
    with socket.socket(socket.AF_UNIX) as listener:
        address = connection.arbitrary_address("AF_UNIX")  # type: ignore[attr-defined]
        listener.bind(address)
        listener.listen()
        alive, held = os.pipe()  # ends at the end of this process, and with it the server
        if (server := os.fork()) == 0:
            os.close(held)
            gc.freeze()
            gc.enable()
            try:
                forkserver.main(listener.detach(), alive, ())
            finally:
                os._exit(0)
    os.close(alive)
    start._forkserver_address, start._forkserver_alive_fd, start._forkserver_pid = address, held, server
