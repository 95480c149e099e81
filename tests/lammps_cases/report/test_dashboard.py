"""run.json in the form of LAMMPS' dashboard: keys, statuses, counts, and where a case begins to differ."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from check_jsonschema import main as check_jsonschema
from click.testing import CliRunner

from lammps_cases.records.case_parts import StepRecord
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.report import formats
from lammps_cases.report.findings import outcome
from lammps_cases.run.report_files import write_run
from tests.support.made_runs import case, run
from tests.support.outcome import Outcome
from tests.support.roundings import rounded

Run = Callable[..., Outcome]
# The dashboard's own tool recognises timeouts by this.
TIMED_OUT = re.compile(r"\btimeout \((\d+)s expired\)")


def steps(*verdicts: str) -> list[StepRecord]:
    """Return records of steps 0, 10, 20, ... with these verdicts."""
    return [StepRecord(step=10 * k, verdict=v, max_abs=0, max_over_bound=0) for k, v in enumerate(verdicts)]


def documented(*cases: CaseRecord) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(formats.dashboard(outcome(run(cases=list(cases)))))
    return document


CASES = (
    case("one.a", "exact"),
    case("one.b", "pass"),
    case("two", "explained", 3.0, finding="force-per-volume"),
    case("three", "differs", 3.0),
    CaseRecord(case="four", verdict="refused", ended="refused", message="refused: no such style"),
    CaseRecord(case="five", verdict="refused", ended="refused", expects="no such style"),
    CaseRecord(case="six", verdict="crashed", ended="crashed", message="crashed: SIGSEGV"),
    CaseRecord(case="seven", verdict="timeout", ended="timeout", message="did not finish", seconds={"total": 60.2}),
    CaseRecord(case="eight", verdict="error", ended="error", message="no bound"),
    CaseRecord(case="nine", verdict="skipped", ended="skipped", message="needs MPI"),
)


def test_every_verdict_has_its_status() -> None:
    tests = documented(*CASES)["tests"]
    status = {key.partition("/")[2]: test["status"] for key, test in tests.items()}
    assert status == {
        **{"one.a": "passed", "one.b": "passed", "five": "passed", "two": "failed", "three": "failed"},
        **{"four": "error", "six": "error", "seven": "error", "eight": "error", "nine": "skipped"},
    }
    assert {test["message"] for test in tests.values() if test["status"] == "passed"} == {""}
    assert all(test["message"] for test in tests.values() if test["status"] != "passed")


def test_counts_are_those_of_the_statuses() -> None:
    document = documented(*CASES)
    counts = dict(document["metadata"]["counts"])
    assert counts.pop("tests") == len(CASES)
    assert counts.pop("time") == rounded(sum(test["time"] for test in document["tests"].values()), 2 * len(CASES))
    assert counts == {"passed": 3, "failed": 2, "error": 4, "runtest": 0, "skipped": 1}


def test_tests_are_named_as_in_junit_xml() -> None:
    """The key of LAMMPS' merge_results.py: class, stroke, name."""
    of_run = outcome(run(cases=list(CASES)))
    cases = ET.fromstring(formats.junit(of_run)).iter("testcase")
    names = [f"{found.get('classname')}/{found.get('name')}" for found in cases]
    assert names == list(json.loads(formats.dashboard(of_run))["tests"])


def test_a_known_bug_fails_by_its_name() -> None:
    found = documented(*CASES)["tests"]["eos-ref.two/two"]
    assert found["status"] == "failed" and found["message"].startswith("known: force-per-volume")


def test_timeouts_are_distinguished_from_other_errors() -> None:
    tests = documented(*CASES)["tests"]
    timed_out = {key: found for key, test in tests.items() if (found := TIMED_OUT.search(test["message"]))}
    assert list(timed_out) == ["eos-ref.seven/seven"] and timed_out["eos-ref.seven/seven"][1] == "60"


