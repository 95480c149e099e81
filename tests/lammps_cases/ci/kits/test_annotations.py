"""Annotations of a run that CI services show next to the code."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.records.case_parts import Verdict
from lammps_cases.records.levels import FailOn
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report.annotations import (
    CODE_QUALITY,
    MOST,
    announce,
    case_lines,
    code_quality,
    command,
    fitted,
    place,
    workflow_commands,
)
from lammps_cases.report.findings import Outcome, outcome
from lammps_cases.scene import casefile

ROOT = Path(__file__).parents[4]
FILE = """# a comment
name: mine
about: x
matrix:
  law:
    one: {}
    two: {}
    three: {}
  dimension:
    2d: {}
    3d: {}
scene: {}
"""


def a_case(
    name: str, verdict: Verdict = "differs", message: str = "f leaves its bound", source: str = ""
) -> CaseRecord:
    own = f"eos-ref run --cases {source} {name}" if source else f"eos-ref run {name}"
    found = CaseRecord(case=name, verdict=verdict, message=message, source=source or "near-rho0.yaml", reproduce=own)
    return found.model_copy(update={"explained_by": ["wall-velocity-lost"] if verdict == "explained" else []})


def a_run(*cases: CaseRecord, fail_on: FailOn = "new", notes: tuple[str, ...] = ()) -> Outcome:
    run = RunRecord(engine=EngineRecord(), reference={}, cases=list(cases), fail_on=fail_on, notes=list(notes))
    return outcome(run.counted())


def read_back(line: str) -> tuple[str, dict[str, str], str]:
    """A workflow command as parsed by GitHub's runner."""
    found = re.fullmatch("::([a-z]+) (.*?)::(.*)", line)
    assert found, line

    def plain(text: str) -> str:
        for code, character in (("%0D", "\r"), ("%0A", "\n"), ("%3A", ":"), ("%2C", ","), ("%25", "%")):
            text = text.replace(code, character)
        return text

    properties = dict(part.split("=", 1) for part in found[2].split(","))
    return found[1], {name: plain(value) for name, value in properties.items()}, plain(found[3])


def test_line_of_every_shipped_case() -> None:
    """The line of its label, or of its name without a matrix."""
    for path in sorted(casefile.SHIPPED.glob("*.yaml")):
        lines, text = case_lines(path), path.read_text().splitlines()
        for case in casefile.load_file(path, shipped=True):
            named = text[lines[case.name] - 1].strip().split(":")[0].strip("\"'")
            assert named == "name" or named in case.name.split(".")


