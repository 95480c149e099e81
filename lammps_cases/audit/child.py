"""The process that runs a deck: how it is started, what it may read, and what it does.

A segfault, abort, hang or exit of the deck ends this process alone.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from eos_ref import EOSTable
from eos_ref.eos.table import examples
from eos_ref.errors import InputError
from eos_ref.jit import keep_nothing
from lammps_cases.audit import place
from lammps_cases.audit.follow import Follower, SetupWatch
from lammps_cases.audit.messages import CommandPlace, DeckEnd, EngineIdentity
from lammps_cases.audit.options import AuditTask
from lammps_cases.audit.warn import HYPHEN
from lammps_cases.audit.watch import DeckWatch
from lammps_cases.engine import containment, forkserver, mpi, ranks
from lammps_cases.engine.forkserver import Fork, Server
from lammps_cases.engine.pool import memory_share
from lammps_cases.engine.session import (
    EngineBroken,
    EngineLacks,
    EngineMissing,
    EngineRefused,
    Session,
    load,
)
from lammps_cases.records.case_parts import Seconds

LARGEST_FILE = 2**34  # bytes
Entry = Callable[[AuditTask, Connection], None]
Process = Fork | subprocess.Popen[bytes]
START = "import pickle, sys; sys.path[:], run = pickle.load(open(sys.argv[1], 'rb')); pickle.loads(run)()"
# Variables of the user's environment that a deck may read, or that Python, numba and MPI need.
KEPT = ("PATH", "LD_LIBRARY_PATH", "LANG", "TZ", "PYTHONHOME", "LAMMPS_POTENTIALS")
KEPT_BEGINNINGS = ("LC_", "OMP_", "KMP_", "NUMBA_", "MPICH_", "OMPI_MCA_", "UCX_", "FI_", "COVERAGE_")
OF_LIBC = ("MALLOC_", "GLIBC_", "LD_")  # read when a program starts; for trusted decks
# Contained ranks may neither read one another's memory, as MPICH's CMA does, nor open files of one another.
APART = {"MPIR_CVAR_CH4_CMA_ENABLE": "0", "UCX_TLS": "self,sysv"}


class _Run:
    """An entry and its task; the process opens the fifo of its messages, as launchers of ranks pass on no handles."""

    def __init__(self, entry: Entry, task: AuditTask) -> None:
        self.entry, self.task = entry, task

    def __call__(self) -> None:
        with Connection(os.open(self.task.fifo, os.O_WRONLY), readable=False) as connection:
            self.entry(self.task, connection)


def environment(task: AuditTask) -> dict[str, str]:
    """Return the environment of the process: without passwords and tokens, unless the deck is trusted."""
    several = mpi.SETTINGS if task.options.ranks > 1 else {}
    if task.options.trust:
        return {**several, **os.environ, "TMPDIR": task.temporary}
    own = {"HOME": task.temporary, "TMPDIR": task.temporary}
    return {**several, **_clean(), **own, **(APART if several else {})}


def _clean(beginnings: tuple[str, ...] = KEPT_BEGINNINGS) -> dict[str, str]:
    kept = {name: text for name, text in os.environ.items() if name in KEPT or name.startswith(beginnings)}
    return {
        **kept,
        "XDG_CACHE_HOME": platformdirs.user_cache_dir(),
        "OPENBLAS_NUM_THREADS": "1",  # Landlock holds for threads that start after it
        "OMPI_MCA_ess_singleton_isolated": "1",  # Open MPI otherwise starts a program of its own
    }


def reach_of(task: AuditTask) -> containment.Reach:
    """Return what the process may read and write, before the libraries of its LAMMPS are known."""
    folders = [Path(platformdirs.user_cache_dir("eos-ref")) / "numba"]
    if task.options.engine is not None:
        site = Path(task.options.engine)
        package = site / "lammps"
        folders += [site, site.parent.parent, *{file.resolve().parent for file in package.iterdir()}]
    read = containment.installation(folders)
    return containment.Reach(read, (task.folder, task.temporary, *containment.DEVICES))


@functools.cache
def _server(environ: tuple[tuple[str, str], ...], paths: tuple[str, ...]) -> Server:
    """Return the server of processes with an environment and folders of modules, which are read when modules load."""
    return Server((f"{__name__}:compile_first", forkserver.OF_PAIRS), dict(environ), paths)


@contextlib.contextmanager
def running(
    entry: Entry, task: AuditTask, output: Path, launcher: Sequence[str] = ()
) -> Iterator[tuple[Process, Connection]]:
    """Start the process, its output in a file; yield it with the receiving end of its messages. It ends with this one.

    With the words of a ``launcher`` the process is the launcher, which starts the ranks.
    """
    Path(task.temporary).mkdir()
    os.mkfifo(task.fifo)
    reading = os.open(task.fifo, os.O_RDONLY | os.O_NONBLOCK)
    writing = os.open(task.fifo, os.O_WRONLY)
    os.set_blocking(reading, True)
    paths = [str(Path(path).absolute()) for path in sys.path if Path(path).exists()]  # "" is a folder here alone
    run, environ = pickle.dumps(_Run(entry, task)), environment(task)
    with Connection(reading, writable=False) as receiver, output.open("wb") as printed:
        try:
            process: Process
            if launcher or task.means == "bubblewrap":
                start = Path(task.temporary) / "start"
                start.write_bytes(pickle.dumps((paths, run)))
                words = [*launcher, sys.executable, "-P", "-c", START, str(start)]
                process = subprocess.Popen(
                    containment.contained(words, reach_of(task), task.folder, task.means),
                    stdin=subprocess.DEVNULL,
                    stdout=printed,
                    stderr=printed,
                    env=environ,
                    pass_fds=[writing],
                    start_new_session=True,
                )
            else:
                clean = _clean((*KEPT_BEGINNINGS, *(OF_LIBC if task.options.trust else ())))
                server = _server(tuple(sorted(clean.items())), tuple(paths))
                process = server.fork(printed.fileno(), writing, _run, environ, run)
        finally:
            os.close(writing)  # this end is held by the process and its children: their death ends the messages
        try:
            yield process, receiver
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # with all that a trusted deck has started
            process.wait()


def _run(held: int, environ: dict[str, str], run: bytes) -> None:
    os.environ.clear()
    os.environ.update(environ)
    tempfile.tempdir = None
    pickle.loads(run)()


def main(task: AuditTask, connection: Connection) -> None:
    """Run a deck and send the `lammps_cases.audit.messages`, at last `DeckEnd` or the error."""
    containment.end_with_parent()
    containment.limit(memory_share(task.options.ranks), task.options.timeout, LARGEST_FILE)
    os.chdir(task.working)
    sender = Sender(connection)
    try:
        sender.send(audit(task, sender))
    except (InputError, EngineMissing) as error:
        sender.send(error)
    except RecursionError:
        sender.send(InputError("deck", place.NESTED, where=task.deck))
    if task.options.ranks > 1:
        signal.pause()  # for the end of the audit: a rank that ends before the others may end them


class Sender:
    """Sends the messages of the first rank, or of a rank that LAMMPS has ended alone, one at a time."""

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
    """Contain this process, then return an open LAMMPS and its identity; nothing of the deck is read before.

    MPI, too, starts with restricted files; afterwards the network is closed, and what MPI reads of the machine.

    Raises
    ------
    EngineMissing
    """
    session, reach = Session(task.options.engine), reach_of(task)
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
        watch.acting.refused(refused, watch.deck)
        if isinstance(error, EngineBroken):  # on this rank alone: the others wait for it
            sender.silent = False
    except EngineLacks as error:
        lacks = str(error)
    if isinstance(watch, SetupWatch):
        sender.send(watch.setups())
    arrays, last = watch.final()
    seconds = Seconds(lammps=watch.lammps_seconds, reference=watch.sample_seconds, total=time.perf_counter() - begin)
    questions, fluid = watch.questions, watch.fluid
    cause, ahead = fluid.outlook(watch.health, questions.brief)
    warnings, margins = [*questions.lines(), *fluid.unbudgeted(), *follower.made], questions.stability
    touching = (HYPHEN,) if questions.mistaken else ()
    series, solution = fluid.series()
    return DeckEnd(
        watch.done, watch.runs, seconds, warnings, margins, arrays, last, refused, cause, ahead,
        watch.share(), series, solution, touching, list(watch.acting.found.values()), watch.health.broke,
        watch.health.lost, questions.brief, lacks, watch.kept, watch.thermo,
    )  # fmt: skip
