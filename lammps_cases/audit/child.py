"""The process that runs LAMMPS: a segfault, abort, hang or exit of the deck ends this process alone."""

from __future__ import annotations

import os
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit.follow import Follower
from lammps_cases.audit.options import CommandPlace, DeckEnd, EngineIdentity, Task
from lammps_cases.audit.warn import HYPHEN
from lammps_cases.audit.watch import DeckWatch
from lammps_cases.engine.session import EngineMissing, EngineRefused, describe, open_lammps
from lammps_cases.records.run_record import Seconds


def main(task: Task, connection: Connection) -> None:
    """Run a deck and send the messages of `lammps_cases.audit.options`; at last `DeckEnd`, or the error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    # What the C++ runtime prints when it dies belongs in the record, not on the terminal.
    output = os.open(task.output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(task.folder)
    try:
        connection.send(audit(task, connection))
    except (InputError, EngineMissing) as error:
        connection.send(error)


def audit(task: Task, connection: Connection) -> DeckEnd:
    """Run a deck in the current folder, with samples.

    Raises
    ------
    InputError, EngineMissing
    """
    begin = time.perf_counter()
    options = task.options
    lmp = open_lammps(options.engine)
    who = describe(lmp, options.engine)
    connection.send(EngineIdentity(who))
    watch = DeckWatch(lmp, options, connection.send, who["distribution"])
    follower = Follower(lmp, watch, lambda where, text: connection.send(CommandPlace(where, text)), options.allow_shell)
    refused = ""
    try:
        if options.suffix is not None:
            follower.start(f"suffix {options.suffix}")
        follower.deck(Path(task.deck))
    except EngineRefused as error:
        refused = str(error)
    arrays, last = watch.final()
    seconds = Seconds(lammps=watch.lammps_seconds, reference=watch.sample_seconds, total=time.perf_counter() - begin)
    questions, (cause, ahead) = watch.questions, watch.outlook()
    warnings, margins = questions.lines(), questions.stability
    mistaken = (HYPHEN,) if questions.mistaken else ()
    return DeckEnd(watch.done, watch.runs, seconds, warnings, margins, arrays, last, refused, cause, ahead, mistaken)
