"""Provenance of a run: engine, versions, machine, command."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import time
from importlib.metadata import version
from pathlib import Path

from lammps_cases.comparison import store
from lammps_cases.engine.installations import Engine, library_sha256
from lammps_cases.engine.workers import Failure
from lammps_cases.records.run_record import EngineRecord, RunRecord


def engine_record(engine: Engine, who: dict[str, str] | Failure) -> EngineRecord:
    """Return the engine's identity (unknown if it died), with the hash of its library."""
    identity = {} if isinstance(who, Failure) else who
    return EngineRecord(name=engine.name, library_sha256=library_sha256(identity.get("library", "")), **identity)


def run_record(engine: EngineRecord, command: str) -> RunRecord:
    """Return a run without cases: versions, machine, date, command."""
    packages = {"eos-ref": "eos-ref", "numpy": "numpy", "numba": "numba", "python-flint": "python-flint"}
    return RunRecord(
        engine=engine,
        reference={"python": platform.python_version(), **{name: version(name) for name in packages}},
        machine={
            "system": f"{platform.system()} {platform.release()}",
            "processor": platform.processor() or platform.machine(),
            "cores": str(os.cpu_count()),
            "kind": store.processor(),
        },
        date=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        command=command,
    )


def command_line() -> str:
    """Return the command as the user typed it, without the folder of the program."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
