"""Servers that fork processes on request: a fork starts in milliseconds, with all that its server has imported.

Forks are as isolated as programs of their own. A server is one: clean, with an environment and imports of its own. Only
in a program that has just begun it may be a fork of this process, which then imports once for all.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any

from lammps_cases.engine import containment

OF_WORKERS = "lammps_cases.engine.workers"
OF_JUDGING = ("lammps_cases.verdict.cases", "lammps_cases.run.flow", "lammps_cases.run.report_files")
OF_PAIRS = "scipy.spatial"  # its import takes a third as long as all the others
UNKNOWN = 255  # exit code of a process whose end was not reported: its server was killed
SERVE = """import gc, sys
gc.disable()
sys.path[:] = sys.argv[3:]
from lammps_cases.engine import forkserver
forkserver.serve(int(sys.argv[1]), sys.argv[2].split())"""
_starting = threading.RLock()


class Fork:
    """A process that a server has forked, the leader of a process group, with the methods of `subprocess.Popen`."""

    def __init__(self, report: Connection) -> None:
        self._report = report
        self._reading = threading.Lock()
        self.pid: int = report.recv()
        self.returncode: int | None = None

    @property
    def sentinel(self) -> int:
        """Return a handle that is ready when the process has ended, for `multiprocessing.connection.wait`."""
        return self._report.fileno()

    def poll(self) -> int | None:
        """Return the exit code, None while the process runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end of the process; return its exit code.

        Raises
        ------
        subprocess.TimeoutExpired
        """
        if self.returncode is None:
            if not self._report.poll(timeout):
                raise subprocess.TimeoutExpired("fork", timeout or 0.0)
            with self._reading:
                if self.returncode is None:
                    try:
                        self.returncode = self._report.recv()
                    except EOFError:
                        self.returncode = UNKNOWN
        return self.returncode

    def kill(self) -> None:
        """Kill the process, if it runs."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)


class Server:
    """A server, started when first needed and again after its death.

    Parameters
    ----------
    modules : what it imports before its first fork; of ``module:function`` it also calls the function
    environment, paths : its environment variables and folders of modules, by default those of this process
    """

    def __init__(
        self, modules: Sequence[str], environment: Mapping[str, str] | None = None, paths: Sequence[str] = ()
    ) -> None:
        self.modules, self._environment, self._paths = modules, environment, paths
        self._socket: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        atexit.register(self.end)

    def start(self) -> None:
        """Start the server as a program, without waiting for it."""
        with _starting:
            self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            paths = self._paths or [path for path in sys.path if path]  # not the current folder, with files of any name
            with other:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-c", SERVE, str(other.fileno()), " ".join(self.modules), *paths],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    env=self._environment,
                    pass_fds=[other.fileno()],
                    start_new_session=True,  # Ctrl-C is not for it
                )

    def fork_this(self) -> None:
        """Start the server as a fork of this process, with the modules, which are imported here."""
        imported(self.modules)
        with _starting:
            self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with other:
                if os.fork() == 0:
                    self._socket.close()
                    os.setsid()
                    null = os.open(os.devnull, os.O_RDWR)
                    for stream in range(3):
                        os.dup2(null, stream)
                    try:
                        serve(other.fileno())
                    finally:
                        os._exit(0)

    def end(self) -> None:
        """End the server; it starts again when it is needed."""
        with _starting:
            if self._socket:
                self._socket.close()
            if self._process:
                self._process.kill()
                self._process.wait()
            self._socket = self._process = None

    @property
    def running(self) -> bool:
        """Return whether the server was started."""
        return self._socket is not None

    def fork(self, output: int, held: int, function: Callable[..., Any], *arguments: Any) -> Fork:
        """Return a fork that calls a function of a module with the handle ``held`` and the arguments.

        Parameters
        ----------
        output : handle of the file that takes its output
        held : handle that it, and of the processes of the server it alone, keeps open until it ends

        Raises
        ------
        EOFError, OSError
            The server died twice.
        """
        task, tasks = pickle.dumps((function, arguments)), self._started()
        try:
            return _forked(tasks, task, output, held)
        except (EOFError, OSError):
            return _forked(self._started(after=tasks), task, output, held)

    def _started(self, after: socket.socket | None = None) -> socket.socket:
        """Return the socket of the server, which is started if it does not run; ``after``: that of one that died."""
        with _starting:
            if self._socket is after is not None:
                self.end()
            if self._socket is None:
                self.start()
            assert self._socket
            return self._socket


def _forked(tasks: socket.socket, task: bytes, output: int, held: int) -> Fork:
    reading, writing = os.pipe()
    report = Connection(reading, writable=False)
    with os.fdopen(os.memfd_create("task"), "wb") as given, os.fdopen(writing, "wb"):
        given.write(task)
        given.flush()
        socket.send_fds(tasks, [b"!"], [given.fileno(), output, held, writing])
    return Fork(report)


workers = Server([OF_WORKERS])


def preload(*modules: str) -> None:
    """Start the server of workers, which imports these modules for them, unless it runs."""
    with _starting:
        if not workers.running:
            workers.modules = [OF_WORKERS, *modules]
            workers.start()


def start_for_judging(pairs: bool = True) -> None:
    """Start the server of judging workers, while this process imports the rest.

    Without ``pairs`` a worker imports the neighbour search itself, when a case needs it.
    """
    preload(*OF_JUDGING, *([OF_PAIRS] if pairs else []))


def fork_for_judging(pairs: bool = True) -> None:
    """Make the server of judging workers a fork of this process, which imports what they need.

    Only for a program that has one thread and no more than its imports in memory; otherwise the server is a clean one.
    """
    if workers.running or threading.active_count() > 1:
        start_for_judging(pairs)
        return
    workers.modules = [OF_WORKERS, *OF_JUDGING, *([OF_PAIRS] if pairs else [])]
    workers.fork_this()


# --- in the server


def imported(modules: Sequence[str]) -> None:
    """Import modules; of ``module:function`` also call the function."""
    for word in modules:
        name, _, function = word.partition(":")
        module = importlib.import_module(name)
        if function:
            getattr(module, function)()


def serve(handle: int, modules: Sequence[str] = ()) -> None:
    """Import modules, then fork a process for every task that is sent over a socket, until the other side ends."""
    imported(modules)
    gc.freeze()  # no collection in a fork scans, and thereby copies, what all share
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no one waits for the watching processes
    with socket.socket(fileno=handle) as tasks:
        while True:
            _, handles, _, _ = socket.recv_fds(tasks, 1, 4)
            if not handles:
                return
            if os.fork() == 0:
                tasks.close()
                _watch(*handles)
            for each in handles:
                os.close(each)


def _watch(given: int, output: int, held: int, report: int) -> None:
    """Fork the process of a task, and send its number and its exit code."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    containment.end_with_parent()
    child = os.fork()
    if child == 0:
        os.close(report)
        _work(given, output, held)
    os.setpgid(child, child)
    os.close(held)
    with Connection(report, readable=False) as connection:
        connection.send(child)
        connection.send(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    os._exit(0)


def _work(given: int, output: int, held: int) -> None:
    code = 1
    try:
        containment.end_with_parent()
        os.setpgid(0, 0)
        gc.enable()
        for stream in (1, 2):
            os.dup2(output, stream)
        os.close(output)
        with os.fdopen(given, "rb") as file:
            file.seek(0)
            function, arguments = pickle.load(file)
        function(held, *arguments)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
