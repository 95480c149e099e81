"""Tasks of the workers: some cases with one fault, until one of them detects it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.studies.mutation import catalogue, input_faults, output_faults
from lammps_cases.studies.mutation.answers import AnsweredCase, Outcome, recall
from lammps_cases.studies.mutation.fault import Detection
from lammps_cases.studies.mutation.perturbed import PerturbedCase, PerturbedJudge, outcome
from lammps_cases.studies.mutation.substitute import Substitution
from lammps_cases.studies.mutation.unmutated import detection, verdict


def detect(
    site: str | None, folder: Path, judge: PerturbedJudge, fault: str, names: Sequence[str], every: bool
) -> list[Detection]:
    """Task: judge LAMMPS' answers with a fault in its input or output; of the first case that detects it, or of all."""
    detections: list[Detection] = []
    for name in names:
        case = recall(folder, name)
        outcomes = _of_input(site, fault, case) if fault in catalogue.input_faults() else _of_output(fault, case)
        detected = _detection(judge, case, outcomes) if outcomes else None
        if detected is not None:
            detections.append(detected)
            if not every:
                break
    return detections


def _of_input(site: str | None, fault: str, case: AnsweredCase) -> list[Outcome]:
    """LAMMPS' answers to the faulty input; none if the fault does not apply."""
    jobs = input_faults.jobs(catalogue.input_faults()[fault], case.ready)
    return [outcome(site, job) for job in jobs or ()]


def _of_output(fault: str, case: AnsweredCase) -> list[Outcome]:
    """LAMMPS' faulty answer; of a twin only the first run's, as one file or step of a reader would be."""
    first, *others = case.outcomes
    if not isinstance(first, Answer):
        return []
    faulty = output_faults.applied(output_faults.faults()[fault], first)
    return [faulty, *others] if faulty else []


def judge_failure(
    site: str | None, folder: Path, judge: PerturbedJudge, name: str, failure: Failure
) -> Detection | None:
    """Task: judge that LAMMPS, or what stands in for it, did not answer."""
    case = recall(folder, name)
    return _detection(judge, case, [failure for _ in case.ready.sides])


def judge_substitution(
    site: str | None, folder: Path, judge: PerturbedJudge, substitution: Substitution
) -> Detection | None:
    """Task: judge what a mutated reference answered."""
    case = recall(folder, substitution.case)
    outcomes: list[Outcome] = list(substitution.answers)
    if substitution.verdict:
        outcomes = [Failure(substitution.verdict, substitution.message) for _ in case.ready.sides]
    return _detection(judge, case, outcomes)


def _detection(judge: PerturbedJudge, case: AnsweredCase, outcomes: list[Outcome]) -> Detection | None:
    return detection(verdict(judge, PerturbedCase(case.ready, ()), outcomes))
