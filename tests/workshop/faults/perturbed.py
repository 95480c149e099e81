"""Cases whose input differs from their own, run by LAMMPS and judged as usual."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from eos_ref.model.box import Box
from lammps_cases.comparison.compare import excess
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.store import Store, current
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.interlude import Carried
from lammps_cases.engine.session import Answer, EngineCrashed, EngineRefused, Job
from lammps_cases.engine.workers import Failure, Workers, solve
from lammps_cases.findings import LEDGER
from lammps_cases.findings.variants import Snapshot, combined
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.run.provenance import engine_record
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import in_step_order
from lammps_cases.verdict.case_arrays import snapshot
from lammps_cases.verdict.cases import compare_case, first_step
from lammps_cases.verdict.model_fields import nearest_image
from lammps_cases.verdict.particle_model import Reason
from lammps_cases.verdict.problems import problem_of
from lammps_cases.verdict.twins import compare_twin

T = TypeVar("T")
Rows = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True)
class PerturbedCase:
    """A case, and the jobs given to LAMMPS in place of its own.

    Attributes
    ----------
    ready : the case that judges
    jobs : one, or those of the original and its twin
    row_n : row of every particle of the case in the answers; None: the same order
    """

    ready: PreparedCase
    jobs: tuple[Job, ...]
    row_n: Rows | None = None


@dataclass(frozen=True)
class PerturbedJudge:
    """The context of every verdict: the engine that answers, and the store of predictions."""

    engine: EngineRecord
    store: Store | None = None

    @property
    def predictor(self) -> Predictor:
        """Return the source of predictions: the store, if it was made by the present sources."""
        return Predictor(self.store if self.store and current(self.store) else None)

    def verdict(self, case: PerturbedCase, outcomes: Sequence[Answer | Failure]) -> CaseRecord:
        """Return the ordinary verdict on LAMMPS' answer."""
        ready = case.ready
        ordered = [in_order(o, case.row_n) if isinstance(o, Answer) else o for o in outcomes]
        if ready.twin is not None:
            return compare_twin(ready.case, ready.twin, ordered, self.engine, self.predictor)[0]
        return compare_case(ready.case, ready.eos, ready.atoms, ordered[0], self.engine, self.predictor)[0]


class JudgingWorkers(Workers):
    """Workers, and the judge of their LAMMPS' answers.

    Parameters
    ----------
    store : where predictions are kept, without which every verdict takes as long as a first run
    limit : seconds that a task may take
    """

    def __init__(self, engine: Engine, count: int, store: Store | None, limit: float = 1800.0) -> None:
        super().__init__(engine.site, count)
        self.engine, self.store, self.limit = engine, store, limit

    @cached_property
    def judge(self) -> PerturbedJudge:
        """Return the judge.

        Raises
        ------
        EngineMissing
        """
        who = self.outcome(self.identify())
        return PerturbedJudge(engine_record(self.engine, who), self.store)

    def judging(self, task: Callable[..., T], *arguments: Any) -> Future[T]:
        """Queue a task ``task(site, judge, *arguments)``."""
        return self.call(task, self.judge, *arguments, time_limit=self.limit)


def run_and_judge(site: str | None, judge: PerturbedJudge, case: PerturbedCase) -> CaseRecord:
    """Task: let LAMMPS answer, and judge; a crash takes the worker with it."""
    return judge.verdict(case, [outcome(site, job) for job in case.jobs])


def outcome(site: str | None, job: Job) -> Answer | Failure:
    """Return LAMMPS' answer in this process, or its refusal."""
    try:
        return solve(site, job)
    except EngineRefused as error:
        return Failure("refused", str(error))
    except EngineCrashed as error:
        return Failure("crashed", str(error), error.died)


def first_difference(site: str | None, judge: PerturbedJudge, case: PerturbedCase) -> Reason | None:
    """Task: find the first step, field and atom outside the bound, in a run that is read at every step."""
    answer = in_order(solve(site, case.jobs[0]), case.row_n)
    return first_step(case.ready.case, case.ready.atoms, answer, judge.engine.distribution, judge.predictor)


