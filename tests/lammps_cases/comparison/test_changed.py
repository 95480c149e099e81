"""Changes of the source are located by syntax tree, take effect everywhere in a process, and are undone."""

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
from lammps_cases.comparison.changed import edited, made
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


def _edit(name: str, replace: str, by: str, at: int | None = None) -> Change:
    return Change("here", "constant", "", "", f"eos_ref.eos.laws:{name}", replace, by, at)


@pytest.mark.parametrize(
    ("name", "replace", "by", "at", "line"),
    [
        ("Law.pressure", "rho+1", "rho - 1", None, "        total = rho - 1"),
        ("Law.pressure", "2", "3", None, "        total = total * 3"),
        ("Law.pressure", "rho", "x", 3, "        return total + x + 1"),
        ("Law.pressure", "self.log()", "", None, "            pass"),
        ("Law.pressure", "total = rho + 1; total = total * 2", "total = 0", None, "        total = 0"),
        ("Law.pressure", "total = rho + 1", "if rho:\n    total = rho", None, "            total = rho"),
    ],
)
def test_one_place_is_changed(name: str, replace: str, by: str, at: int | None, line: str) -> None:
    before = ast.unparse(ast.parse(TEXT)).splitlines()
    after = edited(TEXT, _edit(name, replace, by, at)).splitlines()
    assert [text for text in after if text not in before][-1] == line


def test_omitted_statement_leaves_no_trace_next_to_others() -> None:
    after = edited(TEXT, _edit("Law.pressure", "total = total * 2", ""))
    assert after == ast.unparse(ast.parse(TEXT)).replace("        total = total * 2\n", "")


@pytest.mark.parametrize(
    ("name", "replace", "at", "message"),
    [
        ("Law.density", "rho", None, r"^name: must be that of a definition .*'Law.density' \(here\)"),
        ("Law.pressure", "rho * 7", None, r"'rho \* 7'.*must be in Law.pressure once, found '0 times' \(here\)"),
        ("Law.pressure", "rho", None, r"must be in Law.pressure once, found '3 times'"),
        ("Law.pressure", "rho", 4, r"at least 4 times, found '3 times'"),
        ("Law.pressure", "rho +", None, r"must be Python .*'rho \+' \(here\)"),
    ],
)
def test_missing_target_is_an_error(name: str, replace: str, at: int | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        edited(TEXT, _edit(name, replace, "1", at))


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


def test_only_functions_can_be_changed() -> None:
    constant = Change("here", "constant", "", "", "eos_ref.model.units:_GRAM", "0.602214129", "1.0")
    with pytest.raises(InputError, match="name: must be"), made(constant):
        pass


def test_every_change_can_be_applied() -> None:
    for change in CHANGES.values():
        if change.function:
            with made(change):
                pass
