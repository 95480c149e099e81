"""Markdown, JUnit XML and the form of LAMMPS' dashboard, of a run with a case of every kind; what an audit states."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from check_jsonschema import main as check_jsonschema
from click.testing import CliRunner
from syrupy.assertion import SnapshotAssertion

from lammps_cases.cli import audit, shared
from lammps_cases.findings import KNOWN, LEDGER
from lammps_cases.records.case_parts import LawRecord, StepRecord
from lammps_cases.records.run_record import CaseRecord, RunRecord, read_run
from lammps_cases.report import formats, markdown
from lammps_cases.report.annotations import deck_place, place, workflow_commands
from lammps_cases.report.findings import outcome
from lammps_cases.report.formats import write_report
from lammps_cases.report.statements import SUBJECTS, advice, statements
from lammps_cases.run.report_files import write_run
from tests.conftest import ROOT
from tests.support import made_audits, made_runs
from tests.support.made_audits import BUG, OTHER, acting, deck, everything
from tests.support.made_report import FINDINGS, HOSTILE
from tests.support.outcome import Outcome
from tests.support.pages import unpacked
from tests.support.roundings import rounded

Run = Callable[..., Outcome]
ENTRIES = {entry.id: entry for entry in LEDGER}

# --- Markdown


@pytest.mark.parametrize(
    ("words", "text", "code"),
    [
        ("plain words", "plain words", "`plain words`"),
        ("a|b *c* _d_", r"a\|b \*c\* \_d\_", r"`a\|b *c* _d_`"),
        ("<b>&amp;</b>", "&lt;b&gt;&amp;amp;&lt;/b&gt;", "`<b>&amp;</b>`"),
        ("[x](y) #1 ~z~ \\ `", r"\[x\](y) \#1 \~z\~ \\ \`", "`[x](y) #1 ~z~ \\ '`"),
        ("two\nlines\x1b[31m\ttab", r"two lines \[31m tab", "`two lines [31m tab`"),
        ("", "", ""),
    ],
)
def test_text_is_escaped(words: str, text: str, code: str) -> None:
    assert (markdown.text(words), markdown.code(words)) == (text, code)


def test_summary(run: RunRecord, folder: Path, snapshot: SnapshotAssertion) -> None:
    """All rows of the table of failures have the same columns, whatever LAMMPS printed."""
    text = (folder / "summary.md").read_text(encoding="utf-8")
    assert text == markdown.summary(outcome(run, FINDINGS)) and "<img" not in text and "<script" not in text
    assert text.replace(f"numpy {np.__version__}", "numpy N") == snapshot
    rows = [
        line for line in text.partition("### Not accepted")[2].partition("> **Note")[0].splitlines() if line[:1] == "|"
    ]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {8} and len(rows) == 6


def test_same_bytes_again(run: RunRecord, folder: Path) -> None:
    names = ("report.html", "summary.md", "junit.xml")
    before = [(folder / name).read_bytes() for name in names]
    write_report(run, folder, FINDINGS)
    assert [(folder / name).read_bytes() for name in names] == before
    assert sorted(path.name for path in folder.iterdir()) == sorted([*names, "fields"])


# --- JUnit


def test_junit(run: RunRecord, folder: Path) -> None:
    suite = ET.parse(folder / "junit.xml").getroot()[0]
    outcomes = {c.get("name"): {child.tag for child in c} for c in suite.iter("testcase")}
    assert len(outcomes) == len(run.cases) == int(suite.get("tests", 0))
    told = {"eos.broken": "failure", "refuse.surprise": "error", "crash.segfault": "error", "slow.timeout": "error"}
    told |= {"skip.plugin": "skipped", "refuse.gamma": "system-out", "ledger.artificial": "system-out"}
    assert {name: outcomes[name] for name in told} == {name: {tag} for name, tag in told.items()}
    assert outcomes["eos.types"] == set()
    assert [suite.get(name) for name in ("failures", "errors", "skipped")] == ["1", "3", "1"]
    near = suite.find("testcase[@name='eos.water.near']")
    assert near is not None and near.get("classname") == "eos-ref.eos"
    crash = suite.find("testcase[@name='crash.segfault']/error")
    assert crash is not None and crash.get("message") == HOSTILE.replace("\x1b", "")
    assert suite.find("properties/property[@name='engine.distribution']") is not None


# --- the dashboard: keys, statuses, counts, and where a case begins to differ

TIMED_OUT = re.compile(r"\btimeout \((\d+)s expired\)")  # how the dashboard's own tool recognises timeouts
CASES = (
    made_runs.case("one.a", "exact"),
    made_runs.case("one.b", "pass"),
    made_runs.case("two", "explained", 3.0, finding=BUG),
    made_runs.case("three", "differs", 3.0),
    CaseRecord(case="four", verdict="refused", ended="refused", message="refused: no such style"),
    CaseRecord(case="five", verdict="refused", ended="refused", expects="no such style"),
    CaseRecord(case="six", verdict="crashed", ended="crashed", message="crashed: SIGSEGV"),
    CaseRecord(case="seven", verdict="timeout", ended="timeout", message="did not finish", seconds={"total": 60.2}),
    CaseRecord(case="eight", verdict="error", ended="error", message="no bound"),
    CaseRecord(case="nine", verdict="skipped", ended="skipped", message="needs MPI"),
)


def documented(*cases: CaseRecord) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(formats.dashboard(outcome(made_runs.run(cases=list(cases)))))
    return document


def test_dashboard_has_every_case_by_its_name_in_junit_with_its_status(snapshot: SnapshotAssertion) -> None:
    """The key of LAMMPS' merge_results.py: class, stroke, name. A known bug fails by its name."""
    document = documented(*CASES)
    tests = document["tests"]
    named = ET.fromstring(formats.junit(outcome(made_runs.run(cases=list(CASES))))).iter("testcase")
    assert [f"{found.get('classname')}/{found.get('name')}" for found in named] == list(tests)
    counts = document["metadata"]["counts"]
    assert counts["time"] == rounded(sum(test["time"] for test in tests.values()), 2 * len(CASES))
    assert {status: counts[status] for status in formats.STATUSES if counts[status]} == Counter(
        test["status"] for test in tests.values()
    )
    timed_out = {key: found[1] for key, test in tests.items() if (found := TIMED_OUT.search(test["message"]))}
    assert timed_out == {"eos-ref.seven/seven": "60"}
    assert document == snapshot