def test_line_of_a_case_is_that_of_its_most_specific_label(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(FILE)
    lines = case_lines(tmp_path / "mine.yaml")
    assert (lines["mine.one.2d"], lines["mine.one.3d"], lines["mine.three.2d"]) == (6, 6, 8)
    assert len(lines) == 6
    (tmp_path / "mine.yaml").write_text("name: mine\nscene: {}\n")
    assert case_lines(tmp_path / "mine.yaml") == {"mine": 1}


@pytest.mark.parametrize("text", ["", "a: [", "- 1\n", "name: x\nmatrix: 3\n", "\x00", "name: x\nmatrix: {a: 1}"])
def test_line_in_an_invalid_file(text: str, tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    assert set(case_lines(tmp_path / "bad.yaml")) <= {"x"}
    assert case_lines(tmp_path / "none.yaml") == {}


def test_place_is_relative_to_the_repository(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(FILE)
    assert place(a_case("mine.two.2d", source=str(tmp_path / "mine.yaml")), tmp_path) == ("mine.yaml", 7)
    shipped = a_case("near-rho0.linear.2d")
    at = place(shipped, ROOT)
    assert at is not None and at[0] == "lammps_cases/data/cases/near-rho0.yaml" and at[1] > 1
    assert place(shipped, tmp_path) is None, "an installed eos-ref lies outside the repository"
    deck = CaseRecord(case="in.deck", verdict="differs", reproduce=f"eos-ref audit '{tmp_path}/a b/in.deck' --every 1")
    assert place(deck, tmp_path) == ("a b/in.deck", 1)
    assert place(CaseRecord(case="x", verdict="differs"), tmp_path) is None


@pytest.mark.parametrize("nasty", ["100%", "a:b,c=d", "%0A", "two\nlines\r", "::error::owned", "ends with %3"])
def test_command_survives_a_round_trip(nasty: str) -> None:
    line = command("error", nasty, {"file": nasty, "line": "3", "title": nasty})
    assert "\n" not in line and "\r" not in line
    assert read_back(line) == ("error", {"file": nasty, "line": "3", "title": nasty}, nasty)


def test_commands_of_a_run() -> None:
    cases = (
        a_case("near-rho0.linear.2d"),
        a_case("near-rho0.linear.3d", "crashed", "SIGSEGV"),
        a_case("good", "exact"),
        a_case("known", "explained"),
    )
    notes = ("this engine no longer shows x",)
    found = [read_back(line) for line in workflow_commands(a_run(*cases, notes=notes), ROOT)]
    assert [(level, given["title"]) for level, given, _ in found] == [
        ("error", "eos-ref: FAIL"),
        ("error", "crashed: near-rho0.linear.3d"),
        ("error", "differs: near-rho0.linear.2d"),
        ("notice", "eos-ref"),
    ]
    assert found[0][2].startswith("2 cases not as expected: 1 differs, 1 crashed; 1 known bug seen in this LAMMPS")
    assert found[1][1]["file"] == "lammps_cases/data/cases/near-rho0.yaml"
    assert found[1][2] == "SIGSEGV\neos-ref run near-rho0.linear.3d"
    strict = workflow_commands(a_run(*cases, fail_on="high"), ROOT)
    assert "explained: known" in [read_back(line)[1]["title"] for line in strict]


@pytest.mark.parametrize(
    ("verdict", "level", "state"), [("exact", "notice", "PASS"), ("explained", "warning", "KNOWN BUGS")]
)
def test_commands_of_a_passing_run(verdict: Verdict, level: str, state: str) -> None:
    (line,) = workflow_commands(a_run(a_case("one", verdict)), ROOT)
    assert read_back(line)[:2] == (level, {"title": f"eos-ref: {state}"})


def test_commands_are_limited_to_those_shown() -> None:
    at_most = workflow_commands(a_run(*(a_case(f"c{n}") for n in range(MOST - 1))), ROOT)
    assert len(at_most) == MOST and "more" not in at_most[-1]
    more = workflow_commands(a_run(*(a_case(f"c{n}") for n in range(MOST + 7)), notes=("n",) * 30), ROOT)
    assert len(more) == 2 * MOST - 1
    assert read_back(more[MOST - 1])[2] == "9 more cases are not as expected: see the job summary"


def test_code_quality() -> None:
    def issues(*cases: CaseRecord) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = json.loads(code_quality(a_run(*cases), ROOT))
        return found

    good, red = a_case("good", "exact"), [a_case("near-rho0.linear.2d", message=f"LAMMPS {n}.0") for n in (1, 2)]
    one, other = issues(red[0], a_case("x", "timeout", ""), good)
    assert (one["check_name"], one["severity"], one["description"]) == ("eos-ref/timeout", "critical", "x: timeout")
    assert (other["severity"], other["description"]) == ("major", "near-rho0.linear.2d: LAMMPS 1.0")
    assert other["location"]["path"] == "lammps_cases/data/cases/near-rho0.yaml"
    assert other["location"]["lines"]["begin"] > 1 and one["fingerprint"] != other["fingerprint"]
    assert issues(red[1])[0]["fingerprint"] == other["fingerprint"], "the same fault, other numbers"
    assert issues(good) == []


def test_summary_stays_below_the_limit_of_github() -> None:
    text = "é line\n" * 100
    assert fitted(text, 0) == text
    cut = fitted(text, 1000, limit=1400)
    assert len(cut.encode()) <= 400 and cut.startswith("é line\n") and "cut here" in cut
    assert all(line in text for line in cut.splitlines()[:-1])
    assert fitted(text, 1390, limit=1400) == ""


def test_annotations_are_enabled_by_the_environment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = a_run(a_case("near-rho0.linear.2d"))
    announce(run, tmp_path, {})
    assert capsys.readouterr().out == "" and list(tmp_path.iterdir()) == []
    summary = tmp_path / "summary"
    summary.write_text("of another step\n")
    environ = {"GITHUB_ACTIONS": "true", "GITHUB_WORKSPACE": str(ROOT), "GITHUB_STEP_SUMMARY": str(summary)}
    announce(run, tmp_path, environ)
    assert "\n::error file=lammps_cases/data/cases/near-rho0.yaml,line=" in capsys.readouterr().out
    assert summary.read_text().startswith("of another step\n## eos-ref: 🔴 FAIL\n")
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "summary.md").write_text("as written\n")
    announce(run, tmp_path / "report", environ)
    assert summary.read_text().endswith("as written\n")
    announce(run, tmp_path, {"GITLAB_CI": "true", "CI_PROJECT_DIR": str(tmp_path)})
    assert json.loads((tmp_path / CODE_QUALITY).read_text())[0]["check_name"] == "eos-ref/differs"
