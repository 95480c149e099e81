"""Without a fault: LAMMPS' answers to all cases, what the reference plays in its place, and the verdicts on both.

Kept in a folder while faults are planted, one file per case, so that any worker finds what it needs.
"""

from __future__ import annotations

import pickle
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from lammps_cases.comparison.store import Store
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Failure
from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.campaign import Prepared
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.studies.mutation import player
from lammps_cases.studies.mutation.asked import Asked, outcome, verdict
from lammps_cases.studies.mutation.fault import Seen

Outcome = Answer | Failure


@dataclass(frozen=True)
class Known:
    """A case, and how LAMMPS answered its one or two jobs."""

    ready: Prepared
    outcomes: tuple[Outcome, ...]

    @property
    def scenes(self) -> list[tuple[Scene, Atoms]]:
        """The scene and its particles, or those of both runs of a twin."""
        twin = self.ready.twin
        if twin is None:
            return [(self.ready.case.scene, self.ready.atoms)]
        return [(twin.scene, twin.atoms), (twin.other_scene, twin.other_atoms)]

    @property
    def sides(self) -> list[tuple[Scene, Atoms, Answer]]:
        """Scene, particles and LAMMPS' answer; only of cases that were answered."""
        answers = [ended for ended in self.outcomes if isinstance(ended, Answer)]
        return [(scene, atoms, answer) for (scene, atoms), answer in zip(self.scenes, answers, strict=True)]

    @property
    def jobs(self) -> list[Job]:
        """What LAMMPS was told."""
        return self.ready.jobs


@lru_cache(maxsize=128)
def recall(folder: Path, name: str) -> Known:
    """What the folder holds of a case; the same arrays each time, which nobody may change."""
    known: Known = pickle.loads((folder / f"{name}.known").read_bytes())
    return known


@dataclass(frozen=True)
class Control:
    """A case without a fault: whether it is as expected as LAMMPS answers it, and as the reference plays it.

    Attributes
    ----------
    played : None where the reference cannot play: refusals
    red : what is wrong, if it is not as expected
    """

    case: str
    answered: bool
    played: bool | None
    red: tuple[str, ...] = ()


def ask(
    site: str | None, folder: Path, ready: Prepared, engine: EngineRecord, store: Store | None, failed: str = ""
) -> Control:
    """Task: have LAMMPS answer a case and the reference play it, judge both, and keep the answers.

    ``failed`` says how LAMMPS' process ended, where an earlier attempt took its worker with it.
    """
    asked = Asked(ready, tuple(ready.jobs))
    outcomes: list[Outcome] = [Failure("crashed", failed) for _ in asked.jobs]
    if not failed:
        outcomes = [outcome(site, told) for told in asked.jobs]
    _keep(folder / f"{ready.case.name}.known", Known(ready, tuple(outcomes)))
    plain = judge(asked, outcomes, engine, store)
    red = [] if plain.as_expected else [f"{plain.verdict}: {plain.message}"]
    played: bool | None = None
    if all(isinstance(ended, Answer) for ended in outcomes) and ready.eos is not None:
        acted = _played(folder, ready, engine)
        record = judge(asked, list(acted), engine, store)
        played = record.as_expected
        red += [] if played else [f"played: {record.verdict}: {record.message}"]
    return Control(ready.case.name, plain.as_expected, played, tuple(red))


def _played(folder: Path, ready: Prepared, engine: EngineRecord) -> tuple[Answer, ...]:
    acted = player.play_case(player.Mistake(), folder, ready.case.name, engine.distribution).answers
    _keep(folder / f"{ready.case.name}.played", acted)
    return acted


def _keep(path: Path, content: Any) -> None:
    write_atomically(path, pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL))


def judge(asked: Asked, outcomes: list[Outcome], engine: EngineRecord, store: Store | None) -> CaseRecord:
    """The ordinary verdict; a fault of the harness is the verdict `error`, as it is in a run."""
    try:
        return verdict(asked, outcomes, engine, store)
    except Exception as error:
        message = f"{type(error).__name__} in the harness: {error}"
        return CaseRecord(case=asked.ready.case.name, verdict="error", message=message)


def seen(record: CaseRecord) -> Seen | None:
    """What a case shows of a fault; None if it is as expected."""
    if record.as_expected:
        return None
    named = re.search(r"(\S+) \(stage ", record.message)
    return Seen(record.case, record.verdict, named[1] if named else "", record.message)