def test_first_step_outside_the_bound() -> None:
    """The earliest step of all such fields; the dashboard needs its row and its step."""

    def steps(*verdicts: str) -> list[StepRecord]:
        return [StepRecord(step=10 * k, verdict=v, max_abs=0, max_over_bound=0) for k, v in enumerate(verdicts)]

    late, early = made_runs.case("one", "differs"), made_runs.case("two", "explained", finding=BUG, field="v")
    late.fields[0].steps = steps("pass", "pass", "differs")
    early.fields[0].steps = steps("exact", "explained", "pass")
    found = documented(late.model_copy(update={"fields": [*late.fields, *early.fields]}))["tests"]["eos-ref.one/one"]
    assert (found["diverged"], found["diverged_row"], found["diverged_at"]) == (2, 1, 10)
    assert "v (stage pair): explained" in found["details"]
    without = documented(made_runs.case("one", "differs"))["tests"]["eos-ref.one/one"]
    assert without["diverged"] == 1 and "diverged_row" not in without


@pytest.mark.parametrize(
    ("git", "commit"),
    [
        ("develop / patch_4Jul2026-12-gabc / " + "1f" * 20, "1f" * 20),
        ("(unknown) / (unknown) / (unknown)", None),
        ("", None),
    ],
)
def test_commit_is_that_of_the_build(git: str, commit: str | None) -> None:
    record = made_runs.run()
    record.engine.git = git
    metadata = json.loads(formats.dashboard(outcome(record)))["metadata"]
    assert metadata.get("commit") == metadata.get("sha") == commit
    assert metadata.get("branch") == (git.split()[0] if commit else None)
    assert ("git_info" in metadata["properties"]) == bool(commit)
    assert metadata["generated"] == record.date and record.date.endswith("Z")


