"""The process that runs a deck: how it is started, and what it knows of the user's."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path

import platformdirs

from lammps_cases.audit.options import AuditTask
from lammps_cases.engine import containment, mpi

Entry = Callable[[AuditTask, Connection], None]

START = "import pickle, sys; sys.path[:], run = pickle.load(open(sys.argv[1], 'rb')); pickle.loads(run)()"
# What a deck may read of the user's environment, and what Python, numba and MPI need of it.
KEPT = ("PATH", "LD_LIBRARY_PATH", "LANG", "TZ", "PYTHONHOME", "LAMMPS_POTENTIALS")
KEPT_BEGINNINGS = ("LC_", "OMP_", "KMP_", "NUMBA_", "MPICH_", "OMPI_MCA_", "UCX_", "FI_", "COVERAGE_")
# Contained ranks may neither read one another's memory, as MPICH's CMA does, nor open files of one another.
APART = {"MPIR_CVAR_CH4_CMA_ENABLE": "0", "UCX_TLS": "self,sysv"}


def run_child(task: AuditTask, connection: Connection) -> None:
    """Entry of the process; the heavy imports stay out of the parent."""
    from lammps_cases.audit import child

    child.main(task, connection)


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
    kept = {name: text for name, text in os.environ.items() if name in KEPT or name.startswith(KEPT_BEGINNINGS)}
    return {
        **several,
        **kept,
        "HOME": task.temporary,
        "TMPDIR": task.temporary,
        "XDG_CACHE_HOME": platformdirs.user_cache_dir(),
        "OPENBLAS_NUM_THREADS": "1",  # Landlock holds for threads that start after it
        "OMPI_MCA_ess_singleton_isolated": "1",  # Open MPI otherwise starts a program of its own
        **(APART if several else {}),
    }


def reach(task: AuditTask) -> containment.Reach:
    """Return what the process may read and write, before it knows the libraries of its LAMMPS."""
    folders = [Path(platformdirs.user_cache_dir("eos-ref")) / "numba"]
    if task.options.engine is not None:
        site = Path(task.options.engine)
        package = site / "lammps"
        folders += [site, site.parent.parent, *{file.resolve().parent for file in package.iterdir()}]
    read = containment.installation(folders)
    return containment.Reach(read, (task.folder, task.temporary, *containment.DEVICES))


@contextlib.contextmanager
def running(
    entry: Entry, task: AuditTask, output: Path, launcher: Sequence[str] = ()
) -> Iterator[tuple[subprocess.Popen[bytes], Connection]]:
    """Start the process, with what it prints in a file, and give it with the end of its messages; it ends with this.

    With the words of a ``launcher`` it is the one that starts the ranks.
    """
    Path(task.temporary).mkdir()
    os.mkfifo(task.fifo)
    reading = os.open(task.fifo, os.O_RDONLY | os.O_NONBLOCK)
    writing = os.open(task.fifo, os.O_WRONLY)
    os.set_blocking(reading, True)
    paths = [os.path.abspath(path) for path in sys.path]  # noqa: PTH100  "" is a folder here, and another there
    start = Path(task.temporary) / "start"
    start.write_bytes(pickle.dumps((paths, pickle.dumps(_Run(entry, task)))))
    words = [*launcher, sys.executable, "-P", "-c", START, str(start)]
    command = containment.contained(words, reach(task), task.folder, task.means)
    with Connection(reading, writable=False) as receiver, output.open("wb") as printed:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=printed,
                stderr=printed,
                env=environment(task),
                pass_fds=[writing],
                start_new_session=True,
            )
        finally:
            os.close(writing)  # the process holds this end, and what it starts: its death ends the messages
        try:
            yield process, receiver
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # with what a trusted deck has started
            process.wait()
