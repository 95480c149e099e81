"""A private Slurm on this machine: one node, a munge key and folders made for it, no systemd, removed at the end.

Needs slurmctld, slurmd and munged (Debian: slurmctld slurmd slurm-client munge), of Slurm 22.05 or later.
"""

from __future__ import annotations

import getpass
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol")
ENDED = {"COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY"}
PATIENCE = 60.0  # seconds that anything may take
PAUSE = 0.1  # seconds between two polls
CONFIGURATION = """
ClusterName=eos-ref
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=bf_interval=1,sched_interval=1,sched_min_interval=0,batch_sched_delay=0
SlurmdParameters=config_overrides
ReturnToService=2
KillWait=1
NodeName=node NodeHostname={host} NodeAddr=127.0.0.1 CPUs={cores} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
"""


@dataclass(frozen=True)
class Slurm:
    """A running Slurm; ``environment`` has the variables that its commands need."""

    folder: Path
    environment: Mapping[str, str]

    def call(self, *command: object) -> str:
        """Return the output of a command."""
        words = [str(word) for word in command]
        done = subprocess.run(
            words, env=self.environment, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        return done.stdout

    def jobs(self) -> dict[str, dict[str, str]]:
        """Return Slurm's status of every job and task of an array, by ``JOB`` or ``JOB_TASK``."""
        found = {}
        for line in self.call("scontrol", "--oneliner", "show", "job").splitlines():
            keys = dict(word.partition("=")[::2] for word in line.split())
            if "JobId" in keys:
                task = keys.get("ArrayTaskId", "")
                found[f"{keys['ArrayJobId']}_{task}" if task else keys["JobId"]] = keys
        return found

    def wait(self, job: str, *states: str) -> dict[str, str]:
        """Wait until a job is in one of some states (by default: has ended), and return Slurm's status of it."""
        until = time.monotonic() + PATIENCE
        while (keys := self.jobs().get(job, {})).get("JobState") not in (states or ENDED):
            assert time.monotonic() < until, (job, keys, self.logs())
            time.sleep(PAUSE)
        return keys

    def logs(self) -> str:
        """Return the ends of the daemons' logs."""
        return "\n".join(path.read_text(errors="replace")[-2000:] for path in sorted(self.folder.glob("*.log")))


def missing() -> list[str]:
    """Return the programs of Slurm missing from this machine."""
    return [program for program in PROGRAMS if shutil.which(program, path=_path()) is None]


@contextmanager
def running(cores: int = 4) -> Iterator[Slurm]:
    """Start a Slurm of one node with any number of cores, existing or not, and stop it in the end."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="eos-ref-slurm-")))
        for name in ("state", "spool"):
            (folder / name).mkdir()
        configuration = folder / "slurm.conf"
        host, user = socket.gethostname().partition(".")[0], getpass.getuser()
        text = CONFIGURATION.format(folder=folder, host=host, user=user, cores=cores, ports=_free_ports(2))
        configuration.write_text(text)
        key = folder / "munge.key"
        key.touch(0o600)
        key.write_bytes(os.urandom(1024))
        environment = {**os.environ, "PATH": _path(), "SLURM_CONF": str(configuration)}
        slurm = Slurm(folder, environment)
        munge = {"key-file": key, "socket": folder / "munge.socket", "pid-file": folder / "munged.pid"}
        munge |= {"log-file": folder / "munged.log", "seed-file": folder / "munged.seed"}
        places = [f"--{option}={path}" for option, path in munge.items()]
        stack.enter_context(_daemon(slurm, "munged", "--foreground", "--force", *places))
        _until(slurm, (folder / "munge.socket").exists)
        stack.enter_context(_daemon(slurm, "slurmctld", "-D", "-f", str(configuration)))
        stack.enter_context(_daemon(slurm, "slurmd", "-D", "-N", "node", "-f", str(configuration)))
        _until(slurm, lambda: _idle(slurm))
        yield slurm


@contextmanager
def _daemon(slurm: Slurm, *command: str) -> Iterator[None]:
    with (slurm.folder / f"{command[0]}.out").open("wb") as output:
        process = subprocess.Popen(
            command, env=slurm.environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output
        )
    try:
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _until(slurm: Slurm, happened: Callable[[], bool]) -> None:
    until = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < until, slurm.logs()
        time.sleep(PAUSE)


def _idle(slurm: Slurm) -> bool:
    words = ["sinfo", "--noheader", "--format=%T"]
    done = subprocess.run(words, env=slurm.environment, capture_output=True, text=True, timeout=PATIENCE, check=False)
    return done.stdout.strip() == "idle"


def _path() -> str:
    """Return the search path with the folders of daemons, which an ordinary user's leaves out."""
    return os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"])


def _free_ports(count: int) -> list[int]:
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
