"""The process that runs LAMMPS: a segfault, abort, hang or exit of the deck ends this process alone."""

from __future__ import annotations

import fcntl
import os
import signal
import time
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import EOSTable
from eos_ref.eos.table import examples
from eos_ref.errors import InputError
from eos_ref.jit import keep_nothing
from lammps_cases.audit import guard, launch
from lammps_cases.audit.follow import Follower
from lammps_cases.audit.options import AuditTask, CommandPlace, DeckEnd, EngineIdentity
from lammps_cases.audit.setups import SetupWatch
from lammps_cases.audit.warn import HYPHEN
from lammps_cases.audit.watch import DeckWatch
from lammps_cases.engine import containment, ranks
from lammps_cases.engine.pool import memory_share
from lammps_cases.engine.session import (
    EngineBroken,
    EngineLacks,
    EngineMissing,
    EngineRefused,
    Session,
    load,
)
from lammps_cases.records.run_record import Seconds

LARGEST_FILE = 2**34  # bytes


def main(task: AuditTask, connection: Connection) -> None:
    """Run a deck and send the messages of `lammps_cases.audit.options`; at last `DeckEnd`, or the error."""
    containment.end_with_parent()
    containment.limit(memory_share(task.options.ranks), task.options.timeout, LARGEST_FILE)
    os.chdir(task.working)
    sender = Sender(connection)
    try:
        sender.send(audit(task, sender))
    except (InputError, EngineMissing) as error:
        sender.send(error)
    except RecursionError:
        sender.send(InputError("deck", guard.NESTED, where=task.deck))
    if task.options.ranks > 1:
        signal.pause()  # for the end of the audit: a rank that ends before the others may end them


class Sender:
    """Sends the messages of the first rank, and those of one that LAMMPS has ended alone, one at a time."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.silent = False

    def send(self, message: object) -> None:
        """Send a message, unless this rank is silent."""
        if not self.silent:
            fcntl.flock(self.connection, fcntl.LOCK_EX)
            self.connection.send(message)
            fcntl.flock(self.connection, fcntl.LOCK_UN)


def start(task: AuditTask) -> tuple[Any, dict[str, str]]:
    """Return an open LAMMPS, and which one, in a process contained from here on: nothing of the deck is read before.

    MPI starts within its files too; only then is the network closed, and what MPI reads of the machine.

    Raises
    ------
    EngineMissing
    """
    session, reach = Session(task.options.engine), launch.reach(task)
    if task.means == "none":
        return session.open(), session.describe()
    compile_first()
    keep_nothing()
    if task.means == "landlock":
        load(session.site)
        containment.drop_capabilities()
        reach = replace(reach, read=(*reach.read, *map(str, containment.loaded_libraries())))
        start_up = containment.Reach((*reach.read, *containment.MACHINE), (*reach.write, containment.SHARED_MEMORY))
        containment.keep_to(start_up, network=True)
    lmp, who = session.open(), session.describe()
    if task.means == "landlock":
        containment.keep_to(reach)
    containment.start_nothing()
    return lmp, who


def compile_first() -> None:
    """Compile what an audit uses, which is kept on disk: a contained process compiles it again every time."""
    laws, ones_n = examples(), np.ones(1)
    EOSTable(laws).pressure(ones_n, np.ones(1, np.int32), ones_n)
    laws[0].pressure(ones_n)


def audit(task: AuditTask, sender: Sender) -> DeckEnd:
    """Run a deck in the current folder, with samples.

    Raises
    ------
    InputError, EngineMissing
    """
    begin = time.perf_counter()
    options = task.options
    lmp, who = start(task)
    ranks.require_size(lmp, options.ranks)
    sender.silent = lmp.extract_setting("world_rank") > 0
    sender.send(EngineIdentity(who))
    watch = (SetupWatch if task.setups else DeckWatch)(lmp, options, sender.send, who["distribution"])

    def report(where: str, written: str) -> None:
        if isinstance(watch, SetupWatch):
            watch.meet(where, written)
        sender.send(CommandPlace(where, written))

    within = None if options.trust else task.place
    follower = Follower(lmp, watch, report, within)
    refused = lacks = ""
    try:
        for command in options.commands():
            follower.start(command)
        follower.deck(Path(task.deck))
    except EngineRefused as error:
        refused = str(error)
        if isinstance(error, EngineBroken):  # on this rank alone: the others wait for it
            sender.silent = False
    except EngineLacks as error:
        lacks = str(error)
    if isinstance(watch, SetupWatch):
        sender.send(watch.setups())
    arrays, last = watch.final()
    seconds = Seconds(lammps=watch.lammps_seconds, reference=watch.sample_seconds, total=time.perf_counter() - begin)
    questions, (cause, ahead) = watch.questions, watch.outlook()
    warnings, margins = [*questions.lines(), *watch.unbudgeted(), *follower.made], questions.stability
    touching = (HYPHEN,) if questions.mistaken else ()
    series, solution = watch.series()
    return DeckEnd(
        watch.done, watch.runs, seconds, warnings, margins, arrays, last, refused, cause, ahead,
        watch.share(), series, solution, touching, list(watch.acting.found.values()), watch.health.broke,
        watch.health.lost, questions.brief, lacks, watch.kept, watch.thermo,
    )  # fmt: skip
