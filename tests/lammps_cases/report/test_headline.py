"""The state, its words and the order of the rest are the same in every output; the effect of --fail-on on LAMMPS."""

from __future__ import annotations

import json
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import pytest
from syrupy.assertion import SnapshotAssertion

from lammps_cases.cli import shared
from lammps_cases.findings import KNOWN
from lammps_cases.records.headline import LOOKS, State
from lammps_cases.records.run_record import CaseRecord, read_run
from lammps_cases.run.report_files import write_run
from tests.support import made_runs
from tests.support.outcome import Outcome
from tests.support.pages import text_of, unpacked

Command = Callable[..., Outcome]
DECKS = Path(__file__).parents[2] / "decks"
SEVERE, LIGHT, CLEAN = "walls.stored.damped", "refused.range-two-stars", "near-rho0.linear.2d"
CASES = {
    CLEAN: made_runs.case(CLEAN, "exact", 0.0),
    SEVERE: made_runs.case(SEVERE, "explained", 1e9, finding="force-per-volume"),
    LIGHT: CaseRecord(case=LIGHT, verdict="explained", ended="crashed", explained_by=["double-star-abort"]),
    "mine": made_runs.case("mine", "differs", 3.0).model_copy(update={"reproduce": "eos-ref run mine"}),
}
ONE = "1 known bug seen in this LAMMPS"
TWO = "2 known bugs seen in this LAMMPS, 1 severe"


@pytest.mark.parametrize(
    ("names", "state", "sentence", "then"),
    [
        ([CLEAN], "PASS", "no difference", "eos-ref claims"),
        ([SEVERE], "KNOWN BUGS", f"{ONE} (severe); nothing new", "eos-ref report-bug force-per-volume"),
        ([LIGHT], "KNOWN BUGS", f"{ONE} (not severe); nothing new", "eos-ref report-bug double-star-abort"),
        ([*CASES], "FAIL", f"1 case not as expected: 1 differs; {TWO}", "eos-ref run mine"),
    ],
)
def test_every_output_has_the_same_headline(
    names: list[str],
    state: State,
    sentence: str,
    then: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: SnapshotAssertion,
) -> None:
    """Known bugs precede differences, and these the cases."""
    out, job, look = tmp_path / "report", tmp_path / "job.md", LOOKS[state]
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(job))
    record = made_runs.run(KNOWN[-1], cases=[CASES[name] for name in names])
    write_run(record, out)
    capsys.readouterr()
    assert shared.finish(record, out, as_json=False) == (state == "FAIL")
    terminal = capsys.readouterr().out
    (annotation,) = re.findall(r"^::\w+ title=eos-ref%3A .*$", terminal, re.MULTILINE)
    html, summary = (unpacked((out / name).read_text(encoding="utf-8")) for name in ("report.html", "summary.md"))
    assert f"\n{state}: {sentence}\n" in terminal and f"\nnext: {then}" in terminal
    assert f'<header class="{look.css}">' in html
    assert f'<span class="stamp">{state}</span> {sentence}</h1>' in html
    assert f": {state}: {sentence}</title>" in html
    for text in (summary, job.read_text(encoding="utf-8")):
        assert text.startswith(f"## eos-ref: {look.mark} {state}\n\n{sentence}.\n\nLAMMPS 20")
    said = ET.parse(out / "junit.xml").find("testsuite/properties/property[@name='headline']")
    assert said is not None and said.get("value") == f"{state}: {sentence}"
    assert annotation.startswith(f"::{look.level} title=eos-ref%3A {state}::{sentence}%0ALAMMPS 20")
    if state == "FAIL":
        shown = text_of(html).partition("\nAll findings\n")[0]
        assert (terminal.replace(str(tmp_path), "TMP"), shown) == snapshot


@pytest.mark.lammps
def test_known_finding_of_the_level_fails(eos_ref_command: Command, tmp_path: Path) -> None:
    """A run keeps its --fail-on; a level rejects severe findings, light ones, or none."""
    out = tmp_path / "report"
    for options, failing in (
        (("--fail-on", "high"), {SEVERE}),
        (("--fail-on", "medium"), {SEVERE}),
        (("--fail-on", "low"), {SEVERE, LIGHT}),
        (("--fail-on", "new"), set[str]()),
        (("--strict",), {SEVERE, LIGHT}),
    ):
        done = eos_ref_command("run", SEVERE, LIGHT, CLEAN, *options, "--out", out)
        assert done.code == bool(failing) == ("\nFAIL: " in done.out), options
        cases = ET.parse(out / "junit.xml").findall("testsuite/testcase")
        assert {case.get("name") for case in cases if case.find("failure") is not None} == failing
        assert eos_ref_command("report", out).code == done.code


@pytest.mark.lammps
def test_change_against_the_baseline_fails_in_every_output(eos_ref_command: Command, tmp_path: Path) -> None:
    out, baselines = tmp_path / "report", tmp_path / "accepted"
    eos_ref_command("run", CLEAN, "--out", out)
    assert eos_ref_command("accept", out, "--reason", "first", "--baselines", baselines).code == 0
    assert eos_ref_command("run", CLEAN, "--baseline", baselines, "--out", out).code == 0
    (verdicts,) = baselines.glob("*/verdicts.tsv")
    edited = verdicts.read_text(encoding="utf-8").replace("exact", "differs")
    verdicts.write_text(edited, encoding="utf-8")
    done = eos_ref_command("run", CLEAN, "--baseline", baselines, "--out", out)
    count = read_run(out).changed
    sentence = f"FAIL: {count} change{'s' * (count != 1)} against the baseline"
    assert done.code == 1 and count > 0 and f"\n{sentence}\n" in done.out
    assert f"<title>eos-ref {CLEAN}: {sentence}</title>" in (out / "report.html").read_text(encoding="utf-8")
    assert (out / "summary.md").read_text(encoding="utf-8").startswith("## eos-ref: 🔴 FAIL")


@pytest.mark.lammps
def test_audit(eos_ref_command: Command, tmp_path: Path) -> None:
    shutil.copy(DECKS / "fluid.inc", tmp_path)
    fixes = "fix 1 all rheo 3.0 quintic 0\nfix 2 all rheo/viscosity * constant 0.1\nfix 3 all rheo/pressure * linear\n"
    (tmp_path / "in.one").write_text(f"variable style string rheo\ninclude fluid.inc\n{fixes}run 2\n")
    audit = ("audit", tmp_path / "in.one", "--every", "1", "--out", tmp_path / "report")
    done = eos_ref_command(*audit, "--fields", "f", "--fail-on", "1%")
    sentence = r"\nFAIL: 1 known bug: forces are .* \(force-per-volume\); .*rejected by --fail-on 1%"
    assert done.code == 1 and re.search(sentence, done.out)
    assert "\nKNOWN BUGS: " in eos_ref_command(*audit, "--fields", "f", "--fail-on", "999999%").out
    assert "\nPASS: no difference in 1 field" in eos_ref_command(*audit, "--fields", "pressure", "--strict").out
    document = json.loads(eos_ref_command(*audit, "--fields", "pressure", "--json").out)
    assert list(document)[:3] == ["state", "sentence", "findings"] and document["state"] == "PASS"
    assert document["headline"] == {"state": "PASS", "sentence": document["sentence"]}
