"""Very many particles judged, with the memory that takes: ``python -m lammps_cases.studies.capacity.large [CASE ...]``.

Without names a million particles, on one rank and on two. It ends with 1 if LAMMPS differs from what is known of it, or
if the process that judges, and on one rank runs LAMMPS, takes more than 4 GB for each million.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from lammps_cases.scene import casefile
from lammps_cases.studies.capacity.costs import JudgedScene, judged_apart

CASES = Path(__file__).with_name("large.yaml")
MILLION, LIMIT = 1_000_000, 4e9  # particles, and bytes for as many


def said(name: str, scene: JudgedScene) -> str:
    """Return the line of a case."""
    seconds = f"LAMMPS {scene.lammps:.0f} s, judged in {scene.judge:.0f} s of a processor"
    memory = f"{scene.memory / 1e9:.2f} GB of {allowed(scene) / 1e9:.0f}"
    report = f"report {scene.report / 1e6:.1f} MB"
    return f"{name}: {scene.verdict}, {scene.particles:,} particles; {seconds}; {memory}; {report}"


def allowed(scene: JudgedScene) -> float:
    """Return the bytes that judging a scene may take."""
    return LIMIT * max(1.0, scene.particles / MILLION)


def main(names: Sequence[str]) -> int:
    """Judge the cases, print a line for each, return the exit code."""
    code = 0
    for case in casefile.select(casefile.load((CASES,)), names or ["large.million"]):
        with tempfile.TemporaryDirectory() as folder:
            scene = judged_apart(case, Path(folder))
        print(said(case.name, scene), flush=True)
        if scene.verdict not in ("exact", "pass", "explained") or scene.memory > allowed(scene):
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
