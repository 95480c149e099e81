"""LAMMPS alone, as the peer of a whole run: one process, one LAMMPS, and nothing else."""

from __future__ import annotations

import pickle
from pathlib import Path

from lammps_cases.engine.session import EngineRefused, Session


def run(file: str) -> None:
    """Run jobs from a file."""
    session = Session()
    for job in pickle.loads(Path(file).read_bytes()):
        try:
            session.run(job)
        except EngineRefused:
            continue
