"""Which cases reach which instructions of LAMMPS' library: a run with a trap on each (`tests.workshop.machine_code`).

``python -m tests.workshop.traps OUT ARGUMENTS...`` is ``eos-ref ARGUMENTS...`` with traps: ``OUT/traps.npz`` has the
place of the functions in the library's file and their bytes, with traps and without; the instructions that every case
reaches go to ``OUT/reached.PID``. Jobs of several ranks run in separate processes, without traps.
"""

from __future__ import annotations

import ctypes
import functools
import json
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.engine import session, workers
from lammps_cases.engine.session import Answer, Job

SOURCE = Path(__file__).with_suffix(".c")


def keep(out: Path, code: bytes, low: int, high: int, instructions: Iterable[int]) -> None:
    """Write the input for the processes of a run: the bytes between two places, and where instructions begin."""
    armed = bytearray(code[low:high])
    for at in instructions:
        armed[at - low] = 0xCC
    right, traps = (np.frombuffer(each, np.uint8) for each in (code[low:high], armed))
    np.savez(out / "traps.npz", low=low, right=right, armed=traps)
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", str(out / "traps.so"), str(SOURCE)], check=True)


def reached(out: Path) -> dict[int, list[str]]:
    """Return the cases that reach every instruction, by its place in the file."""
    cases: dict[int, set[str]] = defaultdict(set)
    for file in out.glob("reached.*"):
        for line in file.read_text().splitlines():
            case, places = json.loads(line)
            for place in places:
                cases[place].add(case)
    return {place: sorted(names) for place, names in cases.items()}


@functools.cache
def _traps(site: str, out: Path) -> tuple[Any, Any, int, Any]:
    """Return the traps of this process, their record, its start, and the objects that must stay alive."""
    library = (Path(site) / "lammps" / "liblammps.so").resolve()
    session.load(site)
    maps = (line.split() for line in Path("/proc/self/maps").read_text().splitlines() if str(library) in line)
    begin, offset = next((words[0].partition("-")[0], words[2]) for words in maps if "x" in words[1])
    base = int(begin, 16) - int(offset, 16)
    with np.load(out / "traps.npz") as kept:
        low, right, armed = int(kept["low"]), kept["right"], kept["armed"]
    hits = np.zeros_like(right)
    traps = ctypes.CDLL(str(out / "traps.so"))
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (right, armed, hits))
    if traps.prepare(ctypes.c_void_p(base), ctypes.c_long(low), ctypes.c_long(len(right)), *pointers):
        raise RuntimeError(f"no traps in {library}")
    return traps, hits, low, (right, armed)


def solve(site: str, out: Path, case: str, job: Job) -> Answer:
    """Run one job, in a worker, and keep the instructions that it reaches."""
    if job.ranks > 1:
        return workers.solve(site, job)
    traps, hits, low, _ = _traps(site, out)
    traps.arm()
    try:
        return workers.solve(site, job)
    finally:
        traps.disarm()
        with (out / f"reached.{os.getpid()}").open("a") as file:
            file.write(json.dumps([case, (np.flatnonzero(hits) + low).tolist()]) + "\n")


def main() -> None:
    """Run a command and record the instructions that every job reaches."""
    from lammps_cases.cli.main import main as eos_ref
    from lammps_cases.run.prepared_case import PreparedCase
    from lammps_cases.setup.commands import job
    from lammps_cases.setup.plan import plan

    out, now = Path(sys.argv.pop(1)).resolve(), [""]

    def jobs(ready: PreparedCase) -> list[Job]:
        now[0] = ready.case.name
        return [job(scene, atoms, plan(scene)) for scene, atoms in ready.sides]

    def submit(pool: workers.Workers, one: Job, time_limit: float) -> Any:
        return pool.call(traced, out, now[0], one, time_limit=time_limit)

    from tests.workshop.traps import solve as traced  # by the name that a worker knows

    PreparedCase.jobs = property(jobs)
    workers.Workers.submit = workers.Workers.submit_for_task = submit
    eos_ref()


if __name__ == "__main__":
    main()
