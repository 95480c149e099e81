"""LAMMPS alone, as the peer of a whole run: one process, one LAMMPS, and nothing else."""

from __future__ import annotations

import pickle
from pathlib import Path

from lammps_cases.engine import session


def run(file: str) -> None:
    """Run jobs from a file."""
    lmp = session.open_lammps()
    for job in pickle.loads(Path(file).read_bytes()):
        try:
            session.run(lmp, job)
        except session.EngineRefused:
            continue
