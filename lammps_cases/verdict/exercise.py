"""The changes of the reference that a case detects: those that move a compared field out of its bound."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import closing
from typing import Any

import numpy as np

from eos_ref import EOSTable
from eos_ref.eos import bounds
from eos_ref.evaluation.pairs import sharing
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.changed import codes_of, fields, pressure, reaches
from lammps_cases.comparison.compare import EosState, evaluate, excess
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction, visit
from lammps_cases.scene.atoms import Atoms, seed
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.changes import Change
from lammps_cases.verdict.mistakes import changes as catalogue
from lammps_cases.verdict.problems import problem_of

FEW = 12  # changes that are tried whether or not a run goes through the functions that they edit


def can_see(case: Case) -> bool:
    """Return whether LAMMPS is compared with the reference: not with a refusal, nor with a twin."""
    return case.scene.twin is None and case.scene.expect is None


def exercised(
    case: Case, eos: EOSTable | None, atoms: Atoms, predictor: Predictor, names: Sequence[str] | None = None
) -> dict[str, int]:
    """Return how many particles some changes move out of their bounds; by default the changes that the case is for.

    A change is 0 if no field that the case compares leaves its bound on any particle, at any step.
    """
    names = case.exercises if names is None else names
    if not names or not can_see(case):
        return {}
    changes = [catalogue()[name] for name in names]
    if not case.scene.whole_model:
        assert eos is not None
        of_law = _Law(case, eos, atoms)
        return {change.id: of_law.moved(change) for change in changes}
    problem = problem_of(case.scene, atoms, case.where, case.scene.snapshots, predictor)

    def counts() -> dict[str, int]:
        prediction = predictor.predict(problem, seed=seed(f"{case.name}/moved runs"))
        tried = changes
        if len(changes) > FEW:
            codes = codes_of(lambda: deque(fields(problem), 0))
            tried = [change for change in changes if reaches(change, codes)]
        return {change.id: _moved(change, problem, prediction) if change in tried else 0 for change in changes}

    return predictor.counts(repr(changes), problem, counts)


def rows(
    case: Case, eos: EOSTable | None, atoms: Atoms, predictor: Predictor, every: bool = False
) -> list[dict[str, Any]]:
    """List the changes that a case must detect, or every one that it detects, with the number of particles moved."""
    moved = exercised(case, eos, atoms, predictor, tuple(catalogue()) if every else None)
    return [
        {"change": name, "what": catalogue()[name].what, "moved": count, "for": name in case.exercises}
        for name, count in moved.items()
        if count or name in case.exercises
    ]


class _Law:
    """States of the equations of state of a case, their pressures and bounds."""

    def __init__(self, case: Case, eos: EOSTable, atoms: Atoms) -> None:
        rho_n, energy_n = atoms.rho_n, atoms.energy_n
        if rho_n is None or case.scene.interacts:  # at the end of a run
            problem = problem_of(case.scene, atoms, case.where, case.scene.snapshots)
            sim: Simulation = problem.simulation()
            for _ in visit(sim, problem.steps, problem.timestep, problem.stops):
                pass
            rho_n, energy_n = sim.state.rho_n, sim.state.energy_n
        self.eos = eos
        self.state = EosState(atoms.id_n, atoms.type_n, rho_n, atoms.mass_n, energy_n)
        self.p_n = evaluate(eos, self.state)
        self.bound_n = bounds.comparison(eos, rho_n, atoms.type_n, self.state.e_n)

    def moved(self, change: Change) -> int:
        with np.errstate(all="ignore"):
            p_n = pressure(change, self.eos, self.state) if change.function else None
        return 0 if p_n is None else count_outside([(p_n, self.p_n, self.bound_n)])


def _moved(change: Change, problem: Problem, prediction: Prediction) -> int:
    """Return how many particles leave a bound at the first step that shows it; none if the change fails."""
    # A search that is changed finds other neighbours than the prediction.
    with np.errstate(all="ignore"), sharing([]), closing(fields(problem, [change])) as outputs:
        for right, bound in zip(prediction.fields, prediction.bounds, strict=True):
            try:
                changed = next(outputs)
            except Exception:  # a change that cannot be evaluated has no field to detect it by
                return 0
            if moved := count_outside([(changed[field], right[field], bound[field]) for field in problem.fields]):
                return moved
    return 0


def count_outside(fields: Sequence[tuple[Any, Any, Any]]) -> int:
    """Return how many particles, or components of a global value, leave the bound of a field: the maximum over fields.

    Where the reference has no number, or no bound, nothing counts.
    """
    most = 0
    for changed, reference, bound in fields:
        reference_n = np.atleast_1d(np.asarray(reference, float))
        bound_n = np.broadcast_to(bound, reference_n.shape)
        ratio_n = excess(np.atleast_1d(np.asarray(changed, float)), reference_n, bound_n)[1]
        outside_n = ~(ratio_n <= 1) & np.isfinite(reference_n) & np.isfinite(bound_n)
        most = max(most, int(np.count_nonzero(outside_n.reshape(len(outside_n), -1).any(axis=1))))
    return most
