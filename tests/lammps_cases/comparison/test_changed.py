"""Changes are located by syntax tree, take effect everywhere in a process, and are undone."""

from __future__ import annotations

import ast
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels import quintic
from eos_ref.model import interactions
from eos_ref.model.parameters import Model
from lammps_cases.comparison.changed import made, replaced
from lammps_cases.scene.changes import Change, catalogue
from tests.support.roundings import rounded

CHANGES = catalogue()
TEXT = """
class Law:
    def pressure(self, rho):
        # a comment
        total = (rho +
                 1)
        total = total * 2
        if rho > 0:
            self.log()
        return total + rho + 1
"""


def edited(old: str, new: str, at: int | None = None) -> str:
    """Return the text after an edit, which is undone."""
    tree = ast.parse(TEXT)
    before = ast.unparse(tree)
    replacements = replaced(tree, Change("here", "", function="made:Law.pressure", replace=old, by=new, at=at))
    for put, _ in replacements:
        put()
    after = ast.unparse(tree)
    for _, back in reversed(replacements):
        back()
    assert ast.unparse(tree) == before
    return after


@pytest.mark.parametrize(
    ("old", "new", "at", "lines"),
    [
        ("rho+1", "rho - 1", None, ["total = rho - 1"]),
        ("2", "3", None, ["total = total * 3"]),
        ("rho", "x", 3, ["return total + x + 1"]),
        ("rho", "x", 0, ["total = x + 1", "if x > 0:", "return total + x + 1"]),
        ("self.log()", "", None, ["pass"]),
        ("total = total * 2", "", None, []),
        ("total = rho + 1; total = total * 2", "total = 0", None, ["total = 0"]),
        ("total = rho + 1", "if rho:\n    total = rho", None, ["if rho:", "total = rho"]),
    ],
)
def test_places_are_changed_and_restored(old: str, new: str, at: int | None, lines: list[str]) -> None:
    before = [line.strip() for line in ast.unparse(ast.parse(TEXT)).splitlines()]
    after = [line.strip() for line in edited(old, new, at).splitlines()]
    assert [line for line in after if line not in before] == lines and len(after) <= len(before) + 1
    assert new or old not in after


@pytest.mark.parametrize(
    ("old", "at", "message"),
    [
        ("rho * 7", None, r"'rho \* 7'.*must be in Law.pressure once, found '0 times' \(here\)"),
        ("rho", None, r"must be in Law.pressure once, found '3 times'"),
        ("rho", 4, r"at least 4 times, found '3 times'"),
        ("rho * 7", 0, r"at least 1 times, found '0 times'"),
        ("rho +", None, r"must be Python .*'rho \+' \(here\)"),
    ],
)
def test_missing_target_is_an_error(old: str, at: int | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        edited(old, "1", at)


# --- made in this process


def test_function_is_changed_wherever_it_is_imported() -> None:
    held = quintic.QUINTIC.slope  # bound before the mistake
    right = float(held(np.array(0.5)))
    with made(CHANGES["slope-without-five"]):
        assert float(held(np.array(0.5))) == rounded(right / 5, 3)  # two factors, and the quotient
        with made(CHANGES["viscous-sign"]):
            assert interactions.viscous_term(1.0, 1.0, 1.0, 1.0) == -2.0
        assert interactions.viscous_term(1.0, 1.0, 1.0, 1.0) == 2.0
    assert float(held(np.array(0.5))) == right


def test_methods_and_properties_are_changed_too() -> None:
    law = EOS("linear", 1.2, 3.0, None, 0.5)
    with made(CHANGES["background-dropped"]):
        assert law.evaluate(1.2) == 0.0
    assert law.evaluate(1.2) == 0.5
    order: Any = Model.order
    before = order.fget.__code__
    with made(CHANGES["rk0-corrected"]):
        assert order.fget.__code__ is not before
    assert order.fget.__code__ is before


def test_change_is_undone_after_an_exception() -> None:
    before = ArrayEvaluator.correct.__code__
    with pytest.raises(ZeroDivisionError), made(CHANGES["zmin-ignored"]):
        raise ZeroDivisionError
    assert ArrayEvaluator.correct.__code__ is before


@pytest.mark.parametrize("name", ["eos_ref.model.units:_GRAM", "eos_ref.eos.laws:Law.density"])
def test_only_functions_can_be_changed(name: str) -> None:
    with pytest.raises(InputError, match="name: must be"), made(Change("here", "", function=name, replace="1", by="2")):
        pass


def test_every_change_can_be_applied() -> None:
    for change in CHANGES.values():
        with made(change):
            pass
