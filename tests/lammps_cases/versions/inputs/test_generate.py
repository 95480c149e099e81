"""Generated inputs: the syntax as data, malformed words of every kind, and every arrangement of a command's words."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import get_args

import pytest

from eos_ref import InputError
from eos_ref.syntax.ranges import type_range
from eos_ref.syntax.words import number
from lammps_cases.versions.inputs import syntax
from lammps_cases.versions.inputs.generate import generated
from lammps_cases.versions.inputs.refusals import refusal
from lammps_cases.versions.inputs.syntax import NTYPES, Argument, Form, Kind, forms, text

FORMS = forms()
ALL = generated()
BY_ID = {one.id: one for one in ALL}


# --- the syntax as data


@pytest.mark.parametrize("form", FORMS, ids=[form.id for form in FORMS])
def test_forms_are_legal_and_their_arguments_described(form: Form) -> None:
    assert refusal(form.deck(form.line)) == ""
    assert form.line == text(form.groups)
    arguments = {word.argument for group in form.groups for word in group if word.argument}
    assert arguments <= set(form.command.arguments)


def test_every_argument_and_both_fixes_are_used() -> None:
    commands = list(syntax.syntax())
    for command in commands:
        used = {w.argument for name in command.forms for g in command.form(name).groups for w in g if w.argument}
        assert used == set(command.arguments), command.command
    assert {"fix rheo", "fix rheo/pressure", "pair_style rheo"} <= {command.command for command in commands}
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


@pytest.mark.parametrize(
    ("of", "argument", "names"),
    [
        ("fix-rheo.scale", "cmin", ("cmin", "scale/cross/type")),
        ("fix-rheo.kernel", "cut", ("cut", "cutoff")),  # the style stands in every error of the fix
    ],
)
def test_argument_is_named_by_itself_and_its_keyword(of: str, argument: str, names: tuple[str, ...]) -> None:
    form = next(form for form in FORMS if form.id == of)
    word = next(word for group in form.groups for word in group if word.argument == argument)
    assert form.names(word) == names


# --- malformed words

LEGAL = {"number": "1.2", "integer": "8", "choice": "RK1", "types": "2", "group": "all", "id": "1", "name": "grad/v/xy"}
EDGES = {
    "number": "0 -0.0 -1.2 nan inf 1e-310 1e308 1e309 2147483648 4294967297 -1",
    "integer": f"1.5 8.0 2147483648 4294967297 nan {'9' * 20}",
}


@pytest.mark.parametrize("kind", get_args(Kind))
def test_words_of_a_kind_are_distinct_and_malformed(kind: Kind) -> None:
    words = syntax.words_for(Argument(kind=kind), LEGAL[kind])
    assert len(words) >= 7
    assert LEGAL[kind] not in words.values()
    assert len(set(words.values())) == len(words), "the same word by two names"
    assert any(not word.isascii() for word in words.values()), "other scripts"
    assert set(EDGES.get(kind, "").split()) <= set(words.values())


@pytest.mark.parametrize(("name", "word"), syntax.types(Argument(kind="types"), "").items())
def test_exactly_the_listed_types_are_legal(name: str, word: str) -> None:
    if name in syntax.LEGAL_TYPES:
        assert type_range(word, NTYPES)
    else:
        with pytest.raises(InputError):
            type_range(word, NTYPES)


def test_keywords_are_misspelled() -> None:
    wrong = {"RHO/SUM", "Rho/sum", "rhosum", "rho-sum", "rho/sums", "rho/sux"}
    assert wrong <= set(syntax.words_for_keyword("rho/sum").values())


# --- generated inputs


def test_every_kind_and_arrangement_is_generated_once() -> None:
    assert len(BY_ID) == len(ALL) >= 2000
    kinds = Counter(one.kind for one in ALL)
    least = {"number": 900, "integer": 150, "types": 400, "choice": 60, "keyword": 200, "arrangement": 300}
    least |= {"command": 60, "group": 20, "id": 20, "name": 40}
    assert all(kinds[kind] >= n for kind, n in least.items()), kinds
    assert {one.mutation for one in ALL if one.kind == "arrangement"} == {
        *("left-out", "ends-before-it", "twice", "changed-places", "one-word-more"),
        *("group-twice", "group-twice-first-another", "groups-reversed"),
    }
    for form in FORMS:
        assert len({one.commands for one in ALL if one.form == form}) == sum(one.form == form for one in ALL)


@pytest.mark.parametrize("kind", ["number", "integer"])
def test_reference_accepts_exactly_what_the_syntax_allows(kind: str) -> None:
    """The ranges are stated twice: in the table of the syntax, and in the checks of parsers and model."""
    for one in (one for one in ALL if one.kind == kind):
        value = number(one.word)
        whole = kind == "number" or re.fullmatch(r"[+-]?\d{1,18}", one.word)
        allowed = value is not None and bool(whole) and one.form.command.arguments[one.about].allows(value)
        assert allowed == (not one.refusal), (one.id, one.word, one.refusal)


@pytest.mark.parametrize("kind", ["types", "choice", "keyword", "group", "id", "name", "arrangement", "command"])
def test_many_words_of_other_kinds_but_no_legal_ones_are_refused(kind: str) -> None:
    chosen = [one for one in ALL if one.kind == kind]
    assert sum(bool(one.refusal) for one in chosen) > 0.3 * len(chosen)
    assert not [one.id for one in chosen if one.mutation in ("legal", "group-twice", "groups-reversed") and one.refusal]
    assert not [one.id for one in chosen if one.mutation in ("empty", "upper-case", "full-width") and not one.refusal]


@pytest.mark.parametrize(
    ("id", "promise"),
    [
        ("fix-rheo.kernel.rho0-1.negative", ""),  # no page says that densities are positive
        ("fix-rheo.kernel.rho0-1.nan", "fix rheo, syntax"),
        ("mass.plain.mass.negative", "masses must be positive"),
        ("fix-rheo.kernel.zmin.point-zero", "fix rheo, syntax"),  # a fraction for a whole number
        ("fix-rheo.kernel.zmin.minus-one", ""),
    ],
)
def test_promises_are_those_of_the_manual_not_of_physics(id: str, promise: str) -> None:
    assert BY_ID[id].promise.startswith(promise) and bool(promise) == bool(BY_ID[id].promise)


@pytest.mark.parametrize(
    ("id", "line"),
    [
        ("fix-rheo.kernel.kstyle.capital", "fix 1 all rheo 3.0 Rk1 8 density 1.2 0.7 speed/sound 3.0 8.0"),
        ("fix-rheo.kernel.cs-2.left-out", "fix 1 all rheo 3.0 RK1 8 density 1.2 0.7 speed/sound 3.0"),
        ("fix-rheo.kernel.density.ends-before-it", "fix 1 all rheo 3.0 RK1 8"),
        ("fix-rheo-pressure.cubic.cubic.one-word-more", "fix 3 all rheo/pressure * linear 2 cubic 0.5 9.75"),
        ("fix-rheo-pressure.cubic.A3.minus-zero", "fix 3 all rheo/pressure * linear 2 cubic -0.0"),
        ("mass.plain.types.changed-places", "mass 0.75 2"),
    ],
)
def test_lines_of_generated_inputs(id: str, line: str) -> None:
    one = BY_ID[id]
    assert one.line == line and line in one.commands
    assert one.control != one.input


@pytest.mark.parametrize(
    ("id", "said"),
    [
        ("fix-rheo.kernel.command.left-out", "fix rheo/viscosity: must follow fix rheo"),
        ("fix-rheo.kernel.command.last", "fix rheo/viscosity: must follow fix rheo"),
        ("fix-rheo-pressure.linear.command.twice-by-another-id", "only one"),
        ("fix-rheo-viscosity.constant.command.last", ""),
        ("mass.plain.command.left-out", "mass: must be given for atom type 2"),
    ],
)
def test_mutations_of_whole_commands_are_refused(id: str, said: str) -> None:
    assert said in BY_ID[id].refusal and bool(said) == bool(BY_ID[id].refusal)


def test_words_of_a_clear_error() -> None:
    one = BY_ID["fix-rheo.scale.cmin.word"]
    assert {"cmin", "scale/cross/type", "seven"} <= set(one.clear)
    assert "shiftscale" in one.others
    assert not set(one.clear) & set(one.others)
