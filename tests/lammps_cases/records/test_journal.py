"""Journals outlive a kill at any byte; the parts of a study that a later call does not repeat, and their time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lammps_cases.records.journal import Journal, Parts


@dataclass(frozen=True)
class Result:
    value: float
    name: str = ""


RESULTS = st.lists(st.builds(Result, st.floats(allow_nan=False, allow_infinity=False), st.text(max_size=4)), max_size=5)


@settings(max_examples=30, deadline=None)
@given(RESULTS, RESULTS, st.data())
def test_journal_cut_anywhere_loses_at_most_the_entry_that_was_cut(
    before: list[Result], after: list[Result], data: st.DataObject
) -> None:
    """Of whatever a kill left, all whole entries are read, and those appended later follow."""
    with TemporaryDirectory() as folder:
        journal = Journal(Path(folder) / "deep" / "journal.jsonl", Result)
        assert journal.entries() == []
        for entry in before:
            journal.append(entry)
        whole = journal.file.read_bytes() if before else b""
        cut = data.draw(st.integers(0, len(whole)))
        if before:
            journal.file.write_bytes(whole[:cut])
        kept = before[: whole[:cut].count(b"\n")]
        if whole[cut : cut + 1] == b"\n":  # cut between an entry and the end of its line
            kept = before[: len(kept) + 1]
        for entry in after:
            journal.append(entry)
        assert journal.entries() == kept + after
        left = cut > 0 and whole[cut - 1 : cut] != b"\n" and whole[cut : cut + 1] != b"\n"
        if before or after:
            assert list(journal.lines()) == [*kept, *([None] if left else []), *after]


def parts(folder: Path) -> Parts[Result]:
    return Parts(folder / "parts.jsonl", Result)


def test_resumed_study_counts_the_time_of_all_its_calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_repeated_part_replaces_the_first_until_the_study_is_restarted(tmp_path: Path) -> None:
    for value in (1.0, math.inf):
        parts(tmp_path).add("k", Result(value))
    for resume, left in ((True, Result(math.inf)), (False, None)):
        with parts(tmp_path).resumed(resume):
            assert parts(tmp_path).get("k") == left
