"""A process that has imported all that a deck's process needs, and forks the processes of decks.

To import it takes ten times as long as a short audit: a folder of decks, or a second LAMMPS, pays for it once. It is as
clean as they are: a program of its own, with the environment of contained decks, which knows nothing of a user.
"""

from __future__ import annotations

import atexit
import os
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection

from lammps_cases.engine import containment

Setting = tuple[tuple[str, str], ...]
Run = Callable[[bytes], None]
SERVE = """import sys
sys.path[:] = sys.argv[2:]
import lammps_cases.engine.beginning
from lammps_cases.audit import child
child.serve(int(sys.argv[1]))"""
_servers: dict[tuple[Setting, tuple[str, ...]], _Server] = {}
_starting = threading.Lock()


class Forked:
    """A process that the server has forked, the leader of a process group; the server waits for it and says its end."""

    def __init__(self, told: Connection) -> None:
        self._told = told
        self.pid: int = told.recv()
        self.returncode: int | None = None

    def wait(self, seconds: float | None = None) -> int:
        """Return the exit code as `subprocess.Popen.wait` does.

        Raises
        ------
        subprocess.TimeoutExpired
        """
        if self.returncode is None:
            if not self._told.poll(seconds):
                raise subprocess.TimeoutExpired("fork", seconds or 0.0)
            self.returncode = self._told.recv()
        return self.returncode


Process = Forked | subprocess.Popen[bytes]


class _Server:
    def __init__(self, environment: Setting, paths: tuple[str, ...]) -> None:
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", SERVE, str(other.fileno()), *paths],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=dict(environment),
                pass_fds=[other.fileno()],
                start_new_session=True,  # Ctrl-C is not for it
            )

    def ask(self, *handles: int) -> None:
        socket.send_fds(self._socket, [b"!"], handles)

    def end(self) -> None:
        self._socket.close()
        self.process.kill()
        self.process.wait()


@atexit.register
def _end() -> None:
    for server in _servers.values():
        server.end()


def fork(environment: dict[str, str], paths: list[str], task: bytes, output: int, held: int) -> Forked:
    """Return a fork that runs a task, its output in a file, and keeps the file ``held`` open until it ends.

    There is a server for each environment and list of folders of modules: some variables are read when modules load.
    """
    key = (tuple(sorted(environment.items())), tuple(paths))
    with _starting:
        if key in _servers and _servers[key].process.poll() is not None:
            _servers.pop(key).end()
        if key not in _servers:
            _servers[key] = _Server(*key)
    reading, writing = os.pipe()
    with os.fdopen(os.memfd_create("task"), "wb") as given, os.fdopen(writing, "wb"):
        given.write(task)
        given.flush()
        _servers[key].ask(given.fileno(), output, held, writing)
    return Forked(Connection(reading, writable=False))


# --- in the server


def serve(handle: int, run: Run) -> None:
    """Fork a process for every task that is sent over a socket, until the other side ends."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no one waits for the watching processes
    with socket.socket(fileno=handle) as tasks:
        while True:
            _, handles, _, _ = socket.recv_fds(tasks, 1, 4)
            if not handles:
                return
            if os.fork() == 0:
                tasks.close()
                _watch(run, *handles)
            for each in handles:
                os.close(each)


def _watch(run: Run, given: int, output: int, held: int, report: int) -> None:
    """Fork the process of a task, and send its number and its exit code."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    containment.end_with_parent()
    child = os.fork()
    if child == 0:
        os.close(report)
        _work(run, given, output)
    os.setpgid(child, child)
    os.close(held)
    with Connection(report, readable=False) as connection:
        connection.send(child)
        connection.send(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    os._exit(0)


def _work(run: Run, given: int, output: int) -> None:
    code = 1
    try:
        os.setpgid(0, 0)
        for stream in (1, 2):
            os.dup2(output, stream)
        os.close(output)
        with os.fdopen(given, "rb") as file:
            file.seek(0)
            task = file.read()
        run(task)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
