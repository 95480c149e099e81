"""The reference in place of LAMMPS, with the findings that the engine shows or without any: an answer to be judged.

A mutated reference is loaded in a process of its own, before anything of the package is: its source is changed as it is
read, so that everything built on it is built on the mutation. Only functions of this module therefore import it.
"""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any, Literal

import numpy as np

from lammps_cases.engine import apart
from lammps_cases.engine.session import Answer

# What a mutated reference needs that is not of it: imported once for all of them.
LIGHT = ("numpy", "scipy.special", "scipy.spatial", "pydantic", "yaml", "flint")


@dataclass(frozen=True)
class Mutation:
    """A mutation of the reference: the text of a module, or a mistake that the lint knows by name; or none."""

    module: str = ""
    text: str = ""
    table: Literal["law", "stage", ""] = ""
    name: str = ""


@dataclass(frozen=True)
class Substitution:
    """The reference's answers to the one or two jobs of a case, or how it failed, as LAMMPS would.

    Attributes
    ----------
    verdict : crashed or timeout, where there are no answers
    manual : whether it stands in for a LAMMPS that does what its manual says, without findings
    """

    case: str
    answers: tuple[Answer, ...] = ()
    verdict: Literal["crashed", "timeout", ""] = ""
    message: str = ""
    manual: bool = False

    @property
    def right(self) -> str:
        """Return the name of the file that holds the answers without a mutation."""
        return played_name(self.case, self.manual)


def played_name(case: str, manual: bool) -> str:
    """Return the name of the file of the reference's answers to a case, with the engine's findings or without any."""
    return f"{case}.{'manual' if manual else 'played'}"


class TimeLimitExceeded(Exception):
    """A case that a mutation keeps from ending."""


def load(mutation: Mutation) -> None:
    """Have a module of the reference loaded with another text; before the package is.

    Raises
    ------
    RuntimeError
        The reference is loaded already.
    """
    if mutation.module:
        if any(name.partition(".")[0] == "eos_ref" for name in sys.modules):
            raise RuntimeError("the reference is loaded already")
        sys.meta_path.insert(0, _Finder(f"eos_ref.{mutation.module}", mutation.text))


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, name: str, text: str) -> None:
        self.name, self.text = name, text

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self.name:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path)
        assert spec is not None and spec.origin is not None
        return importlib.util.spec_from_file_location(fullname, spec.origin, loader=_Loader(self, spec.origin))


class _Loader(importlib.machinery.SourceFileLoader):
    def __init__(self, finder: _Finder, path: str) -> None:
        super().__init__(finder.name, path)
        self.text = finder.text

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.text, self.path, "exec")


def answer_apart(site: None, time_limit: float, *given: Any) -> list[Substitution]:
    """Task: do `answer_cases` in a fork of this process, which never loads the reference."""
    for name in LIGHT:
        importlib.import_module(name)
    return apart.call(answer_cases, *given, time_limit=time_limit)


def answer_cases(
    mutation: Mutation, folder: Path, names: Sequence[str], engine: str | None, enough: int, limit: float
) -> list[Substitution]:
    """Answer cases until some answers differ from those without the mutation, in a process without the reference.

    Parameters
    ----------
    folder : of the run without a fault: cases, and both sides' answers
    engine : whose findings the reference shows; None: none
    enough : number of differing answers after which the rest of the cases is left
    limit : seconds of the processor that a case may take, loading included

    Returns
    -------
    list of Substitution
        Only of cases whose answers differ, in order.
    """
    signal.signal(signal.SIGVTALRM, _stop)
    warnings.simplefilter("ignore")
    load(mutation)
    differing: list[Substitution] = []
    for name in names:
        if len(differing) >= enough:
            break
        substitution = _within(limit, name, lambda case: answer_case(mutation, folder, case, engine))
        substitution = replace(substitution, manual=engine is None)
        if substitution.verdict or not _as_without(folder, substitution):
            differing.append(substitution)
    return differing


def _within(limit: float, name: str, answer: Callable[[str], Substitution]) -> Substitution:
    """Answer a case within some seconds of the processor, or return how it failed."""
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    try:
        with np.errstate(all="ignore"):
            return answer(name)
    except TimeLimitExceeded:
        return Substitution(name, verdict="timeout", message=f"did not end within {limit:g} s of the processor")
    except Exception as error:
        return Substitution(name, verdict="crashed", message=f"{type(error).__name__}: {error}")
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


