"""Very many particles judged, and the memory needed: ``python -m tests.workshop.large [CASE ...]``.

Without names a million particles in 2D, on one rank, two and four. The exit code is 1 if LAMMPS differs beyond known
findings, or if the process that judges, and on one rank runs LAMMPS, takes more than 4 GB for each million, 6 in 3D.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure, Workers, identify, solve
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import flow, prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case

CASES = Path(__file__).with_name("large.yaml")
MILLION, LIMIT = 1_000_000, 4e9  # particles, and bytes for as many in 2D
IN_SPACE = 1.5  # times as many for those in 3D, which have more neighbours
PATIENCE = 7200.0


@dataclass(frozen=True)
class JudgedScene:
    """A scene of so many particles: processor seconds of LAMMPS and of the judge, peak bytes of the process.

    For LAMMPS on several ranks wall-clock seconds; ``report``: bytes on disk.
    """

    particles: int
    lammps: float
    judge: float
    memory: int
    verdict: str = ""
    report: int = 0
    dimension: int = 2

    @property
    def allowed(self) -> float:
        """Return the bytes that judging it may take."""
        return LIMIT * max(1.0, self.particles / MILLION) * (IN_SPACE if self.dimension == 3 else 1.0)

    def __str__(self) -> str:
        """Return its line."""
        seconds = f"LAMMPS {self.lammps:.0f} s, judged in {self.judge:.0f} s of a processor"
        memory = f"{self.memory / 1e9:.2f} GB of {self.allowed / 1e9:.0f}"
        return f"{self.verdict}, {self.particles:,} particles; {seconds}; {memory}; report {self.report / 1e6:.1f} MB"


def _judged(site: str | None, case: Case, folder: Path) -> JudgedScene:
    """Task: run and judge a scene."""
    ready = prepared_case.prepare(case)
    begin = time.process_time()
    answers: list[Answer | Failure] = [solve(site, job) for job in ready.jobs]
    answered = time.process_time()
    record = flow.record_case(site, folder, ready, answers, EngineRecord(**identify(site)))
    return JudgedScene(
        len(ready.atoms),
        answered - begin if case.scene.engine.ranks == 1 else record.seconds.lammps,
        time.process_time() - answered,
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        record.verdict,
        sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()),
        case.scene.dimension,
    )


def judged_apart(case: Case) -> JudgedScene:
    """Run and judge a scene in a separate process."""
    with tempfile.TemporaryDirectory() as folder, Workers(None, 1) as workers:
        outcome = workers.outcome(workers.call(_judged, case, Path(folder), time_limit=PATIENCE))
    assert not isinstance(outcome, Failure), outcome.message
    return outcome


def main(names: Sequence[str]) -> int:
    """Judge the cases, print a line for each, return the exit code."""
    code = 0
    for case in casefile.select(casefile.load((CASES,)), names or ["large.million"]):
        scene = judged_apart(case)
        print(f"{case.name}: {scene}", flush=True)
        if scene.verdict not in ("exact", "pass", "explained") or scene.memory > scene.allowed:
            code = 1
    return code


if __name__ == "__main__":
    from tests.workshop import large  # by the name that workers know it by

    sys.exit(large.main(sys.argv[1:]))
