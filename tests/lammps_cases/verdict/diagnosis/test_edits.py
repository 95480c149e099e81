"""Edits of the reference's functions, and their removal."""

from __future__ import annotations

import ast
import importlib
from typing import Any

import numpy as np
import pytest

from eos_ref.model import interactions
from lammps_cases.verdict.diagnosis.edits import EVERYWHERE, ExpressionEdit, FunctionEdits, made
from lammps_cases.verdict.diagnosis.reached import MODULES, reached

HERE = """
class Stage:
    def term(self, a_n, b_n, i, j, h, cut):
        both = (a_n[i] > 0) & (b_n[j] > 0)
        total = a_n[i] * b_n[j] / h
        if cut:
            total = total - np.where(both, max(h, cut), 1.5)
        return total
"""


class Stage:
    def term(self, a_n: Any, b_n: Any, i: Any, j: Any, h: float, cut: float) -> Any:
        both = (a_n[i] > 0) & (b_n[j] > 0)
        total = a_n[i] * b_n[j] / h
        if cut:
            total = total - np.where(both, max(h, cut), 1.5)
        return total


ARGUMENTS = {
    "a_n": np.array([1.0, -2.0, 3.0]),
    "b_n": np.array([0.5, 1.0, 2.0]),
    "i": np.array([0, 1, 2, 0]),
    "j": np.array([1, 2, 0, 2]),
    "h": 2.0,
    "cut": 3.0,
}


def edits_here() -> list[ExpressionEdit]:
    return list(FunctionEdits(Stage.term, ast.parse(HERE), {"self": Stage(), **ARGUMENTS}, ()))


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
def test_possible_mistakes_in_an_expression(before: str, after: str) -> None:
    assert (before, after) in {(edit.before, edit.after) for edit in edits_here()}


def test_edits_of_an_expression_are_distinct() -> None:
    edits = [(edit.line, edit.before, edit.after, edit.statement) for edit in edits_here()]
    assert all(before != after for _, before, after, _ in edits)
    assert len(edits) > 100


def test_edited_code_runs_and_the_original_is_restored() -> None:
    right = Stage().term(**ARGUMENTS)
    edits = edits_here()
    changed = 0
    for edit in edits:
        try:
            with made([edit]), np.errstate(all="ignore"):
                changed += not np.array_equal(Stage().term(**ARGUMENTS), right)
        except Exception:  # a meaningless edit
            continue
        np.testing.assert_array_equal(Stage().term(**ARGUMENTS), right)
    assert changed > len(edits) / 2


def test_two_edits_of_a_function_are_combined() -> None:
    edits = {(edit.before, edit.after, edit.statement[:11]): edit for edit in edits_here()}
    own = edits["b_n[j]", "b_n[i]", "total = a_n"], edits["h", "cut", "total = a_n"]
    with made(own):
        both = Stage().term(**{**ARGUMENTS, "a_n": -(ARGUMENTS["a_n"] ** 2)})
    a_n, b_n, i = -(ARGUMENTS["a_n"] ** 2), ARGUMENTS["b_n"], ARGUMENTS["i"]
    np.testing.assert_array_equal(both, a_n[i] * b_n[i] / 3.0 - 1.5)


def test_operand_is_replaced_everywhere() -> None:
    edit = next(e for e in edits_here() if (e.before, e.after, e.statement) == ("h", "cut", EVERYWHERE))
    with made([edit]):
        changed = Stage().term(**{**ARGUMENTS, "h": 7.0})
    np.testing.assert_array_equal(changed, Stage().term(**{**ARGUMENTS, "h": ARGUMENTS["cut"]}))


def test_functions_are_changed_for_all_callers() -> None:
    (found,) = reached(lambda: interactions.viscous_term(1.0, 2.0, 3.0, 4.0))
    edit = next(edit for edit in found.edits() if edit.before.startswith("2 * eta") and edit.after.startswith("-"))
    with made([edit]):
        assert interactions.viscous_term(1.0, 2.0, 3.0, 4.0) == -48.0
    assert interactions.viscous_term(1.0, 2.0, 3.0, 4.0) == 48.0
    assert "the viscous coefficient (viscous_term, model/interactions.py:" in found.sentence(edit)


def test_edits_without_effect_on_a_call_are_omitted() -> None:
    (found,) = reached(lambda: interactions.arithmetic_mean(3.0, 3.0))
    assert ("a", "b") not in {(edit.before, edit.after) for edit in found.edits()}
    (found,) = reached(lambda: interactions.arithmetic_mean(3.0, 4.0))
    assert ("a", "b") in {(edit.before, edit.after) for edit in found.edits()}


def test_modules_with_formulas_exist() -> None:
    for name in MODULES:
        importlib.import_module(f"eos_ref.{name}")
