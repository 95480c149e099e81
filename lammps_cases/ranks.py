"""One job on several MPI ranks: mpiexec starts this module on each, each leaves its own atoms, `solve` joins them.

``python -m lammps_cases.ranks FOLDER PARENT`` is what a rank runs. LAMMPS initialises MPI itself, and files carry
what the ranks found, so that nothing here needs an MPI of its own.
"""

from __future__ import annotations

import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.engine import Answer, EngineCrashed, EngineMissing, Job, mpiexec, open_lammps, run


def die_with(parent: int) -> None:
    """End this process when another is gone: LAMMPS in a long run notices nothing of a closed pipe."""
    while True:
        try:
            os.kill(parent, 0)
        except OSError:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.5)


def solve(site: str | None, job: Job) -> Answer:
    """Run one job on ``job.ranks`` processes of their own; they die with this one.

    Raises
    ------
    EngineRefused, EngineMissing
        What a rank raised.
    EngineCrashed
        A rank died without a word of LAMMPS.
    """
    with tempfile.TemporaryDirectory(prefix="eos-ref-ranks-") as name:
        folder = Path(name)
        (folder / "job").write_bytes(pickle.dumps((site, job)))
        # This package may lie beside the current folder, as in a checkout.
        paths = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
        program = [sys.executable, "-m", "lammps_cases.ranks", name, str(os.getpid())]
        with (folder / "words").open("wb") as words:
            done = subprocess.run(
                [str(mpiexec(site)), "-launcher", "fork", "-n", str(job.ranks), *program],
                stdin=subprocess.DEVNULL,
                stdout=words,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
                check=False,
            )
        found = [pickle.loads(file.read_bytes()) for file in sorted(folder.glob("rank.*"))]
        for outcome in found:
            if isinstance(outcome, Exception):
                raise outcome
        if done.returncode or len(found) != job.ranks:
            raise EngineCrashed(_last_words(folder / "words", done.returncode))
    return _joined(found)


def _last_words(file: Path, code: int) -> str:
    """What mpiexec says of the end, and the last lines that the ranks printed before its banner."""
    text = file.read_text(errors="replace")
    end = re.search("EXIT STRING: (.*)", text)
    lines = [line.strip() for line in text.split(20 * "=")[0].splitlines() if line.strip()]
    said = [end[1] if end else f"code {code}", *lines[-3:]]
    return f"LAMMPS on several ranks ended with {' / '.join(said)[:300]}"


def _joined(answers: list[Answer]) -> Answer:
    """Atoms of all ranks, sorted by id."""
    snapshots = []
    for parts in zip(*(answer.snapshots for answer in answers), strict=True):
        order_n = np.argsort(np.concatenate([part["id"] for part in parts]), kind="stable")
        snapshots.append({name: np.concatenate([part[name] for part in parts])[order_n] for name in parts[0]})
    seconds = max(answer.seconds for answer in answers)
    slowest = tuple(max(parts) for parts in zip(*(answer.run_seconds for answer in answers), strict=True))
    return Answer(snapshots[-1], seconds, tuple(snapshots), answers[0].steps, slowest)


# --- inside a rank ---


def _rank(folder: Path) -> None:
    site, job = pickle.loads((folder / "job").read_bytes())
    lmp: Any = None
    outcome: Answer | Exception
    try:
        lmp = open_lammps(site)
        size = lmp.extract_setting("world_size")
        if size != job.ranks:
            raise EngineMissing(f"mpiexec and LAMMPS' MPI do not fit: {size} rank instead of {job.ranks}")
        outcome = run(lmp, job)
    except Exception as error:
        outcome = error
    written = folder / f"part.{os.getpid()}"
    written.write_bytes(pickle.dumps(outcome))
    written.rename(folder / f"rank.{os.getpid()}")  # never half a file
    if isinstance(outcome, Exception):
        os._exit(1)  # other ranks may wait for this one for ever; mpiexec ends them
    lmp.finalize()


if __name__ == "__main__":
    threading.Thread(target=die_with, args=(int(sys.argv[2]),), daemon=True).start()
    _rank(Path(sys.argv[1]))
