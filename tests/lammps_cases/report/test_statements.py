"""Statements of an audit on a deck: the same in every output; advice; the line of an annotation."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from html import unescape
from pathlib import Path

import pytest

from lammps_cases.cli import audit, shared
from lammps_cases.findings import KNOWN, LEDGER
from lammps_cases.records.case_parts import LawRecord
from lammps_cases.records.run_record import CaseRecord, read_run
from lammps_cases.report.annotations import deck_place, place, workflow_commands
from lammps_cases.report.findings import outcome
from lammps_cases.report.statements import SUBJECTS, advice, statements
from lammps_cases.run.report_files import write_run
from tests.support.made_audits import BUG, HOSTILE, OTHER, acting, deck, everything, run
from tests.support.pages import unpacked

ENTRIES = {entry.id: entry for entry in LEDGER}


def plain(text: str) -> str:
    """Remove what only one output has: control characters, backslashes, entities, links, white space."""
    text = re.sub(r"<(?:a|/a|code|/code|li|/li|b class)[^>]*>", "", text)
    return " ".join(re.sub(r"\\([\\`*_\[\]|~#])", r"\1", unescape(text)).replace("\x1b", "").split())


def test_every_statement_is_in_every_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = everything()
    said = statements(case)
    assert {line.subject for line in said} == {*SUBJECTS} and len(said) == 10
    of_run = run(case)
    write_run(of_run, tmp_path)
    headline = outcome(of_run).headline

    for printed in audit.report_lines(case):
        shared.show(printed)
    assert shared.finish(of_run, tmp_path, as_json=False) == 3
    terminal = plain(capsys.readouterr().out)
    shared.finish(of_run, tmp_path, as_json=True)
    document = json.loads(capsys.readouterr().out)
    assert list(document)[:4] == ["state", "sentence", "findings", "statements"]
    assert [finding["id"] for finding in document["findings"]] == [BUG, OTHER]
    assert (document["state"], document["sentence"]) == (headline.state, headline.sentence)
    junit = ET.parse(tmp_path / "junit.xml").find("testsuite/testcase/error")
    assert junit is not None and junit.text is not None and plain(junit.get("message", "")) == plain(headline.sentence)
    outputs = {
        "terminal": terminal,
        "summary.md": plain((tmp_path / "summary.md").read_text(encoding="utf-8")),
        "junit.xml": plain(junit.text),
        "json": plain("\n".join(document["statements"]["in.deck"])),
        "page": plain(unpacked((tmp_path / "report.html").read_text(encoding="utf-8"))),
    }
    for line in said:
        for name, text in outputs.items():
            words = plain(line.text if name == "page" or line.subject == "stopped" else str(line))
            assert words in text, (name, line)
    assert "<b>x</b>" not in (tmp_path / "summary.md").read_text(encoding="utf-8")
    assert "<b>x</b>" not in unpacked((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "findings of the ledger" not in outputs["summary.md"]


def test_the_record_on_disk_has_the_headline(tmp_path: Path) -> None:
    write_run(run(everything()), tmp_path)
    record = read_run(tmp_path)
    assert record.headline is not None and record.headline.model_dump() == {
        "state": outcome(record).headline.state,
        "sentence": outcome(record).headline.sentence,
    }
    document = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert document["headline"]["state"] == "FAIL"


def test_table_of_fields_shows_the_worst_sample() -> None:
    _, first, pressure = audit.field_table(everything())
    assert first.split() == ["q0", "all", "3", "700", "0", "0.5", "10", "1", "pass", "to", "step", "40"]
    assert pressure.endswith("exact (same rounding)")


# --- advice


def law(t: int = 1, mass: float | None = 1.0, rho0: float = 1.0, **more: bool) -> LawRecord:
    return LawRecord(type=t, style="linear", rho0=rho0, cs=1.0, mass=mass, **more)


@pytest.mark.parametrize(
    ("finding", "laws", "has", "has_not"),
    [
        (BUG, [law(mass=0.5, rho0=2.0), law(2, 1e-3, 4e-3)], "Here it is 0.25 (types 1, 2).", "already"),
        (BUG, [law(mass=0.5), law(2)], "Here it is 0.5 (type 1).", "type 2"),
        (BUG, [law(mass=0.1 * 3, rho0=0.3)], "m/rho0 is 1 already", "Choose masses"),
        (BUG, [law(), law(2, None)], "Choose masses", "Here"),
        (BUG, [], "LAMMPS 2025.7.22.1.0 does not have this bug.", "Here"),
        ("heat-over-density", [law(), law(2)], "rho0 is 1 already", "Multiply"),
        ("heat-over-density", [law(rho0=2.0)], "Multiply", "already"),
        ("wall-velocity-lost", [law()], "Keep walls at rest", "already"),
        ("wall-velocity-lost", [law(freezes=True)], "", "walls"),
        ("temperature-without-mass", [], "or use 2025.7.22.2.0 or newer", "does not have"),
    ],
)
def test_advice_is_possible_and_not_yet_followed(finding: str, laws: list[LawRecord], has: str, has_not: str) -> None:
    said = advice(ENTRIES[finding], deck(laws=laws))
    assert has in said and has_not not in said


def test_advised_version_is_known_and_without_the_bug() -> None:
    for entry in LEDGER:
        named = re.search(r"LAMMPS (\S+) does not have this bug", advice(entry, deck()))
        assert named is None or (named[1] in KNOWN and not entry.listed(named[1])), entry.id


def test_a_finding_of_another_ledger_is_named() -> None:
    (line,) = statements(deck(acting=[acting("it acts", "theirs")]))
    assert str(line) == "known bug theirs: it acts"


# --- annotations

DECK = "units lj\ninclude sub/a.inc\nfix 1 all rheo 3.0 quintic 0\n  fix 2 all rheo/viscosity 1-2 constant 0.1\nrun 2\n"


@pytest.mark.parametrize(
    ("error", "warnings", "file", "line"),
    [
        ("ERROR: Lost atoms: original 9 current 2 (in.deck:5)", [], "in.deck", 5),
        ("ERROR: Unknown command (src/input.cpp:3) (sub/a.inc:7)", [], "sub/a.inc", 7),
        ("ERROR: x (nowhere.inc:7)", [], "in.deck", 1),
        ("ERROR: x (../outside:7)", [], "in.deck", 1),
        ("", ["a mass", "fix 2 (rheo/viscosity): '1-2' is not a valid type range"], "in.deck", 4),
        ("", ["fix 2 (rheo): not there"], "in.deck", 1),
        ("", [HOSTILE], "in.deck", 1),
    ],
)
def test_annotation_is_at_the_line_of_the_error(
    error: str, warnings: list[str], file: str, line: int, tmp_path: Path
) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.inc").write_text("run 0\n")
    (tmp_path / "in.deck").write_text(DECK)
    case = deck(verdict="refused", engine_error=error, warnings=warnings, reproduce=f"eos-ref audit {tmp_path}/in.deck")
    assert place(case, tmp_path) == (file, line)
    lines = workflow_commands(outcome(run(case)), tmp_path)
    assert f"file={file},line={line}," in lines[1]


def test_missing_deck_is_annotated_at_its_first_line(tmp_path: Path) -> None:
    assert deck_place(CaseRecord(case="a", verdict="differs"), tmp_path / "gone") == (tmp_path / "gone", 1)
