"""Sides of a comparison: words that name a side, selection of its cases, and allowed content of the output folder."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine.installations import Engine
from lammps_cases.versions import sources
from lammps_cases.versions.sources import RunTerms
from tests.support.made_sides import case, side

ACCEPTED = Path("reports/accepted")


@pytest.mark.parametrize(
    ("word", "is_one"), [("env", True), ("pypi:1.0", True), ("path:x", True), ("a/b", True), ("walls", False)]
)
def test_words_that_name_a_side(word: str, is_one: bool) -> None:
    assert sources.is_side(word) == is_one


def test_folder_is_a_side_without_a_slash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one").mkdir()
    assert sources.is_side("one") and not sources.is_side("two")


def test_names_of_sides_are_resolved(tmp_path: Path) -> None:
    assert sources.source("env") == Engine()
    accepted = next(path.parent for path in sorted(ACCEPTED.glob("*/baseline.json")))
    assert getattr(sources.source(str(accepted)), "name", "") == str(accepted)
    with pytest.raises(InputError, match=r"side: must be an engine .env, pypi:VERSION, path:DIR., .*found '.*nowhere'"):
        sources.source(str(tmp_path / "nowhere"))
    for name in ("b", "a"):
        shutil.copytree(accepted, tmp_path / name)
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
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "compare.json").write_text("")
    with pytest.raises(
        InputError, match=r"must be empty or hold an earlier comparison and nothing else.*'thesis\.tex'"
    ):
        sources.output(tmp_path)
    assert (tmp_path / "compare.json").exists(), "nothing was touched"
    with pytest.raises(InputError, match=r"found 'thesis\.tex'"):
        sources.output(tmp_path / "thesis.tex")


def test_saved_sides_are_used_unchanged(tmp_path: Path) -> None:
    accepted = str(next(path.parent for path in sorted(ACCEPTED.glob("*/baseline.json"))))
    both = sources.select([accepted] * 2, ["density"], None, [], tmp_path / "out", RunTerms(1))
    assert not both.cases, "no engine, nothing to run"
    assert both.side(0) is both.each[0]
    assert {name.partition(".")[0] for name in both.side(1).cases} == {"density"}
