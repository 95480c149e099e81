"""Bug reports: a deck that shows each finding in LAMMPS alone, and the accompanying text."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.syntax.manual import manual_of
from lammps_cases.bugs import deck, issue, report
from lammps_cases.bugs.deck import BugDeck, Check, Ending
from lammps_cases.bugs.report import case_of, demonstrations
from lammps_cases.engine.installations import Engine
from lammps_cases.findings import KNOWN, LEDGER, Finding
from lammps_cases.run import campaign, prepared_case
from lammps_cases.scene import casefile
from tests.support.bug_decks import ENGINES, engine_of, finding_of, manual_for, report_of, said_in, version_of
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
IDS = [entry.id for entry in LEDGER]
BY_NUMBER = [name for name, one in demonstrations().items() if one.number]
OF_TWO = [name for name, one in demonstrations().items() if one.other]
WITH_HAND = [name for name, one in demonstrations().items() if one.hand]
FAR = 1e3  # times the bound: the least error of a finding's number


def _having(entry: Finding) -> str:
    """The first available engine known to have a finding."""
    return next(name for name in ENGINES if entry.listed(version_of(name)))


# --- every finding, on every available engine


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", IDS)
def test_deck_fails_only_on_engines_with_the_finding(name: str, engine: str) -> None:
    manual = manual_of(version_of(engine))
    if not said_in(name, manual):
        assert not finding_of(name).listed(version_of(engine))
        with pytest.raises(InputError, match=r"which does not promise otherwise|which documents what LAMMPS does"):
            report.of_finding(finding_of(name), manual)
        return
    made = report_of(name, manual)
    ending = deck.run(made.deck, engine_of(engine))
    if "package which is not enabled in this LAMMPS binary" in ending.output:
        assert not finding_of(name).listed(version_of(engine)), "seen without the package that it needs"
        return
    expected = "FAIL" if finding_of(name).listed(version_of(engine)) else "PASS"
    assert ending.verdict(made.deck) == expected, ending.output[-2000:]
    if made.number:
        assert ending.code == 0, ending.error  # the number fails, not the deck
        assert ending.printed("obtained") and ending.printed("expected")


@pytest.mark.lammps
@pytest.mark.parametrize("name", [entry.id for entry in LEDGER if entry.outcome == "crashed"])
def test_deck_of_a_crash_ends_without_an_error_of_lammps(name: str) -> None:
    """By the signal of the finding, or with an exception that only LAMMPS' executable catches."""
    ending = deck.run(report_of(name).deck, engine_of(_having(finding_of(name))))
    assert ending.code
    assert "ERROR" not in ending.output
    signal = finding_of(name).engine_error
    if signal == "SIG":  # memory is overwritten, with different effects on different machines
        assert ending.error.startswith("SIG")
    else:
        assert ending.error == {"SIGSEGV": "SIGSEGV", "SIGABRT": "Exception: stol"}[signal]


@pytest.mark.lammps
@pytest.mark.parametrize("name", [name for name in BY_NUMBER if name not in OF_TWO])
def test_number_is_wrong_by_this_finding_alone_and_by_far(name: str, tmp_path: Path) -> None:
    """On an engine that has it, its variant alone explains the scene, and the reference is far outside the bound."""
    entry, shown = finding_of(name), demonstrations()[name]
    if not any(entry.listed(version_of(engine)) for engine in ENGINES):
        assert entry.engines == KNOWN[-1:]  # the newest LAMMPS is not a wheel: `make engines` runs this test on it
        return
    case = case_of(name, entry.title, shown.scene)
    (record,) = campaign.run_cases([case], engine_of(_having(entry)), 1, tmp_path / "run").cases
    assert record.verdict == "explained"
    assert {each for field in record.fields for each in field.explained_by} == {name}
    made = report_of(name)
    assert made.number is not None
    expected = report.predicted(case, made.number)
    ending = deck.run(made.deck, engine_of(_having(entry)))
    missed = abs(float(ending.printed("obtained")) - expected.value)
    assert not missed <= FAR * expected.bound  # NaN is far from everything
    assert not missed <= 1e-3 * abs(expected.value)


