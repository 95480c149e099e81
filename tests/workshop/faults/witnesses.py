"""Witnesses: the cases that depend on a rule of the reference, found by breaking the rule.

A case depends on a rule if a named mistake that breaks the rule takes a field that the case compares out of its bound,
the findings of the newest LAMMPS taken in: what a finding hides has no witness. A rule that has no formula of its own
is witnessed by the cases that take it. A twin compares LAMMPS with itself and witnesses no formula.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from eos_ref.eos import bounds
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.compare import EosState, evaluate, excess
from lammps_cases.comparison.predictor import Made, Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.store import Store
from lammps_cases.comparison.trajectory import visit
from lammps_cases.engine import forkserver
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import NEWEST, shown_by
from lammps_cases.findings.variants import combined
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.rules import RULES, Rule
from lammps_cases.verdict import mistakes, problems
from lammps_cases.verdict.problems import problem_of
from tests.workshop.faults import formula
from tests.workshop.faults.substitute import mistaken

ENOUGH = 2  # witnesses of a rule, in different scenes, in every dimension in which it has to have them

LIMIT = 3600.0  # seconds that a case may take


@dataclass(frozen=True)
class CaseRules:
    """What a case says of the rules: how many particles or pairs take those that it names, and which it depends on."""

    case: str
    scene: str
    dimension: int
    counts: dict[str, int]
    depends: tuple[str, ...]


def scene_of(case: Case) -> str:
    """Return what tells a scene from others: all of it but what is compared, and how LAMMPS is run."""
    return case.scene.model_dump_json(exclude={"compare", "engine", "manual", "twin"})


def can_witness(case: Case) -> bool:
    """Return whether LAMMPS' numbers are held against the reference's."""
    return case.scene.twin is None and case.scene.expect is None


@dataclass
class ExaminedCase:
    """A case, examined for its rules; what mistakes are held against is computed once.

    Attributes
    ----------
    ready : the case
    predictor : of bounds
    """

    ready: PreparedCase
    predictor: Predictor

    def depends(self, rule: Rule) -> bool:
        """Return whether a mistake that breaks a rule takes a compared field out of its bound."""
        if not can_witness(self.ready.case):
            return False
        if not rule.faults:
            return bool(problems.counts(self.ready.case, self.ready.atoms, self.predictor).get(rule.name))
        detects = self._model_sees if self.ready.case.scene.whole_model else self._law_sees
        with np.errstate(all="ignore"):
            return any(detects(fault) for fault in rule.faults)

    # --- equations of state

    @cached_property
    def _law(self) -> tuple[EosState, Any, Any]:
        """Return the states of a law, its pressures and their bounds."""
        scene, atoms = self.ready.case.scene, self.ready.atoms
        assert self.ready.eos is not None
        rho_n, energy_n = atoms.rho_n, atoms.energy_n
        if rho_n is None or scene.interacts:
            problem = problem_of(scene, atoms, self.ready.case.where, scene.snapshots)
            sim: Simulation = problem.simulation()
            for _ in visit(sim, problem.steps, problem.timestep, problem.stops):
                pass
            rho_n, energy_n = sim.state.rho_n, sim.state.energy_n
        state = EosState(atoms.id_n, atoms.type_n, rho_n, atoms.mass_n, energy_n)
        bound_n = bounds.comparison(self.ready.eos, state.rho_n, state.type_n, state.e_n)
        return state, evaluate(self.ready.eos, state), bound_n

    def _law_sees(self, fault: str) -> bool:
        assert self.ready.eos is not None
        state, p_n, bound_n = self._law
        planted = formula.faults()[fault]
        if isinstance(planted, formula.LintFault):
            if planted.table != "law":
                return False
            mistaken_n = mistakes.LAW_MUTANTS[planted.name](self.ready.eos, state)
        else:
            with formula.made(planted):
                mistaken_n = evaluate(self.ready.eos, state)
        return mistaken_n is not None and _outside(mistaken_n, p_n, bound_n)

    # --- the particle model

    @cached_property
    def _problem(self) -> Problem:
        scene = self.ready.case.scene
        return problem_of(scene, self.ready.atoms, self.ready.case.where, scene.snapshots)

    @cached_property
    def _made(self) -> Made | None:
        """Return the stages and the stepping of the findings that the newest LAMMPS taken in has."""
        variants = [entry.model_variant for entry in shown_by(self._problem, NEWEST) if entry.model_variant]
        fixed = [variant for variant in variants if not variant.fit and not variant.lists and not variant.undefined]
        return combined(fixed, self._problem, {}) if fixed else None

    def _model_sees(self, fault: str) -> bool:
        """Return whether a mistake shows, at the first evaluation or else after steps, which cost more."""
        steps = self._problem.steps
        problems = (replace(self._problem, steps=steps[:count]) for count in range(1, len(steps) + 1))
        return any(self._shows(fault, problem) for problem in problems)

    def _shows(self, fault: str, problem: Problem) -> bool:
        planted, random = formula.faults()[fault], seed(f"{self.ready.case.name}/moved runs")
        stages, stepping = self._made or (ArrayEvaluator, Simulation)
        if isinstance(planted, formula.SourceFault):
            right = self.predictor.predict(problem, self._made, random)
            with formula.made(planted):
                return _differs(problem, right, stages, stepping)
        if planted.table != "stage":
            return False
        wrong = mistakes.MODEL_MUTANTS[planted.name].stages
        if issubclass(stages, wrong):  # the mistake is a finding: does the case show it?
            return _differs(problem, self.predictor.predict(problem, None, random), wrong, Simulation)
        right = self.predictor.predict(problem, self._made, random)
        return _differs(problem, right, mistaken(wrong, stages), stepping)


def _differs(problem: Problem, prediction: Any, stages: Any, stepping: type[Simulation]) -> bool:
    """Return whether the reference as it is now leaves a bound at the last of the steps, or does not get there."""
    try:
        sim = problem.simulation(stages, stepping)
        for _ in visit(sim, problem.steps, problem.timestep, problem.stops):
            pass
        return any(
            _outside(np.asarray(sim.output(field), float), prediction.fields[-1][field], prediction.bounds[-1][field])
            for field in problem.fields
        )
    except Exception:  # the mistaken reference may fail in any way
        return True


def _outside(mistaken_n: Any, reference_n: Any, bound_n: Any) -> bool:
    reference_n = np.asarray(reference_n, float)
    ratio_n = excess(mistaken_n, reference_n, np.broadcast_to(bound_n, reference_n.shape))[1]
    return not bool(np.all(ratio_n <= 1))


def examine(case: Case, every: bool = False, store: Store | None = None) -> CaseRules:
    """Return what a case says of the rules that it names, or of ``every`` rule that it takes; it names no field."""
    ready, predictor = prepare(case), Predictor(store)
    taken = problems.counts(case, ready.atoms, predictor)
    named = {name: taken.get(name, 0) for name in case.exercises}
    counts = named | {name: count for name, count in taken.items() if every or not RULES[name].faults}
    examined = ExaminedCase(ready, predictor)
    depends = tuple(name for name, count in counts.items() if count and examined.depends(RULES[name]))
    return CaseRules(case.name, scene_of(case), case.scene.dimension, counts, depends)


def examine_here(site: None, *given: Any) -> CaseRules:
    """Task: do `examine`, which needs no LAMMPS."""
    return examine(*given)


def collect(
    cases: Sequence[Case], every: bool = False, jobs: int = 1, store: Store | None = None, progress: Progress = SILENT
) -> list[CaseRules]:
    """Examine cases in some processes; in the order of the cases."""
    chosen = [case for case in cases if case.scene.expect is None]
    forkserver.context("tests.workshop.faults.witnesses")
    examined: list[CaseRules] = []
    with Workers(None, jobs) as workers:
        for future in [workers.call(examine_here, case, every, store, time_limit=LIMIT) for case in chosen]:
            examined.append(future.result())
            progress.advance(len(examined), len(chosen), examined[-1].case)
    return examined


# --- what they say together


@dataclass(frozen=True)
class RuleRow:
    """A rule with the cases that depend on it, those of every dimension by themselves.

    Attributes
    ----------
    rule : name of the rule
    sentence : what the reference does by it
    cases : the cases that depend on it, by dimension
    scenes : how many different scenes they are of, by dimension
    taken : number of cases that take it, whether they depend on it or not
    """

    rule: str
    sentence: str
    cases: dict[int, tuple[str, ...]]
    scenes: dict[int, int]
    taken: int

    @property
    def missing(self) -> str:
        """Say in which dimension there are too few witnesses; empty if there are enough."""
        dimensions = RULES[self.rule].dimensions
        if not dimensions:
            count = sum(self.scenes.values())
            return f"{count} of {ENOUGH} witnesses" if count < ENOUGH else ""
        few = [f"{self.scenes[d]} of {ENOUGH} witnesses in {d}D" for d in dimensions if self.scenes[d] < ENOUGH]
        return ", ".join(few)


def rows(examined: Iterable[CaseRules]) -> list[RuleRow]:
    """Return the table of rules and witnesses."""
    every = list(examined)
    return [_row(rule, every) for rule in RULES.values()]


def _row(rule: Rule, examined: Sequence[CaseRules]) -> RuleRow:
    of = {d: [one for one in examined if rule.name in one.depends and one.dimension == d] for d in (2, 3)}
    return RuleRow(
        rule.name,
        rule.sentence,
        {d: tuple(one.case for one in cases) for d, cases in of.items()},
        {d: len({one.scene for one in cases}) for d, cases in of.items()},
        sum(bool(one.counts.get(rule.name)) for one in examined),
    )


def complaints(cases: Sequence[Case], examined: Sequence[CaseRules], rules: bool = True) -> Iterator[str]:
    """Yield what is wrong, one line each: cases that do not depend on what they name, rules with too few witnesses."""
    for row in rows(examined):
        if rules and row.missing:
            yield f"rule {row.rule}: {row.missing}"
    by_name = {case.name: case for case in cases}
    for one in examined:
        case = by_name[one.case]
        for name in case.exercises:
            if not one.counts.get(name):
                yield f"case {one.case} says it exercises {name}, but no {RULES[name].of} of it does"
            elif can_witness(case) and name not in one.depends:
                yield f"case {one.case} says it exercises {name}, but no field it compares depends on that"
