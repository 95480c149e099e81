"""Very many particles: the number in the scenes, and the limit of memory."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lammps_cases.scene.casefile import load
from tests.workshop import large


def test_large_scenes_have_the_stated_number_of_particles() -> None:
    cases = {case.name: case for case in load((large.CASES,))}
    sizes = {"million": 1_000_000, "four-million": 4_000_000}
    ranks = {"one": 1, "two": 2}
    assert {name: (math.prod(case.scene.positions.cells), case.scene.engine.ranks) for name, case in cases.items()} == {
        f"large.{size}.{count}": (sizes[size], ranks[count]) for size in sizes for count in ranks
    }
    assert all("long" in case.tags for case in cases.values())


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize(("limit", "code"), [(4e9, 0), (1e6, 1)])
def test_scene_is_judged_within_the_memory_limit(
    limit: float, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = tmp_path / "large.yaml"
    small.write_text(large.CASES.read_text(encoding="utf-8").replace("1000, 1000", "12, 10"), encoding="utf-8")
    monkeypatch.setattr(large, "CASES", small)
    monkeypatch.setattr(large, "LIMIT", limit)
    assert large.main(["large.million.one"]) == code
    line = capsys.readouterr().out
    assert line.startswith("large.million.one: explained, 120 particles; LAMMPS ")
    assert f" of {limit / 1e9:.0f}; report 0." in line


def test_difference_is_not_a_success(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "judged_apart", lambda *_: large.JudgedScene(10, 0.0, 0.0, 10, "differs"))
    assert large.main(["large.million.one"]) == 1