@pytest.mark.lammps
def test_deck_of_walls_after_rebuild_passes_without_rebuild() -> None:
    """The same scene is correct if lists are not rebuilt: the deck depends on nothing else."""
    shown = demonstrations()["walls-after-rebuild"]
    assert shown.number is not None
    scene = casefile.merge(shown.scene, {"engine": {"every": 100, "delay": 100}})
    made, _ = report._of_number(case_of("kept", "x", scene), shown.number)
    assert deck.run(made, engine_of("env")).verdict(made) == "PASS"


@pytest.mark.lammps
@pytest.mark.parametrize("moved", [0.0, 3.0, -3.0])
def test_deck_detects_three_bounds(moved: float) -> None:
    """A value outside the bound fails; the number itself passes."""
    made = report_of(next(name for name in WITH_HAND if not finding_of(name).listed(version_of("env")))).deck
    (at,) = (k for k, line in enumerate(made.lines) if line.startswith("variable inside"))
    found = re.fullmatch(r"variable inside equal abs\((\S+)-\((\S+)\)\)<=(\S+)", made.lines[at])
    assert found
    bound = float(found[3])
    check = Check(found[1], f"{found[2]}+({moved * bound!r})", bound)
    changed = replace(made, lines=(*made.lines[:at], check.inside, *made.lines[at + 1 :]))
    assert deck.run(changed, engine_of("env")).verdict(changed) == ("FAIL" if moved else "PASS")


# --- the decks


def test_demonstrations_belong_to_findings() -> None:
    assert set(demonstrations()) <= set(IDS)
    of_model = [entry for entry in LEDGER if entry.model_variant]
    assert all(entry.id in BY_NUMBER or report._probe(entry) for entry in of_model)


@pytest.mark.parametrize("name", IDS)
def test_decks_are_short_and_self_contained(name: str) -> None:
    made = report_of(name).deck
    assert all("/" not in word or not Path(word).is_absolute() for line in made.lines for word in line.split())
    limit = 60 if name in OF_TWO or "clear" in made.lines else 45  # two scenes, or one set up twice
    assert len(made.lines) < limit


