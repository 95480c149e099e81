"""Search for the first of several engines that changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine.session import EngineMissing
from lammps_cases.versions.bisection import Bisection, bisect
from lammps_cases.versions.change import Policy
from lammps_cases.versions.outcomes import Side
from tests.support.edited_runs import of_field
from tests.support.made_sides import case, ended, field, side
from tests.support.outcome import Outcome

BITS = Policy(bits=True)


def _search(sides: list[Side], policy: Policy = BITS, fields: tuple[str, ...] = ()) -> tuple[Bisection, list[int]]:
    asked: list[int] = []

    def ask(at: int) -> Side:
        asked.append(at)
        return sides[at]

    return bisect([str(k) for k in range(len(sides))], ask, policy, fields), asked


@pytest.mark.parametrize("count", [2, 3, 4, 7, 16])
def test_first_change_is_found_with_few_runs(count: int) -> None:
    for first in range(1, count):
        found, asked = _search([side(case("one", field(bits="aa" if k < first else "bb"))) for k in range(count)])
        assert found.first == first
        assert list(found.ran) == asked
        assert len(asked) == len(set(asked)) <= 2 + (count - 2).bit_length()
        assert [(c.kind, c.case) for c in found.changes.faults] == [("within bounds", "one")]


def test_only_the_ends_are_run_if_nothing_changed() -> None:
    found, asked = _search([side(case("one", field()))] * 9)
    assert (found.first, asked, found.changes.faults) == (None, [0, 8], ())


def test_beyond_bounds_ignores_other_bits() -> None:
    sides = [
        side(case("one", field(bits=bits, verdict=verdict)))
        for bits, verdict in (("aa", "pass"), ("bb", "pass"), ("cc", "differs"), ("cc", "differs"))
    ]
    assert _search(sides)[0].first == 1
    assert _search(sides, Policy())[0].first == 2


def test_search_can_be_limited_to_one_field() -> None:
    sides = [side(case("one", field("f", bits=f), field("v", bits=v))) for f, v in (("a", "a"), ("a", "b"), ("b", "b"))]
    assert _search(sides)[0].first == 1
    assert _search(sides, fields=("f",))[0].first == 2
    with pytest.raises(InputError, match="compared by none of the cases, found 'q'"):
        _search(sides, fields=("q",))


def test_engine_that_fails_on_every_case_raises() -> None:
    dead = side(ended("crashed", "crashed"))
    with pytest.raises(EngineMissing, match="1 failed on every case"):
        _search([side(case("one", field())), dead])


@pytest.mark.lammps
def test_command_bisects_saved_runs(
    small_run: Path, changed_run: Callable[..., Path], eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    changed = changed_run(of_field("f", digest="f" * 16), "images.quintic.two")
    out = ("--out", tmp_path / "out")
    code, said, err = eos_ref_command("bisect", small_run, small_run, changed, *out, "--json")
    document = json.loads(said)
    assert (code, err) == (1, "")
    assert (document["first_changed"], document["last_unchanged"]) == (str(changed), str(small_run))
    assert [(row["case"], row["field"]) for row in document["fields"]] == [("images.quintic.two", "f")]
    assert json.loads((tmp_path / "out" / "bisect.json").read_text()) == document
    for more in (("--beyond-bounds",), ("--case", "defaults"), ("--field", "v"), ("--tag", "eos")):
        code, said, _ = eos_ref_command("bisect", small_run, small_run, changed, *out, *more)
        assert (code, "agrees with" in said, "2 of 3" in said) == (0, True, True), more
    assert eos_ref_command("bisect", small_run, *out).code == 2
