"""The reference in place of LAMMPS, with the findings that the engine shows or without any.

A mistaken reference answers in a separate process that ends afterwards, as its results may stay in caches.
"""

from __future__ import annotations

import pickle
import signal
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from types import FrameType
from typing import Any, Literal

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.changed import made, plain_arrays
from lammps_cases.comparison.compare import EosState, evaluate
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import visit
from lammps_cases.engine import apart
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import shown_by
from lammps_cases.findings.variants import combined
from lammps_cases.records.files import write_atomically
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.changes import Change
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.case_arrays import snapshot
from lammps_cases.verdict.mistakes import changes
from lammps_cases.verdict.problems import problem_of
from tests.workshop.faults.fault import Fault, by_id

Outcome = Answer | Failure
Mistake = Change | None


@dataclass(frozen=True)
class FormulaFault(Fault):
    """A planted fault in the formulas of the reference: a change of the catalogue."""

    change: Change

    @property
    def stages(self) -> type[ArrayEvaluator] | None:
        """Return the stages that make a mistake of the particle model; None for an edit of the source."""
        return self.change.stages


@cache
def faults() -> dict[str, FormulaFault]:
    """Return all faults of this family by their id, in order."""
    return by_id(
        FormulaFault(f"formula.{of.id}", of.kind, of.what, of) for of in changes().values() if of.role != "hypothesis"
    )


@dataclass(frozen=True)
class AnsweredCase:
    """A case, and LAMMPS' answers to its one or two jobs."""

    ready: PreparedCase
    outcomes: tuple[Outcome, ...]

    @property
    def sides(self) -> list[tuple[Scene, Atoms, Answer]]:
        """Return scene, particles and LAMMPS' answer of each job; only of cases that were answered."""
        answers = [ended for ended in self.outcomes if isinstance(ended, Answer)]
        return [(scene, atoms, answer) for (scene, atoms), answer in zip(self.ready.sides, answers, strict=True)]


def keep(path: Path, content: AnsweredCase | tuple[Answer, ...]) -> None:
    """Write a case or answers to it, for the time of the campaign."""
    write_atomically(path, pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL))


@lru_cache(maxsize=128)
def recall(folder: Path, name: str) -> AnsweredCase:
    """Return the data of a case in the folder: the same arrays each time, which callers must not change."""
    case: AnsweredCase = pickle.loads((folder / f"{name}.known").read_bytes())
    return case


@dataclass(frozen=True)
class Substitution:
    """The reference's answers to the one or two jobs of a case, or its failure, as of LAMMPS.

    Attributes
    ----------
    verdict : crashed or timeout, if there are no answers
    manual : whether it stands in for a LAMMPS that follows its manual, without findings
    """

    case: str
    answers: tuple[Answer, ...] = ()
    verdict: Literal["crashed", "timeout", ""] = ""
    message: str = ""
    manual: bool = False

    @property
    def right(self) -> str:
        """Return the name of the file that holds the answers without a mistake."""
        return played_name(self.case, self.manual)


def played_name(case: str, manual: bool) -> str:
    """Return the name of the file of the reference's answers to a case, with the engine's findings or without any."""
    return f"{case}.{'manual' if manual else 'played'}"


class TimeLimitExceeded(Exception):
    """A mistake keeps a case from ending."""


def answer_apart(site: str | None, time_limit: float, *given: Any) -> list[Substitution]:
    """Task: run `answer_cases` in a fork of this process."""
    return apart.call(answer_cases, *given, time_limit=time_limit)


def answer_cases(
    mistake: Mistake, folder: Path, names: Sequence[str], engine: str | None, enough: int, limit: float
) -> list[Substitution]:
    """Answer cases until some answers differ from those without the mistake.

    Parameters
    ----------
    folder : of the run without a fault: cases, and both sides' answers
    engine : whose findings the reference shows; None: no findings
    enough : number of differing answers after which the remaining cases are skipped
    limit : seconds of the processor that a case may take

    Returns
    -------
    list of Substitution
        Only of cases whose answers differ, in order.
    """
    signal.signal(signal.SIGVTALRM, _stop)
    warnings.simplefilter("ignore")
    differing: list[Substitution] = []
    for name in names:
        if len(differing) >= enough:
            break
        substitution = _within(limit, mistake, folder, name, engine)
        if substitution.verdict or not _as_without(folder, substitution):
            differing.append(substitution)
    return differing