@pytest.mark.parametrize("name", [name for name in BY_NUMBER if name not in OF_TWO])
def test_particles_from_a_file_equal_those_from_commands(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both hold the same numbers, to the last digit."""
    job = prepared_case.prepare(case_of(name, "x", demonstrations()[name].scene)).jobs[0]
    monkeypatch.setattr(deck, "MOST_SINGLE", 0)
    made = report.of_finding(finding_of(name), manual_for(name)).deck
    assert f"read_data {deck.DATA}" in made.lines
    rows = made.data.split("Atoms #")[1].split("\n\n")[1].splitlines()
    x_nc = np.array([[float(word) for word in row.split()[-3:]] for row in rows])
    assert x_nc.tobytes() == job.x_nc.tobytes()
    assert [float(row.split()[3]) for row in rows] == list(job.per_atom.get("rho", np.zeros(len(rows))))


@pytest.mark.lammps
@pytest.mark.parametrize("name", ["force-per-volume", "wall-velocity-lost", "heat-over-density"])
def test_deck_with_a_file_gives_the_same_number(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = deck.run(report_of(name).deck, engine_of("env")).printed("obtained")
    monkeypatch.setattr(deck, "MOST_SINGLE", 0)
    made = report.of_finding(finding_of(name)).deck
    assert made.data
    assert plain == deck.run(made, engine_of("env")).printed("obtained") != ""


@pytest.mark.parametrize(
    ("compare", "field", "axes", "word"),
    [
        (["pressure"], "pressure", (), "C_q[2]"),
        (["pressure", "rho"], "rho", (), "C_q[2][2]"),
        (["coordination", "grad/v", "rho"], "grad/v", (1, 0), "C_q[2][4]"),
        (["coordination", "grad/v", "rho"], "rho", (), "C_q[2][6]"),
        (["f"], "f", (1,), "fy[2]"),
        (["drho"], "drho", (), ""),
    ],
)
def test_word_of_a_number(
    case_file: Callable[..., Path], compare: list[str], field: str, axes: tuple[int, ...], word: str
) -> None:
    told = prepared_case.prepare(casefile.load((case_file(compare=compare),))[0]).jobs[0]
    assert deck.word(told, field, 2, axes) == word


@pytest.mark.parametrize("name", WITH_HAND)
def test_deck_calculates_the_predicted_number(name: str) -> None:
    """Its variables, substituted as LAMMPS does, give the number; no line states the number itself."""
    made = report_of(name)
    assert made.number is not None and made.lines
    expected = report.predicted(case_of(name, "x", demonstrations()[name].scene), made.number)
    texts = dict(re.findall(r"^variable (\w+) (?:string|equal) (.*)$", made.deck.text, re.M))
    formula = texts["expected"]
    while "$" in formula:
        formula = re.sub(r"\$\{(\w+)\}", lambda found: texts[found[1]], formula)
    assert eval(formula.replace("^", "**")) == pytest.approx(expected.value, rel=0, abs=2 * expected.bound)
    assert repr(expected.value) not in made.deck.text or expected.value in (1.0, 2.0)
    text = issue.text(made, Ending(0, ""))
    assert all(f"{line.name} = {line.formula} = " in text for line in made.lines)


def test_wrong_manual_calculation_is_refused() -> None:
    shown = demonstrations()["force-per-volume"]
    assert shown.number is not None
    wrong = shown.hand | {"f": "-V1*V2*(P1-P2)*gx2"}
    with pytest.raises(InputError, match="calculation by hand: must give"):
        report._of_number(case_of("x", "x", shown.scene), shown.number, formulas=wrong)


# --- verdicts


@pytest.mark.parametrize(
    ("refused", "code", "output", "verdict"),
    [
        ("", 0, "PASS\n", "PASS"),
        ("", 0, "FAIL\n", "FAIL"),
        ("", 0, "obtained PASS\n", "FAIL"),
        ("", 1, "PASS\n", "FAIL"),
        ("", -11, "", "FAIL"),
        ("Illegal", 1, "ERROR: Illegal word (src/x.cpp:3)\n", "PASS"),
        ("Illegal", 1, "ERROR: another (src/x.cpp:3)\n", "FAIL"),
        ("Illegal", 1, 'expected "Illegal"\nERROR: another\n', "FAIL"),
        ("Illegal", -6, "ERROR: Illegal word\n", "FAIL"),
        ("Illegal", 0, "FAIL\n", "FAIL"),
    ],
)
def test_verdict_of_an_ending(refused: str, code: int, output: str, verdict: str) -> None:
    assert Ending(code, output).verdict(BugDeck((), refused=refused)) == verdict


# --- the text


@pytest.mark.parametrize("name", IDS)
def test_text_contains_the_ledger_entry(name: str) -> None:
    entry = finding_of(name)
    text = issue.text(
        report_of(name), Ending(0, "LAMMPS (22 Jul 2025)\nobtained 1.5\nexpected 2.5 within 1e-9\nFAIL\n")
    )
    headings = ["Summary", "LAMMPS Version and Platform", "Expected Behavior", "Actual Behavior"]
    headings += ["Steps to Reproduce", "Workaround", "Further Information, Files, and Links"]
    assert re.findall(r"^\*\*(.+)\*\*$", text, re.M) == headings
    for known in (entry.title, entry.documented, entry.observed, entry.argument, entry.workaround, entry.remedy):
        assert known in text
    assert report_of(name).deck.text in text
    assert entry.engines[0] in text
    if report_of(name).number:
        assert "1.5." in text and "2.5" in text


@pytest.mark.parametrize(
    ("engines", "sentence"),
    [
        (("2.0", "3.0"), "First bad version 2.0, the last good one 1.0; good again from 4.0 on."),
        (("1.0", "2.0"), "First bad version 1.0, no good one before it was tried; good again from 3.0 on."),
        (("3.0", "4.0"), "First bad version 3.0, the last good one 2.0; still bad in the newest one tried."),
        ((), "Good in every version tried."),
    ],
)
def test_versions_are_summarised_by_their_changes(engines: tuple[str, ...], sentence: str) -> None:
    entry = replace(finding_of("force-per-volume"), engines=engines)
    assert issue.turns(entry, ("1.0", "2.0", "3.0", "4.0")) == sentence


@pytest.mark.parametrize("entry", LEDGER, ids=IDS)
def test_upstream_status_is_one_of_three(entry: Finding) -> None:
    assert re.fullmatch(r"unreported|https://\S+/(issues|pull)/\d+|fixed in \S+", entry.upstream)


# --- the command


@pytest.mark.lammps
def test_report_of_a_finding(eos_ref_command: Run, tmp_path: Path) -> None:
    code, out, err = eos_ref_command("report-bug", "wall-velocity-lost", "--out", tmp_path / "bug")
    assert code == 0, err
    verdict = "FAIL" if finding_of("wall-velocity-lost").listed(version_of("env")) else "PASS"
    assert out.startswith(verdict)
    assert sorted(path.name for path in (tmp_path / "bug").iterdir()) == [deck.DECK, "issue.md", "test"]
    text = (tmp_path / "bug" / "issue.md").read_text()
    assert "grad W" in text
    (test,) = (tmp_path / "bug" / "test").glob("*.yaml")
    assert f"`{test.name}`" in text and f"written: {test}" in out


@pytest.mark.lammps
def test_report_of_a_red_case(eos_ref_command: Run, tmp_path: Path) -> None:
    """The first atom outside and its component, for a case explained by a finding."""
    code, out, err = eos_ref_command("report-bug", "walls-moving.driven.quintic", "--out", tmp_path / "bug")
    assert code == 0, err
    assert out.startswith("FAIL") and finding_of("wall-velocity-lost").title in out
    assert (tmp_path / "bug" / deck.DATA).exists()


@pytest.mark.lammps
def test_report_of_a_refused_case() -> None:
    made = report.make("undocumented.exclude-list", engine_of("env"))
    assert made.finding is not None and made.finding.id == "exclude-takes-one-range"
    assert deck.run(made.deck, engine_of("env")).verdict(made.deck) == "FAIL"


def test_unknown_names_are_refused(eos_ref_command: Run, tmp_path: Path) -> None:
    code, _, err = eos_ref_command("report-bug", "force-per-volum", "--out", tmp_path / "bug")
    assert (code, err.count("\n")) == (2, 1)
    assert "force-per-volume" in err
    assert not (tmp_path / "bug").exists()


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("near-rho0.linear.2d", "nothing to report"),
        (
            "near-rho0",
            r"single case, but this name selects 12 \(near-rho0\..*, near-rho0\..*, 10 more\), found 'near-rho0'",
        ),
        (next(case.name for case in casefile.load() if case.scene.twin), "must not be a twin"),
    ],
)
def test_case_without_a_deck_is_refused(name: str, complaint: str) -> None:
    """A green one, several, and a twin."""
    with pytest.raises(InputError, match=complaint):
        report.make(name, Engine())


def test_ledger_of_one_finding_names_its_report(eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command("ledger", "force-per-volume")
    assert code == 0, err
    assert "upstream: unreported; eos-ref report-bug force-per-volume" in out
    assert "wall-velocity-lost" not in out
    code, _, err = eos_ref_command("ledger", "nonsense")
    assert (code, err.count("\n")) == (2, 1)
