"""Edits of the reference's functions, and their removal."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model import interactions
from eos_ref.model.quantities import needed_to_step
from eos_ref.numbers.rounded import placed
from lammps_cases.comparison.changed import made
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.changes import Change
from lammps_cases.verdict.diagnosis.changes import Watched, stale
from lammps_cases.verdict.diagnosis.edits import EVERYWHERE, FunctionEdits
from lammps_cases.verdict.diagnosis.reached import MODULES, reached
from lammps_cases.verdict.problems import problem_of


class Stage:
    def term(self, a_n: Any, b_n: Any, i: Any, j: Any, h: float, cut: float) -> Any:
        both = (a_n[i] > 0) & (b_n[j] > 0)
        total = a_n[i] * b_n[j] / h
        if cut:
            total = total - np.where(both, max(h, cut), 1.5)
        return total


ARGUMENTS: dict[str, Any] = {
    "a_n": np.array([1.0, -2.0, 3.0]),
    "b_n": np.array([0.5, 1.0, 2.0]),
    "i": np.array([0, 1, 2, 0]),
    "j": np.array([1, 2, 0, 2]),
    "h": 2.0,
    "cut": 3.0,
}


@pytest.fixture(scope="module")
def edits() -> list[Change]:
    return list(FunctionEdits(f"{__name__}:Stage.term", {"self": Stage(), **ARGUMENTS}, "a term ({})"))


def named(edits: list[Change], before: str, after: str, words: str = "") -> Change:
    return next(edit for edit in edits if (edit.replace, edit.by) == (before, after) and words in edit.what)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("b_n[j]", "b_n[i]"),  # the particle instead of its neighbour
        ("a_n", "b_n"),  # another value of the same kind
        ("a_n[i] * b_n[j]", "a_n[j] * b_n[i]"),  # both exchanged
        ("a_n[i] * b_n[j] / h", "a_n[i] * b_n[j]"),  # a factor omitted
        ("h", "cut"),
        ("h", "h * h"),
        ("h", "1.0"),  # a number instead of a parameter
        ("a_n[i]", "-a_n[i]"),
        ("(a_n[i] > 0) & (b_n[j] > 0)", "b_n[j] > 0"),
        ("a_n[i] > 0", "a_n[i] < 0"),
        ("np.where(both, max(h, cut), 1.5)", "np.where(both, 1.5, max(h, cut))"),
        ("max(h, cut)", "max(cut, h)"),
        ("1.5", "0"),
        ("total - np.where(both, max(h, cut), 1.5)", "total"),
        ("total = total - np.where(both, max(h, cut), 1.5)", ""),  # the statement omitted
    ],
)
def test_possible_mistakes_in_an_expression(edits: list[Change], before: str, after: str) -> None:
    assert named(edits, before, after).what.startswith("a term (")


def test_edits_are_distinct_run_and_are_removed(edits: list[Change]) -> None:
    assert len({edit.what for edit in edits}) > 100 and all(edit.replace != edit.by for edit in edits)
    right, changed = Stage().term(**ARGUMENTS), 0
    for edit in edits:
        try:
            with made(edit), np.errstate(all="ignore"):
                changed += not np.array_equal(Stage().term(**ARGUMENTS), right)
        except Exception:  # a meaningless edit
            continue
        np.testing.assert_array_equal(Stage().term(**ARGUMENTS), right)
    assert changed > len(edits) / 2


def test_two_edits_of_a_function_are_combined(edits: list[Change]) -> None:
    arguments = ARGUMENTS | {"a_n": -(ARGUMENTS["a_n"] ** 2)}
    with made(named(edits, "b_n[j]", "b_n[i]", "total = a_n"), named(edits, "h", "cut", "total = a_n")):
        both = Stage().term(**arguments)
    a_n, b_n, i = arguments["a_n"], arguments["b_n"], arguments["i"]
    np.testing.assert_array_equal(both, a_n[i] * b_n[i] / 3.0 - 1.5)


def test_operand_is_replaced_everywhere(edits: list[Change]) -> None:
    with made(named(edits, "h", "cut", EVERYWHERE)):
        changed = Stage().term(**{**ARGUMENTS, "h": 7.0})
    np.testing.assert_array_equal(changed, Stage().term(**{**ARGUMENTS, "h": ARGUMENTS["cut"]}))


def test_functions_are_changed_for_all_callers() -> None:
    (found,) = reached(lambda: interactions.viscous_term(1.0, 2.0, 3.0, 4.0))
    edit = next(edit for edit in found.edits() if edit.replace.startswith("2 * eta") and edit.by.startswith("-"))
    with made(edit):
        assert interactions.viscous_term(1.0, 2.0, 3.0, 4.0) == -48.0
    assert interactions.viscous_term(1.0, 2.0, 3.0, 4.0) == 48.0
    assert edit.sentence.startswith("the viscous coefficient (viscous_term, model/interactions.py:")


@pytest.mark.parametrize(("b", "seen"), [(3.0, False), (4.0, True)])
def test_edits_without_effect_on_a_call_are_omitted(b: float, seen: bool) -> None:
    (found,) = reached(lambda: interactions.arithmetic_mean(3.0, b))
    assert (("a", "b") in {(edit.replace, edit.by) for edit in found.edits()}) == seen


def test_modules_with_formulas_exist() -> None:
    for name in MODULES:
        importlib.import_module(f"eos_ref.{name}")


def test_stale_wall_densities_are_kept_per_solid() -> None:
    """Each solid keeps its own density of the previous evaluation, while the solids that meet fluid change."""
    (case,) = casefile.select(casefile.load(), ["open.walls-after-rebuild"])
    problem = problem_of(case.scene, prepare(case).atoms, case.where, case.scene.snapshots)
    quick = replace(problem.state, v_nc=10 * problem.state.v_nc)
    fresh: list[Any] = []
    met: list[Any] = []

    class RecordingEvaluator(ArrayEvaluator):
        def wall_density(self, at: Any, p: Any, energy_n: Any) -> Any:
            density = super().wall_density(at, p, energy_n)
            fresh.append(placed(density, at, self.rho0_n))
            met.append(at)
            return density

    stages = type("Tried", (stale("wall_density"), RecordingEvaluator), {})
    sim = Watched(problem.model, problem.box, quick, needed_to_step(problem.model), stages)
    sim.setup()
    for _ in range(10):
        sim.step(problem.timestep)
        # In between lies that of the first half of the step.
        np.testing.assert_array_equal(sim.state.rho_n[met[-1]], fresh[-3][met[-1]])
    assert len({len(at) for at in met}) > 1, "the same solids meet fluid in every step"
