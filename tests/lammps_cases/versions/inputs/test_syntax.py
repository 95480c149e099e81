"""The syntax as data: every form is legal, every argument described."""

from __future__ import annotations

import math

import pytest

from lammps_cases.versions.inputs.refusals import refusal
from lammps_cases.versions.inputs.syntax import Argument, Form, forms, syntax, text

FORMS = forms()


@pytest.mark.parametrize("form", FORMS, ids=[form.id for form in FORMS])
def test_forms_are_legal_and_their_arguments_described(form: Form) -> None:
    assert refusal(form.deck(form.line)) == ""
    assert form.line == text(form.groups)
    arguments = {word.argument for group in form.groups for word in group if word.argument}
    assert arguments <= set(form.command.arguments)


def test_every_argument_and_both_fixes_are_used() -> None:
    for command in syntax():
        used = {w.argument for name in command.forms for g in command.form(name).groups for w in g if w.argument}
        assert used == set(command.arguments), command.command
    assert {"fix rheo", "fix rheo/pressure", "pair_style rheo"} <= {command.command for command in syntax()}
    assert len({form.id for form in FORMS}) == len(FORMS)


@pytest.mark.parametrize(
    ("range_", "inside", "outside"),
    [
        ("any", (-1e308, 0.0), (math.nan, math.inf)),
        ("not 0", (-1.0, 5e-324), (0.0, -0.0)),
        ("> 1", (1.1,), (1.0, -2.0, math.inf)),
        (">= 0", (0.0, -0.0), (-5e-324,)),
        ("0 to 1", (0.0, 1.0), (-0.1, 1.1)),
        ("3.0", (3.0,), (3.1,)),
    ],
)
def test_ranges(range_: str, inside: tuple[float, ...], outside: tuple[float, ...]) -> None:
    argument = Argument(kind="number", range=range_)
    assert all(map(argument.allows, inside))
    assert not any(map(argument.allows, outside))


def test_argument_is_named_by_itself_and_its_keyword() -> None:
    form = next(form for form in FORMS if form.id == "fix-rheo.scale")
    word = next(word for group in form.groups for word in group if word.argument == "cmin")
    assert form.names(word) == ("cmin", "scale/cross/type")
    form = next(form for form in FORMS if form.id == "fix-rheo.kernel")
    cut = next(word for group in form.groups for word in group if word.argument == "cut")
    assert form.names(cut) == ("cut", "cutoff"), "the style stands in every error of the fix"
