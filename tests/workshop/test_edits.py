"""Changes of the source are addressed by syntax tree, and one that is not there is an error that says which."""

from __future__ import annotations

import ast

import pytest

from eos_ref import InputError
from tests.workshop.faults import edits, source

TEXT = """
FACTOR: float = 3.0
WIDTH = 2

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


@pytest.mark.parametrize(
    ("name", "replace", "by", "at", "line"),
    [
        ("Law.pressure", "rho+1", "rho - 1", None, "        total = rho - 1"),
        ("Law.pressure", "2", "3", None, "        total = total * 3"),
        ("Law.pressure", "rho", "x", 3, "        return total + x + 1"),
        ("Law.pressure", "self.log()", "", None, "            pass"),
        ("Law.pressure", "total = rho + 1; total = total * 2", "total = 0", None, "        total = 0"),
        ("Law.pressure", "total = rho + 1", "if rho:\n    total = rho", None, "            total = rho"),
        ("FACTOR", "3.0", "4.0", None, "FACTOR: float = 4.0"),
        ("WIDTH", "2", "5", None, "WIDTH = 5"),
    ],
)
def test_one_place_is_changed(name: str, replace: str, by: str, at: int | None, line: str) -> None:
    before = ast.unparse(ast.parse(TEXT)).splitlines()
    after = edits.edited(TEXT, name, replace, by, at).splitlines()
    assert [text for text in after if text not in before][-1] == line


def test_a_statement_left_out_beside_others_leaves_nothing() -> None:
    after = edits.edited(TEXT, "Law.pressure", "total = total * 2", "")
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
def test_what_is_not_there_is_an_error(name: str, replace: str, at: int | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        edits.edited(TEXT, name, replace, "1", at, "here")


def test_exclusions_are_of_the_modules_that_faults_are_planted_in() -> None:
    functions = [name for names in source.EXCLUDED.values() for name in names]
    assert len(set(functions)) == len(functions)
    assert {name.partition(":")[0] for name in (*functions, *source.EXCLUDED_ASSIGNMENTS)} <= set(source.MODULES)
    assert set(source.ONLY) <= set(source.MODULES)


def test_a_stale_exclusion_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "EXCLUDED", {"derivatives": ("eos.laws:no_such_law",)})
    with pytest.raises(InputError, match=r"'no_such_law' \(exclusions of eos_ref\.eos\.laws\)"):
        source.faults.__wrapped__()


def test_a_stale_assignment_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "EXCLUDED_ASSIGNMENTS", {"eos.laws:linear": ("normal",)})
    with pytest.raises(InputError, match=r"excluded assignment: .*'normal' \(eos\.laws:linear\)"):
        source.faults.__wrapped__()
