"""The saved table, its page and its command."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.versions.inputs import table
from lammps_cases.versions.inputs.table import InputRow, InputTable
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
ROWS = (
    InputRow(
        "a.b.c.nan", "fix a", "a <nan>", "c: must be a number", "clear error", "Invalid nan", "c", "number", "nan"
    ),
    InputRow("a.b.c.zero", "fix a", "a 0", "c: must be > 0", "silent NaN", "died & gone", "c", "number", "zero"),
    InputRow("a.b.c.x", "fix a", "a x", "c: no", "crash", "SIGSEGV", "c", "number", "x", "", "syntax", True),
    InputRow("a.b.c.y", "fix a", "a y", "", "vague error", "Illegal", "c", "number", "y"),
    InputRow("a.b.c.z", "fix a", "a z", "", "no effect", "pressure 1 to 2", "c", "number", "z"),
)
TABLE = InputTable("eos-ref inputs", {"distribution": "1.2.3"}, 1.5, ROWS)


def test_counts_of_reactions_and_agreements() -> None:
    assert TABLE.reactions == {"clear error": 1, "silent NaN": 1, "crash": 1}
    assert list(TABLE.reactions) == ["clear error", "silent NaN", "crash"], "the best first"
    assert TABLE.agreements["the reference alone refuses it"] == 2 and TABLE.agreements["LAMMPS alone refuses it"] == 1
    assert [row.id for row in TABLE.unexplained] == ["a.b.c.x"]


def test_files_have_the_whole_table(tmp_path: Path) -> None:
    table.write(TABLE, tmp_path)
    assert table.read(tmp_path) == TABLE
    with (tmp_path / "inputs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["id"] for row in rows] == [row.id for row in ROWS]
    assert rows[1]["reaction"] == "silent NaN"
    assert table.DOCUMENT.plain(TABLE)["schema"] == "eos-ref/inputs/1"


def test_changed_reactions_are_listed() -> None:
    other = (InputRow(**{**vars(ROWS[0]), "reaction": "crash"}), *ROWS[1:4])
    assert [(a.reaction, b.reaction) for a, b in table.changes(ROWS, other)] == [("clear error", "crash")]


def test_page(tmp_path: Path) -> None:
    table.write(TABLE, tmp_path)
    text = (tmp_path / "report.html").read_text()
    assert "died &amp; gone" in text and "died & gone" not in text
    body = text.partition('id="input-table"')[2]
    assert 'id="a.b.c.zero"' in body and 'id="a.b.c.y"' in body
    assert 'id="a.b.c.nan"' not in body, "a clear error tells nothing"
    assert '<tr id="a.b.c.x" data-result="crash" class="open">' in body
    assert "fix a: c" in text


def test_command(eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(chosen: object, *_: object) -> InputTable:
        assert [one.id for one in chosen] == ["mass.plain.mass.nan"]  # type: ignore[attr-defined]
        return TABLE

    monkeypatch.setattr(table, "measure", measure)
    out = eos_ref_command("inputs", "mass.plain.mass.nan", "--out", tmp_path / "a")
    assert out.code == 1
    assert "a.b.c.x: crash: a x" in out.out and "5 inputs, 1 contrary to the manual" in out.out
    out = eos_ref_command(
        "inputs", "mass.plain.mass.nan", "--out", tmp_path / "b", "--against", tmp_path / "a", "--json"
    )
    assert json.loads(out.out)["rows"][2]["candidate"] is True
    out = eos_ref_command("inputs", "--deck", "mass.plain.mass.nan")
    assert out.code == 0 and "mass 2 nan" in out.out.splitlines()
    assert eos_ref_command("inputs", "--deck").code == 2
