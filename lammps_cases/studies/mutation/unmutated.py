"""The run without a fault: LAMMPS' answers to all cases, what the reference gives in its place, the verdicts on both.

Both are kept in a folder while faults are planted, one file per case, so that any worker finds what it needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.records.run_record import CaseRecord, HarnessError, LostAtoms
from lammps_cases.run.campaign import PreparedCase, faulty
from lammps_cases.studies.mutation import substitute
from lammps_cases.studies.mutation.answers import AnsweredCase, Outcome, keep
from lammps_cases.studies.mutation.fault import Detection
from lammps_cases.studies.mutation.perturbed import PerturbedCase, PerturbedJudge, outcome


@dataclass(frozen=True)
class Control:
    """A case without a fault: whether it is as expected as LAMMPS answers it, and as the reference does.

    Attributes
    ----------
    played : None where the reference cannot stand in: refusals
    red : what is wrong, if it is not as expected
    """

    case: str
    answered: bool
    played: bool | None
    red: tuple[str, ...] = ()


def answer_case(
    site: str | None, folder: Path, judge: PerturbedJudge, ready: PreparedCase, failed: str = ""
) -> Control:
    """Task: have LAMMPS and the reference answer a case, judge both, and keep the answers.

    ``failed`` says how LAMMPS' process ended, where an earlier attempt took its worker with it.
    """
    case = PerturbedCase(ready, tuple(ready.jobs))
    outcomes: list[Outcome] = [Failure("crashed", failed) for _ in case.jobs]
    if not failed:
        outcomes = [outcome(site, job) for job in case.jobs]
    keep(folder / f"{ready.case.name}.known", AnsweredCase(ready, tuple(outcomes)))
    plain = verdict(judge, case, outcomes)
    red = [] if plain.as_expected else [f"{plain.verdict}: {plain.message}"]
    played: bool | None = None
    if all(isinstance(ended, Answer) for ended in outcomes) and ready.eos is not None:
        answers = substitute.answer_case(
            substitute.Mutation(), folder, ready.case.name, judge.engine.distribution
        ).answers
        keep(folder / f"{ready.case.name}.played", answers)
        record = verdict(judge, case, list(answers))
        played = record.as_expected
        red += [] if played else [f"played: {record.verdict}: {record.message}"]
    return Control(ready.case.name, plain.as_expected, played, tuple(red))


def verdict(judge: PerturbedJudge, case: PerturbedCase, outcomes: list[Outcome]) -> CaseRecord:
    """Return the ordinary verdict; a fault of the harness is the verdict `error`, as it is in a run."""
    try:
        return judge.verdict(case, outcomes)
    except Exception as error:
        record = CaseRecord(case=case.ready.case.name, verdict="error")
        return faulty(record, HarnessError(exception=type(error).__name__, text=str(error)))


def detection(record: CaseRecord) -> Detection | None:
    """Return what a case shows of a fault; None if it is as expected."""
    if record.as_expected:
        return None
    lost = "id" if isinstance(record.unusable, LostAtoms) else ""
    return Detection(record.case, record.verdict, record.blame.field if record.blame else lost, record.message)