def _within(limit: float, mistake: Mistake, folder: Path, name: str, engine: str | None) -> Substitution:
    """Answer a case within some seconds of the processor, or return the failure."""
    manual = engine is None
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    try:
        with np.errstate(all="ignore"):
            return answer_case(mistake, folder, name, engine)
    except TimeLimitExceeded:
        message = f"did not end within {limit:g} s of the processor"
        return Substitution(name, verdict="timeout", message=message, manual=manual)
    except Exception as error:
        return Substitution(name, verdict="crashed", message=f"{type(error).__name__}: {error}", manual=manual)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def _stop(number: int, frame: FrameType | None) -> None:
    raise TimeLimitExceeded


def _as_without(folder: Path, substitution: Substitution) -> bool:
    right = pickle.loads((folder / substitution.right).read_bytes())
    return all(
        np.array_equal(a[name], b[name], equal_nan=True)
        for one, other in zip(substitution.answers, right, strict=True)
        for a, b in zip(one.snapshots, other.snapshots, strict=True)
        for name in b
    )


def answer_case(mistake: Mistake, folder: Path, name: str, engine: str | None) -> Substitution:
    """Return the reference's answers to a case that the folder holds, with a mistake or without any."""
    case = recall(folder, name)
    answers: list[Answer] = []
    same = case.ready.twin is not None and case.ready.twin.same_problem
    with made(mistake) if mistake and mistake.function else nullcontext(), plain_arrays():
        for scene, atoms, answer in case.sides:
            if same and answers and len(answers[0].snapshots) == len(answer.snapshots):
                answers.append(answers[0])
            else:  # a variant fitted to LAMMPS' first snapshot is the same for the same problem, whenever that was read
                fit = case.sides[0] if same else (scene, atoms, answer)
                answers.append(_answer_side(mistake, case.ready.case.where, (scene, atoms, answer), engine, fit))
    return Substitution(name, tuple(answers), manual=engine is None)


Side = tuple[Scene, Atoms, Answer]


def _answer_side(mistake: Mistake, where: str, side: Side, engine: str | None, fit: Side) -> Answer:
    """Return LAMMPS' answer with fields of the reference; those that no law or stage gives stay LAMMPS'.

    ``fit`` is the scene, particles and answer that findings are fitted to.
    """
    if not side[0].whole_model:
        return _answer_law(where, *side)
    problem = problem_of(fit[0], fit[1], where, fit[0].snapshots)
    stages, stepping = _stages_of(mistake, problem, snapshot(fit[0], fit[2].snapshots[0]), engine)
    return _answer_model(where, *side, stages, stepping)


def _answer_law(where: str, scene: Scene, atoms: Atoms, answer: Answer) -> Answer:
    """Return the pressures at LAMMPS' densities."""
    got = answer.arrays
    state = EosState(got["id"], got["type"], got["rho"], atoms.mass_n, got.get("esph"))
    p_n = evaluate(scene.eos(where), state)
    arrays = got | {"pressure": p_n, "q.pressure": p_n}
    return replace(answer, arrays=arrays, snapshots=(*answer.snapshots[:-1], arrays))


def _answer_model(where: str, scene: Scene, atoms: Atoms, answer: Answer, stages: Any, stepping: Any) -> Answer:
    """Return the fields of the particle model at the steps that LAMMPS was read at."""
    problem = problem_of(scene, atoms, where, scene.snapshots)
    sim = problem.simulation(stages, stepping)
    snapshots = []
    for at, _ in enumerate(visit(sim, problem.steps, problem.timestep, problem.stops)):
        fields = {field: np.array(sim.output(field), float) for field in problem.fields}
        snapshots.append(in_place_of(answer.snapshots[at], fields))
    return replace(answer, arrays=snapshots[-1], snapshots=tuple(snapshots))


def _stages_of(mistake: Mistake, problem: Problem, first: dict[str, Any], engine: str | None) -> tuple[Any, Any]:
    """Return stages and stepping with all findings that the engine shows, a mistake of the lint in front of them."""
    shown = [] if engine is None else shown_by(problem, engine)
    variants = [entry.model_variant for entry in shown if entry.model_variant]
    stages, stepping = combined(variants, problem, first) or (ArrayEvaluator, Simulation)
    if mistake and mistake.stages:
        stages = mistaken(mistake.stages, stages)
    return stages, stepping


def mistaken(wrong: Any, stages: Any) -> Any:
    """Return stages with those of a mistake in front of them, unless they have it."""
    if issubclass(stages, wrong):
        return stages
    return type("Mistaken", (wrong,) if stages is ArrayEvaluator else (wrong, stages), {"__module__": __name__})


def in_place_of(snapshot: dict[str, Any], fields: dict[str, Any]) -> dict[str, Any]:
    """Return LAMMPS' arrays of one step with the reference's fields in place of its own."""
    return snapshot | {
        FIELDS[name].key: FIELDS[name].placed(values, snapshot[FIELDS[name].key]) for name, values in fields.items()
    }
