"""The reference plays LAMMPS: its fields, with the findings that the engine shows, as an answer to be judged.

A mistaken reference is loaded in a process of its own, before anything of the package is: its source is changed on the
way in, so that everything built on it is built on the mistake. This module therefore imports nothing of it by itself.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any, Literal

import numpy as np

from lammps_cases.engine import ranks
from lammps_cases.engine.session import Answer

Snapshots = list[dict[str, Any]]


@dataclass(frozen=True)
class Mistake:
    """What is wrong with the reference: the text of a module, or a mistake that the lint knows by name; or nothing."""

    module: str = ""
    text: str = ""
    table: Literal["law", "stage", ""] = ""
    name: str = ""


@dataclass(frozen=True)
class Played:
    """What the reference plays for a case: answers to its one or two jobs; or how it failed, as LAMMPS would.

    Attributes
    ----------
    verdict : crashed or timeout, where there are no answers
    """

    case: str
    answers: tuple[Answer, ...] = ()
    verdict: Literal["crashed", "timeout", ""] = ""
    message: str = ""


class TooLong(Exception):
    """A case that a mistake keeps from ending."""


def prepare(parent: int) -> None:
    """Begin a process: it ends with its parent, and has nothing to say."""
    threading.Thread(target=ranks.die_with, args=(parent,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGVTALRM, _stop)
    warnings.simplefilter("ignore")


def load(mistake: Mistake) -> None:
    """Have a module of the reference loaded with another text; before the package is.

    Raises
    ------
    RuntimeError
        The reference is loaded already.
    """
    if mistake.module:
        if any(name.partition(".")[0] == "eos_ref" for name in sys.modules):
            raise RuntimeError("the reference is loaded already")
        sys.meta_path.insert(0, _Finder(f"eos_ref.{mistake.module}", mistake.text))


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, name: str, text: str) -> None:
        self.name, self.text = name, text

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self.name:
            return None
        found = importlib.machinery.PathFinder.find_spec(fullname, path)
        assert found is not None and found.origin is not None
        return importlib.util.spec_from_file_location(fullname, found.origin, loader=_Loader(self, found.origin))


class _Loader(importlib.machinery.SourceFileLoader):
    def __init__(self, finder: _Finder, path: str) -> None:
        super().__init__(finder.name, path)
        self.text = finder.text

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.text, self.path, "exec")


def play(mistake: Mistake, folder: Path, names: Sequence[str], engine: str, enough: int, limit: float) -> list[Played]:
    """Task, in a fresh process: play cases until some answers are other ones than those without the mistake.

    Parameters
    ----------
    folder : of the control (`lammps_cases.studies.mutation.control`): cases, LAMMPS' answers, those played without a
    mistake
    enough : number of other answers after which the rest of the cases is left
    limit : seconds of the processor that a case may take, loading included

    Returns
    -------
    list of Played
        Only cases whose answers are other ones, in order.
    """
    load(mistake)
    found: list[Played] = []
    for name in names:
        if len(found) >= enough:
            break
        played = _within(limit, name, lambda at: play_case(mistake, folder, at, engine))
        if played.verdict or not _as_without(folder, played):
            found.append(played)
    return found


def _within(limit: float, name: str, played: Callable[[str], Played]) -> Played:
    """A case played within some seconds of the processor, or how it failed."""
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    try:
        with np.errstate(all="ignore"):
            return played(name)
    except TooLong:
        return Played(name, verdict="timeout", message=f"did not end within {limit:g} s of the processor")
    except Exception as error:
        return Played(name, verdict="crashed", message=f"{type(error).__name__}: {error}")
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def _stop(number: int, frame: FrameType | None) -> None:
    raise TooLong


def _as_without(folder: Path, played: Played) -> bool:
    right = pickle.loads((folder / f"{played.case}.played").read_bytes())
    return all(
        np.array_equal(a[name], b[name], equal_nan=True)
        for one, other in zip(played.answers, right, strict=True)
        for a, b in zip(one.snapshots, other.snapshots, strict=True)
        for name in b
    )


def play_case(mistake: Mistake, folder: Path, name: str, engine: str) -> Played:
    """What the reference of this process plays for a case that the folder of the control holds."""
    from lammps_cases.studies.mutation.control import recall

    known = recall(folder, name)
    answers: list[Answer] = []
    for scene, atoms, answer in known.sides:
        same = answers and known.ready.twin is not None and known.ready.twin.same_problem
        if same and len(answers[0].snapshots) == len(answer.snapshots):
            answers.append(answers[0])
        else:
            answers.append(play_side(mistake, known.ready.case.where, scene, atoms, answer, engine))
    return Played(name, tuple(answers))


def play_side(mistake: Mistake, where: str, scene: Any, atoms: Any, answer: Answer, engine: str) -> Answer:
    """What the reference of this process answers in place of LAMMPS; what no law or stage gives is LAMMPS' own."""
    if not scene.whole_model:
        return _play_law(mistake, where, scene, atoms, answer)
    return _play_model(mistake, where, scene, atoms, answer, engine)


