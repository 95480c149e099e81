"""Sides of a comparison, by name, case and folder; the first of several engines that changed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import EngineMissing
from lammps_cases.scene import casefile
from lammps_cases.versions import sources
from lammps_cases.versions.bisection import Bisection, bisect
from lammps_cases.versions.change import Policy
from lammps_cases.versions.outcomes import Side
from lammps_cases.versions.sources import RunTerms
from tests.support.edited_runs import of_field
from tests.support.made_sides import case, ended, field, side
from tests.support.outcome import Outcome

ACCEPTED = next(path.parent for path in sorted(Path("reports/accepted").glob("*/baseline.json")))


def test_words_that_name_a_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder is one without a slash, too."""
    monkeypatch.chdir(tmp_path)
    Path("one").mkdir()
    words = ("env", "pypi:1.0", "path:x", "a/b", "one", "two", "walls")
    assert [word for word in words if not sources.is_side(word)] == ["two", "walls"]


def test_names_of_sides_are_resolved(tmp_path: Path) -> None:
    assert sources.source("env") == Engine()
    assert getattr(sources.source(str(ACCEPTED)), "name", "") == str(ACCEPTED)
    with pytest.raises(InputError, match=r"side: must be an engine .env, pypi:VERSION, path:DIR., .*found '.*nowhere'"):
        sources.source(str(tmp_path / "nowhere"))
    for name in ("b", "a"):
        shutil.copytree(ACCEPTED, tmp_path / name)
    with pytest.raises(InputError, match="the folder holds the baselines a, b, found"):
        sources.source(str(tmp_path))


def test_side_is_narrowed_by_name_and_tag() -> None:
    whole = side(*(case(name) for name in ("walls.one", "walls.two", "shift")))

    def left(names: list[str], tagged: set[str] | None = None) -> list[str]:
        return list(sources.narrowed(whole, names, tagged).cases)

    assert left([]) == ["walls.one", "walls.two", "shift"]
    assert left(["walls"]) == ["walls.one", "walls.two"] == left(["w*"])
    assert left(["*o*", "shift"], {"walls.two", "shift"}) == ["walls.two", "shift"]
    with pytest.raises(InputError, match=r"case: is not in it, found 'wall' \(side\)"):
        left(["wall"])
    with pytest.raises(InputError, match=r"cases: none of those chosen is in it \(side\)"):
        left(["shift"], {"walls.one"})


def test_output_folder_may_hold_only_comparisons(tmp_path: Path) -> None:
    assert sources.output(tmp_path / "new") == tmp_path / "new" and not (tmp_path / "new").exists()
    for name in ("compare.json", "compare.html", "bisect.json", ".A.lock"):
        (tmp_path / name).write_text("")
    (tmp_path / "B").mkdir()
    assert sources.output(tmp_path) == tmp_path
    assert sorted(path.name for path in tmp_path.iterdir()) == [".A.lock", "B"], "runs stay until they are repeated"
    for name in ("thesis.tex", "compare.json"):
        (tmp_path / name).write_text("mine")
    said = r"must be empty or hold an earlier comparison and nothing else.*'thesis\.tex'"
    for folder, words in ((tmp_path, said), (tmp_path / "thesis.tex", r"found 'thesis\.tex'")):
        with pytest.raises(InputError, match=words):
            sources.output(folder)
    assert (tmp_path / "compare.json").exists(), "nothing was touched"


def test_saved_sides_are_used_unchanged(tmp_path: Path) -> None:
    both = sources.select([str(ACCEPTED)] * 2, ["density"], None, [], tmp_path / "out", RunTerms(1))
    assert not both.cases, "no engine, nothing to run"
    assert both.side(0) is both.each[0]
    assert {name.partition(".")[0] for name in both.side(1).cases} == {"density"}


def test_side_that_was_run_without_cases_tagged_more_does_not_miss_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sides = {"a": side(*map(case, ("walls.one", "walls.two", "shift"))), "b": side(case("walls.one"))}
    monkeypatch.setattr(sources, "source", sides.get)
    monkeypatch.setattr(casefile, "more", lambda: frozenset({"walls.one", "walls.two"}))
    both = sources.select(["a", "b"], [], None, [], tmp_path / "out", RunTerms(1))
    assert [list(one.cases) for one in both.each] == [["walls.one", "shift"], ["walls.one"]]


# --- bisection


def search(sides: Sequence[Side], policy: Policy = Policy(bits=True), fields: tuple[str, ...] = ()) -> Bisection:  # noqa: B008
    asked: list[int] = []

    def ask(at: int) -> Side:
        asked.append(at)
        return sides[at]

    found = bisect([str(k) for k in range(len(sides))], ask, policy, fields)
    assert list(found.ran) == asked and len(asked) == len(set(asked))
    return found


@pytest.mark.parametrize("count", [2, 3, 4, 7, 16])
def test_first_change_is_found_with_few_runs(count: int) -> None:
    for first in range(1, count):
        found = search([side(case("one", field(bits="aa" if k < first else "bb"))) for k in range(count)])
        assert found.first == first
        assert len(found.ran) <= 2 + (count - 2).bit_length()
        assert [(c.kind, c.case) for c in found.changes.faults] == [("within bounds", "one")]
    same = search([side(case("one", field()))] * count)
    assert (same.first, list(same.ran), same.changes.faults) == (None, [0, count - 1], ())


def test_search_is_of_bits_or_bounds_and_of_all_fields_or_one() -> None:
    bounds = [
        side(case("one", field(verdict=verdict, bits=bits)))
        for bits, verdict in (("aa", "pass"), ("bb", "pass"), ("cc", "differs"), ("cc", "differs"))
    ]
    assert [search(bounds, policy).first for policy in (Policy(bits=True), Policy())] == [1, 2]
    two = [side(case("one", field("f", bits=f), field("v", bits=v))) for f, v in (("a", "a"), ("a", "b"), ("b", "b"))]
    assert [search(two, fields=fields).first for fields in ((), ("f",))] == [1, 2]
    with pytest.raises(InputError, match="compared by none of the cases, found 'q'"):
        search(two, fields=("q",))
    with pytest.raises(EngineMissing, match="1 failed on every case"):
        search([side(case("one", field())), side(ended("crashed", "crashed"))])


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
