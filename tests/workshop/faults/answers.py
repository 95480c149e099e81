"""Answers to cases without a fault, on disk for as long as faults are planted."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.records.files import write_atomically
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms

Outcome = Answer | Failure


@dataclass(frozen=True)
class AnsweredCase:
    """A case, and how LAMMPS answered its one or two jobs."""

    ready: PreparedCase
    outcomes: tuple[Outcome, ...]

    @property
    def sides(self) -> list[tuple[Scene, Atoms, Answer]]:
        """Return scene, particles and LAMMPS' answer of each job; only of cases that were answered."""
        answers = [ended for ended in self.outcomes if isinstance(ended, Answer)]
        return [(scene, atoms, answer) for (scene, atoms), answer in zip(self.ready.sides, answers, strict=True)]


def keep(path: Path, content: AnsweredCase | tuple[Answer, ...]) -> None:
    """Write a case or answers to it."""
    write_atomically(path, pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL))


@lru_cache(maxsize=128)
def recall(folder: Path, name: str) -> AnsweredCase:
    """Return what the folder holds of a case: the same arrays each time, which nobody may change."""
    case: AnsweredCase = pickle.loads((folder / f"{name}.known").read_bytes())
    return case
