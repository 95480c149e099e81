"""The process that runs LAMMPS: a segfault, abort, hang or exit of the deck ends this process alone."""

from __future__ import annotations

import os
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit.follow import Follower
from lammps_cases.audit.options import Ended, Identity, Place, Task
from lammps_cases.audit.watch import Watch
from lammps_cases.engine.session import EngineMissing, EngineRefused, describe, open_lammps
from lammps_cases.records.run_record import Seconds


def main(task: Task, connection: Connection) -> None:
    """Run a deck and send `Identity`, `Place`, `Facts`, `Look` and at last `Ended`, `InputError` or `EngineMissing`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    # What the C++ runtime prints when it dies belongs into the record, not on the terminal.
    output = os.open(task.output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(task.folder)
    try:
        connection.send(audit(task, connection))
    except (InputError, EngineMissing) as error:
        connection.send(error)


def audit(task: Task, connection: Connection) -> Ended:
    """Run a deck in the current folder, with looks.

    Raises
    ------
    InputError, EngineMissing
    """
    begin = time.perf_counter()
    lmp = open_lammps(task.engine)
    who = describe(lmp, task.engine)
    connection.send(Identity(who))
    watch = Watch(lmp, task.every, task.steps, connection.send, task.fields, who["distribution"])
    follower = Follower(lmp, watch, lambda where, text: connection.send(Place(where, text)), task.allow_shell)
    refused = ""
    try:
        follower.deck(Path(task.deck))
    except EngineRefused as error:
        refused = str(error)
    arrays, last = watch.final()
    seconds = Seconds(lammps=watch.lammps_seconds, reference=watch.look_seconds, total=time.perf_counter() - begin)
    return Ended(
        watch.done, watch.runs, seconds, watch.questions.lines(), watch.questions.stability, arrays, last, refused
    )
