"""Parts of a study that a later call does not repeat, and the time they took."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from lammps_cases.records.journal import Parts


@dataclass(frozen=True)
class Result:
    value: float


def parts(folder: Path) -> Parts[Result]:
    return Parts(folder / "parts.jsonl", Result)


def test_a_resumed_study_counts_the_time_of_all_its_calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    first = parts(tmp_path)
    for k, ended in enumerate((3.0, 8.0, 10.0)):
        now = ended
        first.add(f"k{k}", Result(k))
    assert first.earlier == 0.0
    now = 100.0
    second = parts(tmp_path)
    assert [second.get(f"k{k}") for k in (0, 1, 1, 3)] == [Result(0), Result(1), Result(1), None]
    assert second.earlier == 8.0  # without the third, which is not requested here
    now = 107.0
    second.add("k3", Result(3))
    assert (second.get("k3"), second.earlier) == (Result(3), 8.0)  # the time of its own call is not counted twice
    third = parts(tmp_path)
    assert [third.get(f"k{k}") for k in (0, 1, 3)] == [Result(0), Result(1), Result(3)]
    assert third.earlier == 15.0


def test_repeated_part_replaces_the_first(tmp_path: Path) -> None:
    for value in (1.0, math.inf):
        parts(tmp_path).add("k", Result(value))
    assert parts(tmp_path).get("k") == Result(math.inf)


@pytest.mark.parametrize(("resume", "left"), [(True, Result(1.0)), (False, None)])
def test_study_is_resumed_or_restarted(resume: bool, left: Result | None, tmp_path: Path) -> None:
    parts(tmp_path).add("k", Result(1.0))
    with parts(tmp_path).resumed(resume):
        assert parts(tmp_path).get("k") == left