def _play_law(mistake: Mistake, where: str, scene: Any, atoms: Any, answer: Answer) -> Answer:
    """Pressures of LAMMPS' own densities."""
    from lammps_cases.comparison.compare import State

    got = answer.arrays
    state = State(got["id"], got["type"], got["rho"], atoms.mass_n, got.get("esph"))
    eos, p_n = scene.eos(where), None
    if mistake.table == "law":
        from lammps_cases.verdict.law_mistakes import MUTANTS

        p_n = MUTANTS[mistake.name](eos, state)
    if p_n is None:
        p_n = np.empty(len(state.rho_n))
        for t, law in enumerate(eos, 1):
            at = state.type_n == t
            p_n[at] = law.evaluate(state.rho_n[at], None if state.e_n is None else state.e_n[at])
    arrays = got | {"pressure": p_n, "q.pressure": p_n}
    return replace(answer, arrays=arrays, snapshots=(*answer.snapshots[:-1], arrays))


def _play_model(mistake: Mistake, where: str, scene: Any, atoms: Any, answer: Answer, engine: str) -> Answer:
    """Fields of the particle model at the steps that LAMMPS was read at."""
    from lammps_cases.comparison.trajectory import visit, wanted
    from lammps_cases.verdict.judgement import particles_of, snapshot

    problem = particles_of(scene, atoms, where, scene.snapshots)
    stages, stepping = made(mistake, problem, snapshot(scene, answer.snapshots[0]), engine)
    sim = stepping(problem.model, problem.box, problem.state, wanted(problem), stages)
    snapshots = []
    for at, _ in enumerate(visit(sim, problem.steps, problem.timestep)):
        fields = {field: np.array(sim.output(field), float) for field in problem.fields}
        snapshots.append(in_place_of(answer.snapshots[at], fields))
    return replace(answer, arrays=snapshots[-1], snapshots=tuple(snapshots))


def made(mistake: Mistake, problem: Any, first: dict[str, Any], engine: str) -> tuple[Any, Any]:
    """Stages and stepping with all findings that the engine shows, and with a mistake of the lint's before them."""
    from eos_ref.evaluation.array_evaluator import Plain
    from eos_ref.evaluation.time_step import Simulation
    from lammps_cases.findings import shown_by
    from lammps_cases.findings.variants import combined

    variants = [entry.particles for entry in shown_by(problem, engine) if entry.particles]
    stages, stepping = combined(variants, problem, first) or (Plain, Simulation)
    if mistake.table == "stage":
        from lammps_cases.verdict.model_mistakes import MUTANTS

        wrong = MUTANTS[mistake.name].stages
        if not issubclass(stages, wrong):
            stages = type("Mistaken", (wrong,) if stages is Plain else (wrong, stages), {"__module__": __name__})
    return stages, stepping


def in_place_of(snapshot: dict[str, Any], fields: dict[str, Any]) -> dict[str, Any]:
    """LAMMPS' arrays of one step with the reference's fields in place of its own."""
    found = dict(snapshot)
    for field, values in fields.items():
        if field in ("x", "v", "f"):
            found[field] = np.zeros(found[field].shape)
            found[field][:, : values.shape[1]] = values
        elif field in ("drho", "pressure_used"):
            found["pressure" if field == "pressure_used" else field] = values
        else:
            found[f"q.{field}"] = values.reshape(found[f"q.{field}"].shape)
    return found
