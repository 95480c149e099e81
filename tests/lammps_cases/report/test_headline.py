"""On real LAMMPS: the state, its words and the order of the rest, in every output; the effect of --fail-on."""

from __future__ import annotations

import json
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.findings import LEDGER
from lammps_cases.records.headline import LOOKS, State
from lammps_cases.records.run_record import EngineRecord, RunRecord, read_run
from lammps_cases.report import findings
from lammps_cases.scene.casefile import SHIPPED
from tests.support.outcome import Outcome
from tests.support.pages import unpacked

pytestmark = pytest.mark.lammps

Command = Callable[..., Outcome]
Write = Callable[..., Path]
DECKS = Path(__file__).parents[2] / "decks"
SEVERE, LIGHT, CLEAN = "walls.stored.damped", "refused.range-two-stars", "near-rho0.linear.2d"
TITLE = "Pair forces lack the volume of the particle they act on"
KNOWN = "1 known bug seen in this LAMMPS"


def texts(folder: Path, terminal: str, job: Path) -> dict[str, str]:
    """Every output of a run."""
    (annotation,) = re.findall(r"^::\w+ title=eos-ref%3A .*$", terminal, re.MULTILINE)
    written = {name: unpacked((folder / name).read_text(encoding="utf-8")) for name in ("report.html", "summary.md")}
    said = ET.parse(folder / "junit.xml").find("testsuite/properties/property[@name='headline']")
    assert said is not None
    return written | {
        "terminal": terminal,
        "job": job.read_text(encoding="utf-8"),
        "junit": said.get("value", ""),
        "annotation": annotation,
    }


@pytest.mark.parametrize(
    ("scene", "code", "state", "sentence", "then"),
    [
        (CLEAN, 0, "PASS", "no difference", "eos-ref claims"),
        (SEVERE, 0, "KNOWN BUGS", f"{KNOWN} (severe); nothing new", "eos-ref report-bug force-per-volume"),
        (LIGHT, 0, "KNOWN BUGS", f"{KNOWN} (not severe); nothing new", "eos-ref report-bug double-star-abort"),
        ("mine", 1, "FAIL", "1 case not as expected: 1 differs", "eos-ref run --cases"),
    ],
)
def test_every_output_has_the_same_headline(
    scene: str,
    code: int,
    state: State,
    sentence: str,
    then: str,
    case_file: Write,
    eos_ref_command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, job = tmp_path / "report", tmp_path / "job.md"
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(job))
    named = ["--cases", case_file(expect={"refused": "any error"})] if scene == "mine" else [scene]
    done = eos_ref_command("run", *named, "--out", out)
    assert done.code == code
    said, look = texts(out, done.out, job), LOOKS[state]
    assert f"\n{state}: {sentence}\n" in said["terminal"] and f"\nnext: {then}" in said["terminal"]
    assert f'<header class="{look.css}">' in said["report.html"]
    assert f'<span class="stamp">{state}</span> {sentence}</h1>' in said["report.html"]
    assert f": {state}: {sentence}</title>" in said["report.html"]
    for text in (said["summary.md"], said["job"]):
        assert text.startswith(f"## eos-ref: {look.mark} {state}\n\n{sentence}.\n\nLAMMPS 20")
    assert said["junit"] == f"{state}: {sentence}"
    assert said["annotation"].startswith(f"::{look.level} title=eos-ref%3A {state}::{sentence}%0ALAMMPS 20")


def test_findings_precede_differences_and_these_the_cases(
    case_file: Write, eos_ref_command: Command, tmp_path: Path
) -> None:
    files = (case_file(expect={"refused": "any error"}), SHIPPED / "walls.yaml", SHIPPED / "refused.yaml")
    given = [word for file in files for word in ("--cases", file)]
    done = eos_ref_command("run", *given, "mine", SEVERE, LIGHT, "--out", tmp_path / "report")
    assert done.code == 1
    end = done.out[
        done.out.index("FAIL: 1 case not as expected: 1 differs; 2 known bugs seen in this LAMMPS, 1 severe") :
    ]
    assert end.splitlines()[1:3] == [f"  high  {TITLE} (force-per-volume): 1 case", "  and 1 low"]
    html = unpacked((tmp_path / "report" / "report.html").read_text(encoding="utf-8"))
    places = [html.index(text) for text in ("</h1>", "compiled by", 'id="known"', 'id="differs"', 'id="cases"')]
    assert places == sorted(places)
    known = html[places[2] : places[3]]
    rows = [row for row in known.split("<tr>")[2:] if "<td>" in row]
    assert [re.findall(r"severity (\w+)", row)[0] for row in rows] == ["high", "low"]
    severe = next(entry for entry in LEDGER if entry.id == "force-per-volume")
    for text in (
        TITLE,
        severe.effect,
        severe.since,
        "eos-ref report-bug force-per-volume",
        "#finding=force-per-volume",
    ):
        assert text in rows[0], text
    assert "#case=mine" in html[places[3] : places[4]]
    summary = (tmp_path / "report" / "summary.md").read_text(encoding="utf-8")
    blocks = [summary.index(text) for text in ("🔴 FAIL", "compiled by", "### Known bugs", "### Not accepted")]
    assert blocks == sorted(blocks)


@pytest.mark.parametrize(("case", "codes"), [(SEVERE, (1, 1, 1, 0, 1)), (LIGHT, (0, 0, 1, 0, 1)), (CLEAN, (0,) * 5)])
def test_known_finding_of_the_level_fails(
    case: str, codes: tuple[int, ...], eos_ref_command: Command, tmp_path: Path
) -> None:
    options = [*(("--fail-on", level) for level in ("high", "medium", "low", "new")), ("--strict",)]
    for option, code in zip(options, codes, strict=True):
        done = eos_ref_command("run", case, *option, "--out", tmp_path / "report")
        assert (done.code, "\nFAIL: " in done.out) == (code, code == 1), option
        failed = ET.parse(tmp_path / "report" / "junit.xml").findall("testsuite/testcase/failure")
        assert len(failed) == code
        assert eos_ref_command("report", tmp_path / "report").code == code, "the run keeps its --fail-on"


def test_a_change_against_the_baseline_fails_in_every_output(eos_ref_command: Command, tmp_path: Path) -> None:
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


def test_an_audit(eos_ref_command: Command, tmp_path: Path) -> None:
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


def test_unknown_findings_are_severe_and_never_a_pass() -> None:
    run = RunRecord(engine=EngineRecord(), reference={}, fail_on="high")
    assert findings.outcome(run).headline.state == "EMPTY"
    known = json.loads(run.to_json()) | {
        "cases": [{"case": "a", "verdict": "explained", "explained_by": ["forgotten"]}]
    }
    found = findings.outcome(RunRecord.model_validate(known))
    assert (found.headline.state, found.exit_code, found.known) == ("FAIL", 1, {"forgotten": "high"})


def test_effects_of_findings_are_one_line() -> None:
    for entry in LEDGER:
        assert 10 < len(entry.effect) <= 100 and not entry.effect.endswith("."), entry.id
        assert entry.effect != entry.title and entry.since, entry.id
