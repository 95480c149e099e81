"""Tasks of the workers: some cases put to one fault, until one of them sees it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lammps_cases.comparison.store import Store
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.studies.mutation import read, told
from lammps_cases.studies.mutation.asked import Asked, outcome
from lammps_cases.studies.mutation.control import Known, Outcome, judge, recall, seen
from lammps_cases.studies.mutation.fault import Seen
from lammps_cases.studies.mutation.player import Played


def attempt(
    site: str | None,
    folder: Path,
    fault: str,
    names: Sequence[str],
    engine: EngineRecord,
    store: Store | None,
    every: bool,
) -> list[Seen]:
    """Task: judge what LAMMPS gives with a fault of the families `told` and `read`; the first case, or every one."""
    found: list[Seen] = []
    for name in names:
        known = recall(folder, name)
        outcomes = _told(site, fault, known) if fault.startswith("told.") else _read(fault, known)
        saw = seen(judge(Asked(known.ready, ()), outcomes, engine, store)) if outcomes else None
        if saw is not None:
            found.append(saw)
            if not every:
                break
    return found


def _told(site: str | None, fault: str, known: Known) -> list[Outcome]:
    """What LAMMPS answers when it is told otherwise; nothing if the fault does not apply."""
    scenes = known.scenes
    sides = [(scene, job) for (scene, _), job in zip(scenes, known.jobs, strict=True)]
    jobs = told.jobs(told.faults()[fault], sides, [atoms for _, atoms in scenes])
    return [outcome(site, job) for job in jobs or ()]


def _read(fault: str, known: Known) -> list[Outcome]:
    """LAMMPS' answer, spoiled; of a twin only the first run's, as one file or step of a reader would be."""
    first, *others = known.outcomes
    if not isinstance(first, Answer):
        return []
    spoilt = read.spoilt(read.faults()[fault], first)
    return [spoilt, *others] if spoilt else []


def ended(
    site: str | None, folder: Path, name: str, failure: Failure, engine: EngineRecord, store: Store | None
) -> Seen | None:
    """Task: judge that LAMMPS did not answer."""
    known = recall(folder, name)
    return seen(judge(Asked(known.ready, ()), [failure for _ in known.scenes], engine, store))


def judged(site: str | None, folder: Path, played: Played, engine: EngineRecord, store: Store | None) -> Seen | None:
    """Task: judge what a mistaken reference played."""
    known = recall(folder, played.case)
    outcomes: list[Outcome] = list(played.answers)
    if played.verdict:
        outcomes = [Failure(played.verdict, played.message) for _ in known.scenes]
    return seen(judge(Asked(known.ready, ()), outcomes, engine, store))
