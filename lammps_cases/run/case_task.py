"""The tasks of a run in its workers: answers of LAMMPS stay in the workers' files, the main process hands on names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.comparison.store import Store
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure, KeptAnswer, solve
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.case_judgement import judge_into
from lammps_cases.run.prepared_case import PreparedCase

if TYPE_CHECKING:  # judging is the workers' affair: the main process starts sooner without
    from lammps_cases.report.drawn import Drawn

Told = Sequence[Answer | KeptAnswer | Failure]  # what became of the runs of a case


def judge_answers(
    site: str | None,
    folder: Path,
    ready: PreparedCase,
    told: Told,
    engine: EngineRecord,
    store: Store | None,
    judgements: Store | None,
    whole: bool,
) -> tuple[CaseRecord, Drawn | None]:
    """Task: `lammps_cases.run.case_judgement.judge_into`, of answers that other tasks left.

    What only a ``whole`` page shows of cases as expected is not sent for another.
    """
    outcomes = [_read(site, each, ready, k) if isinstance(each, KeptAnswer) else each for k, each in enumerate(told)]
    record, shown = judge_into(site, folder, ready, outcomes, engine, store, judgements)
    return record, replace(shown, more=None) if shown and record.as_expected and not whole else shown


def _read(site: str | None, kept: KeptAnswer, ready: PreparedCase, at: int) -> Answer:
    """Return an answer that was kept; LAMMPS is asked once more if whoever cleans temporary files has taken it."""
    try:
        return kept.read()
    except OSError:
        return solve(site, ready.jobs[at])


def forget(told: Told) -> None:
    """Remove the answers of a case that is judged."""
    for each in told:
        if isinstance(each, KeptAnswer):
            each.forget()