def answer_case(mutation: Mutation, folder: Path, name: str, engine: str | None) -> Substitution:
    """Return the answers of this process' reference to a case that the folder holds."""
    from lammps_cases.studies.mutation.answers import recall

    case = recall(folder, name)
    answers: list[Answer] = []
    same = case.ready.twin is not None and case.ready.twin.same_problem
    for scene, atoms, answer in case.sides:
        if same and answers and len(answers[0].snapshots) == len(answer.snapshots):
            answers.append(answers[0])
        else:  # a variant fitted to LAMMPS' first snapshot is the same for the same problem, whenever that was read
            fit = case.sides[0] if same else (scene, atoms, answer)
            answers.append(answer_side(mutation, case.ready.case.where, scene, atoms, answer, engine, fit))
    return Substitution(name, tuple(answers))


def answer_side(
    mutation: Mutation,
    where: str,
    scene: Any,
    atoms: Any,
    answer: Answer,
    engine: str | None,
    fit: tuple[Any, Any, Answer],
) -> Answer:
    """Return LAMMPS' answer with this process' reference in its place; what no law or stage gives stays LAMMPS'.

    ``fit`` is the scene, particles and answer that findings are fitted to.
    """
    from lammps_cases.verdict.model_cases import problem_of, snapshot

    if not scene.whole_model:
        return _answer_law(mutation, where, scene, atoms, answer)
    stages, stepping = stages_of(
        mutation, problem_of(fit[0], fit[1], where, fit[0].snapshots), snapshot(fit[0], fit[2].snapshots[0]), engine
    )
    return _answer_model(where, scene, atoms, answer, stages, stepping)


def _answer_law(mutation: Mutation, where: str, scene: Any, atoms: Any, answer: Answer) -> Answer:
    """Return the pressures of LAMMPS' own densities."""
    from lammps_cases.comparison.compare import EosState

    got = answer.arrays
    state = EosState(got["id"], got["type"], got["rho"], atoms.mass_n, got.get("esph"))
    eos, p_n = scene.eos(where), None
    if mutation.table == "law":
        from lammps_cases.verdict.law_mistakes import MUTANTS

        p_n = MUTANTS[mutation.name](eos, state)
    if p_n is None:
        p_n = np.empty(len(state.rho_n))
        for t, law in enumerate(eos, 1):
            at = state.type_n == t
            p_n[at] = law.evaluate(state.rho_n[at], None if state.e_n is None else state.e_n[at])
    arrays = got | {"pressure": p_n, "q.pressure": p_n}
    return replace(answer, arrays=arrays, snapshots=(*answer.snapshots[:-1], arrays))


def _answer_model(where: str, scene: Any, atoms: Any, answer: Answer, stages: Any, stepping: Any) -> Answer:
    """Return the fields of the particle model at the steps that LAMMPS was read at."""
    from lammps_cases.comparison.trajectory import visit
    from lammps_cases.verdict.model_cases import problem_of

    problem = problem_of(scene, atoms, where, scene.snapshots)
    sim = problem.simulation(stages, stepping)
    snapshots = []
    for at, _ in enumerate(visit(sim, problem.steps, problem.timestep, problem.stops)):
        fields = {field: np.array(sim.output(field), float) for field in problem.fields}
        snapshots.append(in_place_of(answer.snapshots[at], fields))
    return replace(answer, arrays=snapshots[-1], snapshots=tuple(snapshots))


def stages_of(mutation: Mutation, problem: Any, first: dict[str, Any], engine: str | None) -> tuple[Any, Any]:
    """Return stages and stepping with all findings that the engine shows, a mistake of the lint in front of them."""
    from eos_ref.evaluation.array_evaluator import ArrayEvaluator
    from eos_ref.evaluation.time_step import Simulation
    from lammps_cases.findings import shown_by
    from lammps_cases.findings.variants import combined

    shown = [] if engine is None else shown_by(problem, engine)
    variants = [entry.model_variant for entry in shown if entry.model_variant]
    stages, stepping = combined(variants, problem, first) or (ArrayEvaluator, Simulation)
    if mutation.table == "stage":
        from lammps_cases.verdict.model_mistakes import MUTANTS

        wrong = MUTANTS[mutation.name].stages
        if not issubclass(stages, wrong):
            stages = type(
                "Mutated", (wrong,) if stages is ArrayEvaluator else (wrong, stages), {"__module__": __name__}
            )
    return stages, stepping


def in_place_of(snapshot: dict[str, Any], fields: dict[str, Any]) -> dict[str, Any]:
    """Return LAMMPS' arrays of one step with the reference's fields in place of its own."""
    from lammps_cases.scene.fields import FIELDS

    return snapshot | {
        FIELDS[name].key: FIELDS[name].placed(values, snapshot[FIELDS[name].key]) for name, values in fields.items()
    }
