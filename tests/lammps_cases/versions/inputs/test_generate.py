"""Generated inputs: every kind, every arrangement; the reference accepts exactly what the syntax allows."""

from __future__ import annotations

import re
from collections import Counter

import pytest

from eos_ref.syntax.words import number
from lammps_cases.versions.inputs.generate import Generated, generated
from lammps_cases.versions.inputs.syntax import forms

ALL = generated()
BY_ID = {one.id: one for one in ALL}


def test_every_kind_and_arrangement_is_generated() -> None:
    assert len(BY_ID) == len(ALL) >= 2000
    kinds = Counter(one.kind for one in ALL)
    least = {"number": 900, "integer": 150, "types": 400, "choice": 60, "keyword": 200, "arrangement": 300}
    least |= {"command": 60, "group": 20, "id": 20, "name": 40}
    assert all(kinds[kind] >= n for kind, n in least.items()), kinds
    mutations = {one.mutation for one in ALL if one.kind == "arrangement"}
    assert mutations == {
        *("left-out", "ends-before-it", "twice", "changed-places", "one-word-more"),
        *("group-twice", "group-twice-first-another", "groups-reversed"),
    }
    for form in forms():
        assert len({one.commands for one in ALL if one.form == form}) == sum(one.form == form for one in ALL)


@pytest.mark.parametrize("kind", ["number", "integer"])
def test_reference_accepts_exactly_what_the_syntax_allows(kind: str) -> None:
    """The ranges are stated twice: in the table of the syntax, and in the checks of parsers and model."""
    chosen = [one for one in ALL if one.kind == kind]
    for one in chosen:
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


def test_promises_are_those_of_the_manual_not_of_physics() -> None:
    def promise(id: str) -> str:
        return BY_ID[id].promise

    assert promise("fix-rheo.kernel.rho0-1.negative") == "", "no page says that densities are positive"
    assert promise("fix-rheo.kernel.rho0-1.nan").startswith("fix rheo, syntax")
    assert promise("mass.plain.mass.negative") == "masses must be positive"
    assert promise("fix-rheo.kernel.zmin.point-zero").startswith("fix rheo, syntax"), "a fraction for a whole number"
    assert promise("fix-rheo.kernel.zmin.minus-one") == ""


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
    one: Generated = BY_ID[id]
    assert one.line == line
    assert line in one.commands
    assert one.control != one.input


def test_mutations_of_whole_commands_are_refused() -> None:
    assert BY_ID["fix-rheo.kernel.command.left-out"].refusal == "fix rheo/viscosity: must follow fix rheo"
    assert BY_ID["fix-rheo.kernel.command.last"].refusal == "fix rheo/viscosity: must follow fix rheo"
    assert "only one" in BY_ID["fix-rheo-pressure.linear.command.twice-by-another-id"].refusal
    assert BY_ID["fix-rheo-viscosity.constant.command.last"].refusal == ""
    assert BY_ID["mass.plain.command.left-out"].refusal == "mass: must be given for atom type 2"


def test_words_of_a_clear_error() -> None:
    one = BY_ID["fix-rheo.scale.cmin.word"]
    assert {"cmin", "scale/cross/type", "seven"} <= set(one.clear)
    assert "shiftscale" in one.others
    assert not set(one.clear) & set(one.others)