def test_first_step_outside_the_bound() -> None:
    """The earliest step of all such fields; the dashboard needs its row and its step."""
    late, early = case("one", "differs"), case("two", "explained", finding="force-per-volume", field="v")
    late.fields[0].steps = steps("pass", "pass", "differs")
    early.fields[0].steps = steps("exact", "explained", "pass")
    found = documented(late.model_copy(update={"fields": [*late.fields, *early.fields]}))["tests"]["eos-ref.one/one"]
    assert (found["diverged"], found["diverged_row"], found["diverged_at"]) == (2, 1, 10)
    assert "v (stage pair): explained" in found["details"]
    without = documented(case("one", "differs"))["tests"]["eos-ref.one/one"]
    assert without["diverged"] == 1 and "diverged_row" not in without


@pytest.mark.parametrize(
    ("git", "commit"),
    [
        ("develop / patch_4Jul2026-12-gabc / " + "1f" * 20, "1f" * 20),
        ("(unknown) / (unknown) / (unknown)", None),
        ("", None),
    ],
)
def test_the_commit_is_that_of_the_build(git: str, commit: str | None) -> None:
    record = run()
    record.engine.git = git
    metadata = json.loads(formats.dashboard(outcome(record)))["metadata"]
    assert metadata.get("commit") == metadata.get("sha") == commit
    assert metadata.get("branch") == (git.split()[0] if commit else None)
    assert ("git_info" in metadata["properties"]) == bool(commit)
    assert metadata["generated"] == record.date and record.date.endswith("Z")


def test_the_command_writes_it(tmp_path: Path, eos_ref_command: Run) -> None:
    write_run(run(cases=list(CASES)), tmp_path / "report")
    written = tmp_path / "data" / "eos-ref" / "run.json"
    done = eos_ref_command("report", tmp_path / "report", "--dashboard", written)
    assert (done.code, done.out.strip()) == (0, str(written))
    assert json.loads(written.read_text()) == documented(*CASES)


def test_unwritable_file_is_named(tmp_path: Path, eos_ref_command: Run) -> None:
    write_run(run(), tmp_path / "report")
    (tmp_path / "file").write_text("")
    done = eos_ref_command("report", tmp_path / "report", "--dashboard", tmp_path / "file" / "run.json")
    assert done.code == 2 and "--dashboard: cannot be written" in done.err


@pytest.mark.parametrize("option", ["--news", "--dashboard"])
def test_with_json_nothing_else_is_printed(tmp_path: Path, eos_ref_command: Run, option: str) -> None:
    write_run(run(), tmp_path / "report")
    words = [option, tmp_path / "run.json"] if option == "--dashboard" else [option]
    done = eos_ref_command("report", tmp_path / "report", *words, "--json")
    assert done.code == 0 and json.loads(done.out)


def test_record_of_a_run_is_not_overwritten(tmp_path: Path, eos_ref_command: Run) -> None:
    write_run(run(), tmp_path / "report")
    record = (tmp_path / "report" / "run.json").read_bytes()
    done = eos_ref_command("report", tmp_path / "report", "--dashboard", tmp_path / "report" / "run.json")
    assert done.code == 2 and "--dashboard: must not be the record of a run" in done.err
    assert (tmp_path / "report" / "run.json").read_bytes() == record


@pytest.mark.parametrize("words", [(), ("--dashboard", "x.json"), ("--news",)])
def test_record_in_place_of_its_folder_is_refused(tmp_path: Path, eos_ref_command: Run, words: tuple[str, ...]) -> None:
    write_run(run(), tmp_path / "report")
    done = eos_ref_command("report", tmp_path / "report" / "run.json", *words)
    assert done.code == 2 and "run: must be the folder of a report, not a file in it" in done.err
    assert f"the folder is {tmp_path / 'report'}" in done.err and not Path("x.json").exists()


def test_news_are_not_written_to_a_dashboard(tmp_path: Path, eos_ref_command: Run) -> None:
    done = eos_ref_command("report", tmp_path, "--news", "--dashboard", tmp_path / "run.json")
    assert done.code == 2 and "--dashboard: cannot be combined with --news" in done.err


def test_documented_nightly_job_is_a_valid_workflow(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs" / "upstream.md").read_text()
    (block,) = re.findall(r"^```yaml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "nightly.yml").write_text(block)
    arguments = ["--builtin-schema", "vendor.github-workflows", str(tmp_path / "nightly.yml")]
    outcome = CliRunner().invoke(check_jsonschema, arguments)
    assert outcome.exit_code == 0, outcome.output
