"""The table of inputs: classes of LAMMPS' reactions, findings that name inputs; its files, page and command."""

from __future__ import annotations

import csv
import fnmatch
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.claims.probes.run import Reply
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import OutcomeFinding
from lammps_cases.versions.inputs import table
from lammps_cases.versions.inputs.table import InputRow, InputTable, counts, digest, every, row, select
from tests.support.outcome import Outcome

IDS = [one.id for one in every()]
HYPHEN = "fix-rheo-pressure.linear.types.hyphen"
SAMPLE = {
    "fix-rheo.kernel.kstyle.lower-case": ("clear error", ""),
    "fix-rheo.kernel.zmin.fraction": ("clear error", ""),
    "fix-rheo.kernel.zmin.minus-one": ("no effect", ""),
    "fix-rheo.kernel.rho0-2.zero": ("silent NaN", ""),
    "fix-rheo.kernel.rho0-1.quoted-minus": ("warning", ""),
    "fix-rheo.kernel.zmin.left-out": ("misleading error", ""),
    HYPHEN: ("silent acceptance", "fix 3 all rheo/pressure * linear 1 tait/water"),
    "fix-rheo-pressure.linear.types.one": ("silent acceptance", ""),
    "fix-rheo-pressure.linear.types.two-stars": ("crash", ""),
    "fix-rheo-pressure.linear.types.full-width": ("clear error", ""),
    "fix-rheo-pressure.linear.command.legal": ("no effect", ""),
}


def test_inputs_of_both_kinds_have_unique_names() -> None:
    assert len(set(IDS)) == len(IDS) >= 600
    assert {"overflow", "fix-rheo.kernel.cut.nan"} <= set(IDS)
    assert [one.id for one in select(["mass.plain.mass.nan", "overf*"])] == ["mass.plain.mass.nan", "overflow"]
    with pytest.raises(InputError, match="no such input"):
        select(["nothing-like-it"])


def test_findings_name_existing_inputs_each_once() -> None:
    patterns = [p for entry in LEDGER if isinstance(entry, OutcomeFinding) for p in entry.expected_inputs]
    assert patterns and len(patterns) == len(set(patterns))
    owners: dict[str, set[str]] = {}
    for entry in (entry for entry in LEDGER if isinstance(entry, OutcomeFinding)):
        for pattern in entry.expected_inputs:
            named = fnmatch.filter(IDS, pattern)
            assert named, pattern
            for id in named:
                owners.setdefault(id, set()).add(entry.id)
    assert not {id: own for id, own in owners.items() if len(own) > 1}


# --- one reaction


def answered(log: str = "", **arrays: Any) -> Reply:
    return Reply("answered", arrays={"id": np.arange(2), "pressure": np.array([1.0, 2.0])} | arrays, log=log)


WARNED = answered("WARNING: something (src/x.cpp:1)")


@pytest.mark.parametrize(
    ("reply", "control", "reaction", "candidate"),
    [
        (answered(), answered(), "no effect", True),
        (answered(pressure=np.array([1.0, 3.0])), answered(), "silent acceptance", True),
        (answered(pressure=np.array([1.0, np.inf])), answered(), "silent NaN", True),
        (Reply("refused", "ERROR: Invalid range string: 1-2"), answered(), "clear error", False),
        (Reply("refused", "ERROR: Illegal tait/water"), answered(), "misleading error", False),
        (Reply("refused", "ERROR: Illegal fix command"), answered(), "vague error", False),
        (WARNED, answered(), "warning", False),
        (WARNED, WARNED, "no effect", True),  # the control has the same warning
    ],
)
def test_row_classifies_the_reaction_of_lammps(reply: Reply, control: Reply, reaction: str, candidate: bool) -> None:
    (bad,) = select([HYPHEN])
    one = row(bad, reply, control)
    assert (one.reaction, one.candidate) == (reaction, candidate)
    accepted = reply.ended == "answered"
    assert one.ledger == ("hyphen-range-accepted" if accepted else "")
    assert one.agreement == ("the reference alone refuses it" if accepted else "both refuse")
    assert (one.area, one.about, one.kind, one.mutation) == ("fix rheo/pressure", "types", "types", "hyphen")


def test_digest_depends_on_the_answer() -> None:
    assert digest(answered()) == digest(answered()) != digest(answered(x=np.zeros(2)))
    assert digest(Reply("refused", "no")) == ""


@pytest.mark.lammps
def test_sample_on_lammps() -> None:
    with Workers(None, 2) as workers:
        rows = table.table(workers, inputs=select(list(SAMPLE)))
    assert {one.id: (one.reaction, one.taken_for) for one in rows} == SAMPLE
    assert all(one.text for one in rows)
    by_argument = counts(rows)
    assert by_argument["fix rheo", "zmin"] == {"clear error": 1, "no effect": 1, "misleading error": 1}
    assert by_argument["fix rheo/pressure", "types"]["both take it"] == 1


# --- the saved table, its page and its command

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


def test_counts_and_changes_of_reactions() -> None:
    assert list(TABLE.reactions.items()) == [("clear error", 1), ("silent NaN", 1), ("crash", 1)], "the best first"
    assert TABLE.agreements["the reference alone refuses it"] == 2 and TABLE.agreements["LAMMPS alone refuses it"] == 1
    assert [row.id for row in TABLE.unexplained] == ["a.b.c.x"]
    other = (InputRow(**{**vars(ROWS[0]), "reaction": "crash"}), *ROWS[1:4])
    assert [(a.reaction, b.reaction) for a, b in table.changes(ROWS, other)] == [("clear error", "crash")]


def test_files_have_the_whole_table_and_the_page_what_a_clear_error_does_not_tell(tmp_path: Path) -> None:
    table.write(TABLE, tmp_path)
    assert table.read(tmp_path) == TABLE
    with (tmp_path / "inputs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["id"] for row in rows] == [row.id for row in ROWS]
    assert rows[1]["reaction"] == "silent NaN"
    assert table.DOCUMENT.plain(TABLE)["schema"] == "eos-ref/inputs/1"
    text = (tmp_path / "report.html").read_text()
    assert "died &amp; gone" in text and "died & gone" not in text and "fix a: c" in text
    body = text.partition('id="input-table"')[2]
    assert [id for id in ["nan", "zero", "x", "y"] if f'id="a.b.c.{id}"' in body] == ["zero", "x", "y"]
    assert '<tr id="a.b.c.x" data-result="crash" class="open">' in body


def test_command(eos_ref_command: Callable[..., Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(chosen: object, *_: object) -> InputTable:
        assert [one.id for one in chosen] == ["mass.plain.mass.nan"]  # type: ignore[attr-defined]
        return TABLE

    monkeypatch.setattr(table, "measure", measure)
    out = eos_ref_command("inputs", "mass.plain.mass.nan", "--out", tmp_path / "a")
    assert out.code == 1
    assert "a.b.c.x: crash: a x" in out.out and "5 inputs, 1 contrary to the manual" in out.out
    against = ("--out", tmp_path / "b", "--against", tmp_path / "a", "--json")
    assert json.loads(eos_ref_command("inputs", "mass.plain.mass.nan", *against).out)["rows"][2]["candidate"] is True
    out = eos_ref_command("inputs", "--deck", "mass.plain.mass.nan")
    assert out.code == 0 and "mass 2 nan" in out.out.splitlines()
    assert eos_ref_command("inputs", "--deck").code == 2