def test_command_writes_the_dashboard_and_nothing_else(tmp_path: Path, eos_ref_command: Run) -> None:
    write_run(made_runs.run(cases=list(CASES)), tmp_path / "report")
    written = tmp_path / "data" / "eos-ref" / "run.json"
    done = eos_ref_command("report", tmp_path / "report", "--dashboard", written)
    assert (done.code, done.out.strip()) == (0, str(written))
    assert json.loads(written.read_text()) == documented(*CASES)
    for words in (["--news"], ["--dashboard", written]):
        done = eos_ref_command("report", tmp_path / "report", *words, "--json")
        assert done.code == 0 and json.loads(done.out)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("report", "--dashboard", "file/run.json"), "--dashboard: cannot be written"),
        (("report", "--dashboard", "report/run.json"), "--dashboard: must not be the record of a run"),
        (("report", "--news", "--dashboard", "x.json"), "--dashboard: cannot be combined with --news"),
        *(
            (("report/run.json", *more), "run: must be the folder of a report, not a file in it")
            for more in ((), ("--dashboard", "x.json"), ("--news",))
        ),
    ],
)
def test_bad_input_is_one_line_and_changes_nothing(
    words: tuple[str, ...], said: str, tmp_path: Path, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_run(made_runs.run(), Path("report"))
    Path("file").touch()
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    done = eos_ref_command("report", *words)
    assert done.code == 2 and said in done.err and done.err.count("\n") == 1
    assert "not a file" not in said or "the folder is report" in done.err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_documented_nightly_job_is_a_valid_workflow(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "upstream.md").read_text()
    (block,) = re.findall(r"^```yaml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "nightly.yml").write_text(block)
    arguments = ["--builtin-schema", "vendor.github-workflows", str(tmp_path / "nightly.yml")]
    done = CliRunner().invoke(check_jsonschema, arguments)
    assert done.exit_code == 0, done.output


# --- statements of an audit: the same in every output


def plain(text: str) -> str:
    """Remove what only one output has: control characters, backslashes, entities, links, white space."""
    text = re.sub(r"<(?:a|/a|code|/code|li|/li|b class)[^>]*>", "", text)
    return " ".join(re.sub(r"\\([\\`*_\[\]|~#])", r"\1", unescape(text)).replace("\x1b", "").split())


def test_every_statement_is_in_every_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = everything()
    said = statements(case)
    assert {line.subject for line in said} == {*SUBJECTS} and len(said) == 10
    of_run = made_audits.run(case)
    write_run(of_run, tmp_path)
    headline = outcome(of_run).headline
    own = {"state": headline.state, "sentence": headline.sentence}
    record = read_run(tmp_path)
    assert headline.state == "FAIL" and record.headline is not None and record.headline.model_dump() == own

    for printed in audit.report_lines(case):
        shared.show(printed)
    assert shared.finish(of_run, tmp_path, as_json=False) == 3
    terminal = plain(capsys.readouterr().out)
    shared.finish(of_run, tmp_path, as_json=True)
    document = json.loads(capsys.readouterr().out)
    assert list(document)[:4] == ["state", "sentence", "findings", "statements"] and own.items() <= document.items()
    assert [finding["id"] for finding in document["findings"]] == [BUG, OTHER]
    junit = ET.parse(tmp_path / "junit.xml").find("testsuite/testcase/error")
    assert junit is not None and junit.text is not None and plain(junit.get("message", "")) == plain(headline.sentence)
    pages = {name: unpacked((tmp_path / name).read_text(encoding="utf-8")) for name in ("summary.md", "report.html")}
    outputs = {"terminal": terminal, "junit.xml": plain(junit.text)} | {name: plain(of) for name, of in pages.items()}
    outputs["json"] = plain("\n".join(document["statements"]["in.deck"]))
    for line in said:
        for name, text in outputs.items():
            words = plain(line.text if name == "report.html" or line.subject == "stopped" else str(line))
            assert words in text, (name, line)
    assert not [name for name, text in pages.items() if "<b>x</b>" in text]
    assert "findings of the ledger" not in outputs["summary.md"]


def test_table_of_fields_shows_the_worst_sample() -> None:
    _, first, pressure = audit.field_table(everything())
    assert first.split() == ["q0", "all", "3", "700", "0", "0.5", "10", "1", "pass", "to", "step", "40"]
    assert pressure.endswith("exact (same rounding)")


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
    (line,) = statements(deck(acting=[acting("it acts", "theirs")]))
    assert str(line) == "known bug theirs: it acts", "a finding of another ledger"


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
        ("", [made_audits.HOSTILE], "in.deck", 1),
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
    lines = workflow_commands(outcome(made_audits.run(case)), tmp_path)
    assert f"file={file},line={line}," in lines[1]
    gone = tmp_path / "gone"
    assert deck_place(CaseRecord(case="a", verdict="differs"), gone) == (gone, 1), "a missing deck: its first line"