def in_order(answer: Answer, row_n: Rows | None) -> Answer:
    """Return an answer with its rows exchanged; ids stay, as they are names."""
    if row_n is None or any(len(arrays["id"]) != len(row_n) for arrays in answer.snapshots):
        return answer  # lost atoms are recognised by their ids
    snapshots = tuple(
        {name: values if name == "id" else values[row_n] for name, values in arrays.items()}
        for arrays in answer.snapshots
    )
    carried = tuple(
        Carried(*({k: v if k == "id" else v[row_n] for k, v in side.items()} for side in (both.before, both.after)))
        for both in answer.carried
    )
    return replace(answer, arrays=snapshots[-1], snapshots=snapshots, carried=carried)


def rearranged(job: Job, row_n: Rows, id_n: Rows | None = None) -> Job:
    """Return a job with the atoms of some rows, in that order, and with other ids if any are given."""
    return replace(
        job,
        id_n=job.id_n[row_n] if id_n is None else id_n,
        type_n=job.type_n[row_n],
        x_nc=job.x_nc[row_n],
        v_nc=None if job.v_nc is None else job.v_nc[row_n],
        per_atom={name: values_n[row_n] for name, values_n in job.per_atom.items()},
    )


class RepeatedCase:
    """A case run with one input after another, with the fields that fit LAMMPS' answer to its own input.

    Raises
    ------
    ValueError
        The case is not as expected even so.
    """

    def __init__(self, site: str | None, judge: PerturbedJudge, ready: PreparedCase) -> None:
        self.site, self.ready, self.engine = site, ready, judge.engine
        self.predictor = judge.predictor
        case, scene = ready.case, ready.case.scene
        answer = outcome(site, ready.jobs[0])
        record = self._judged(answer)
        if not record.as_expected or not isinstance(answer, Answer):
            raise ValueError(f"{case.name} is {record.verdict}: {record.message}")
        self.fitting: tuple[Problem, Prediction] | None = None
        if scene.whole_model:
            self.fitting = self._fitting(record, self._snapshots(answer)[0])

    def _judged(self, answer: Answer | Failure) -> CaseRecord:
        ready = self.ready
        return compare_case(ready.case, ready.eos, ready.atoms, answer, self.engine, self.predictor)[0]

    def _fitting(self, record: CaseRecord, first: Snapshot) -> tuple[Problem, Prediction]:
        case, scene = self.ready.case, self.ready.case.scene
        of = problem_of(scene, self.ready.atoms, case.where, scene.snapshots)
        named = {name for field in record.fields for name in field.explained_by}
        variants = [entry.model_variant for entry in LEDGER if entry.id in named and entry.model_variant]
        variant = combined(variants, of, first) if variants else None
        return of, self.predictor.predict(of, variant, seed(f"{record.case}/moved runs"))

    def _snapshots(self, answer: Answer) -> list[Snapshot]:
        return [snapshot(self.ready.case.scene, arrays) for arrays in answer.snapshots]

    def detects(self, job: Job) -> bool:
        """Return whether the ordinary verdict is no longer as expected."""
        return not self._judged(outcome(self.site, job)).as_expected

    def moved(self, job: Job) -> dict[str, float]:
        """Return how far LAMMPS' fields are from what fits them unaltered, over their bounds; empty: no numbers."""
        answer = outcome(self.site, job)
        if isinstance(answer, Failure) or len(answer.arrays["id"]) != len(self.ready.atoms):
            return {}
        if self.fitting is None:
            return {f.field: f.max_over_bound or 0.0 for f in self._judged(answer).fields}
        ratios: dict[str, float] = {}
        of, prediction = self.fitting
        sides = zip(self._snapshots(answer), prediction.fields, prediction.bounds, strict=True)
        for step, (got, fields, bounds) in zip(of.steps, sides, strict=True):
            for name in in_step_order(of.fields):
                ratios[name] = max(
                    ratios.get(name, 0.0), _ratio(of.box_of_images(step), name, got[name], fields[name], bounds[name])
                )
        return ratios


def _ratio(box: Box, name: str, lammps: Any, fitting: Any, bound: Any) -> float:
    """Return the largest ratio of difference to bound, where there is a bound."""
    fitting_n, lammps_n = np.asarray(fitting, float), np.asarray(lammps, float)
    if name == "x":
        lammps_n = nearest_image(box, lammps_n, fitting_n)
    bound_n = np.broadcast_to(bound, fitting_n.shape)
    bounded_n = np.isfinite(bound_n)
    return float(excess(lammps_n[bounded_n], fitting_n[bounded_n], bound_n[bounded_n])[1].max(initial=0.0))
