"""Tasks of the workers: cases without a fault, then with one fault at a time.

Answers without a fault, LAMMPS' and the reference's in its place, are kept in a folder, one file per case, so that any
worker finds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lammps_cases.engine.session import Answer, EngineCrashed, EngineRefused
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import LEDGER, shown_by
from lammps_cases.records.case_parts import LostAtoms
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run.flow import lists_decide, set_fault
from lammps_cases.run.prepared_case import Answers, PreparedCase, with_lists
from lammps_cases.verdict.problems import problem_of
from tests.workshop.faults import input_faults, output_faults, substitute
from tests.workshop.faults.fault import Detection, files
from tests.workshop.faults.perturbed import PerturbedCase, PerturbedJudge, outcome
from tests.workshop.faults.substitute import AnsweredCase, Outcome, keep, recall


@dataclass(frozen=True)
class Control:
    """A case without a fault: whether LAMMPS' answer and the reference's are as expected.

    Attributes
    ----------
    played : None if the reference cannot stand in: refusals
    manual : the same for the reference without the engine's findings; None also if these change nothing
    red : what is wrong, if it is not as expected
    """

    case: str
    answered: bool
    played: bool | None
    red: tuple[str, ...] = ()
    manual: bool | None = None


def answer_case(
    site: str | None, judge: PerturbedJudge, folder: Path, ready: PreparedCase, failure: str = ""
) -> Control:
    """Task: let LAMMPS and the reference answer a case, judge both, and keep the answers.

    ``failure`` is the end of LAMMPS' process, if an earlier attempt terminated its worker.
    """
    name = ready.case.name
    outcomes: list[Outcome] = [Failure("crashed", failure) if failure else outcome(site, job) for job in ready.jobs]
    case = AnsweredCase(ready, tuple(outcomes))
    plain = _verdict(judge, case, outcomes)
    if (
        plain.fields
        and ready.case.scene.whole_model
        and lists_decide(ready, plain)
        and (looked := Answers(site, ready, outcomes).with_lists())
    ):
        case = AnsweredCase(ready, tuple(looked))
        plain = _verdict(judge, case, looked)
    keep(folder / f"{name}.known", case)
    red = [] if plain.as_expected else [f"{plain.verdict}: {plain.message}"]
    played: bool | None = None
    manual: bool | None = None
    if all(isinstance(one, Answer) for one in outcomes) and ready.eos is not None:
        played = _plays(judge, folder, case, judge.engine.distribution, red)
        if _hidden(ready, judge.engine.distribution):
            manual = _plays(judge, folder, case, None, red)
    return Control(name, plain.as_expected, played, tuple(red), manual)


def _plays(judge: PerturbedJudge, folder: Path, case: AnsweredCase, engine: str | None, red: list[str]) -> bool:
    """Keep the reference's answers for an engine, or for one without findings; return whether they are as expected."""
    name = case.ready.case.name
    answers = substitute.answer_case(None, folder, name, engine).answers
    keep(folder / substitute.played_name(name, engine is None), answers)
    record = _verdict(judge, case, answers)
    if not record.as_expected:
        red.append(f"played{' by the manual' * (engine is None)}: {record.verdict}: {record.message}")
    return record.as_expected


def _hidden(ready: PreparedCase, engine: str) -> bool:
    """Return whether findings of the engine stand in for a part of the reference, whose mistakes they would hide."""
    where = ready.case.where
    problems = [problem_of(s, atoms, where, s.snapshots) for s, atoms in ready.sides if s.whole_model]
    return any(entry.model_variant for problem in problems for entry in shown_by(problem, engine))


def detect(
    site: str | None, judge: PerturbedJudge, folder: Path, fault: str, names: Sequence[str], wanted: int | None
) -> list[Detection]:
    """Task: judge LAMMPS' answers with a fault in its input or output, until cases of so many files detect it."""
    detections: list[Detection] = []
    for name in names:
        case = recall(folder, name)
        outcomes = _of_input(site, fault, case) if fault in input_faults.faults() else _of_output(fault, case)
        if outcomes and (detection := _detection(judge, case, outcomes)):
            detections.append(detection)
            if wanted is not None and len(files(detections)) >= wanted:
                break
    return detections


def _of_input(site: str | None, fault: str, case: AnsweredCase) -> list[Outcome]:
    """Return LAMMPS' answers to the faulty input; none if the fault does not apply or deciding lists are missing.

    If lists decide the verdict, those of the faulty run are read: without them it would be red.
    """
    planted = input_faults.faults()[fault]
    outcomes = [outcome(site, job) for job in input_faults.jobs(planted, case.ready) or ()]
    followed = any(isinstance(one, Answer) and one.lists for one in case.outcomes)
    if not outcomes or not followed or not all(isinstance(one, Answer) for one in outcomes):
        return outcomes
    try:
        return with_lists(site, case.ready, outcomes, input_faults.jobs(planted, case.ready, lists=True) or ())
    except (EngineRefused, EngineCrashed):  # of a run that was read at fewer steps a moment ago
        return []


def _of_output(fault: str, case: AnsweredCase) -> list[Outcome]:
    """Return LAMMPS' faulty answer; of a twin only the first run's, as one file or step of a reader would be."""
    first, *others = case.outcomes
    if not isinstance(first, Answer):
        return []
    faulty_answer = output_faults.applied(output_faults.faults()[fault], first)
    return [faulty_answer, *others] if faulty_answer else []


def judge_failure(
    site: str | None, judge: PerturbedJudge, folder: Path, name: str, failure: Failure
) -> Detection | None:
    """Task: judge that LAMMPS, or its substitute, did not answer."""
    case = recall(folder, name)
    return _detection(judge, case, [failure for _ in case.ready.sides])


def judge_substitution(
    site: str | None, judge: PerturbedJudge, folder: Path, substitution: substitute.Substitution
) -> Detection | None:
    """Task: judge the answer of a mistaken reference."""
    if substitution.verdict:
        failure = Failure(substitution.verdict, substitution.message)
        detection = judge_failure(site, judge, folder, substitution.case, failure)
    else:
        detection = _detection(judge, recall(folder, substitution.case), substitution.answers)
    return detection and replace(detection, manual=substitution.manual)


def _detection(judge: PerturbedJudge, case: AnsweredCase, outcomes: Sequence[Outcome]) -> Detection | None:
    """Return how a case detects a fault; None if it is as expected.

    A fault that looks like a finding of another LAMMPS is detected too: in a run it is a regression.
    """
    record = _verdict(judge, case, outcomes)
    listed = {entry.id for entry in LEDGER if entry.listed(judge.engine.distribution)}
    if record.as_expected and listed.issuperset(record.findings):
        return None
    lost = "id" if isinstance(record.unusable, LostAtoms) else ""
    return Detection(record.case, record.verdict, record.headline.field if record.headline else lost, record.message)


def _verdict(judge: PerturbedJudge, case: AnsweredCase, outcomes: Sequence[Outcome]) -> CaseRecord:
    """Return the ordinary verdict; a fault of the harness is the verdict `error`, as it is in a run."""
    try:
        return judge.verdict(PerturbedCase(case.ready, ()), outcomes)
    except Exception as error:
        record = CaseRecord(case=case.ready.case.name, verdict="error")
        return set_fault(record, error)
