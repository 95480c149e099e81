"""The clean server process that workers are forked from, started before anything heavy is imported here.

Workers are as isolated as spawned ones, and are back sooner after a crash, as the server has imported
what they need. It loads while this process imports its own modules.
"""

from __future__ import annotations

import multiprocessing
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext


def context(*modules: str) -> ForkServerContext:
    """Return the multiprocessing context of the server; start it if it does not run, without waiting for it.

    Workers begin with the modules named, which the server imports once for all of them.
    """
    forkserver.set_forkserver_preload(["lammps_cases.engine.workers", *modules])
    forkserver.ensure_running()
    return multiprocessing.get_context("forkserver")
