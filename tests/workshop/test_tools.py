"""Tools of the makers: mutants of the judge, very many particles, faults in machine code, the table of examples."""

from __future__ import annotations

import importlib
import json
import math
import pkgutil
from pathlib import Path

import pytest

from lammps_cases.audit import budgets
from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.scene.casefile import load
from tests.workshop import examples_table, judge, large, machine_code
from tests.workshop.machine_code import TRAP, Library, Site

# --- mutants of the judge, from the output of mutmut

PREDICTS = "lammps_cases.findings.entry.xǁFindingǁpredicts__mutmut_2"
RESULTS = f"""
    lammps_cases.verdict.outcome.x_judge_failure__mutmut_13: survived
    {PREDICTS}: no tests
    lammps_cases.verdict.mistakes.x__each_law__mutmut_1: killed
To show the diff of a mutant: mutmut show NAME
"""
DIFF = """# lammps_cases.findings.engines.x_document__mutmut_5: survived
--- lammps_cases/findings/engines.py
+++ lammps_cases/findings/engines.py
@@ -1,4 +1,4 @@
 def document():
-    order = sorted(engines,
-                   key=Version)
+    order = sorted(engines, key=None)
     lines = [
"""


def test_mutants_are_read_from_the_results_and_counted_by_module() -> None:
    statuses = judge.statuses(RESULTS)
    assert list(statuses.values()) == ["survived", "no tests", "killed"]
    assert [judge.function_of(mutant).removeprefix("lammps_cases.") for mutant in statuses] == [
        *("verdict.outcome.judge_failure", "findings.entry.Finding.predicts", "verdict.mistakes._each_law")
    ]
    assert judge.table(statuses) == [
        "findings.entry: 1 mutants, 1 no tests",
        "verdict.mistakes: 1 mutants, 1 killed",
        "verdict.outcome: 1 mutants, 1 survived",
        "all: 3 mutants, 1 killed, 1 no tests, 1 survived",
    ]
    assert judge.change(DIFF) == "order = sorted(engines, key=Version) → order = sorted(engines, key=None)"


def test_mutant_that_judges_an_answer_differently_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A survivor that is not argued is a gap."""
    answered = tmp_path / "answered.json"
    answered.write_text(json.dumps({PREDICTS: "timeout"}))
    monkeypatch.setattr(judge, "ANSWERED", answered)
    monkeypatch.setattr(judge, "mutmut", lambda word, *_: RESULTS if word == "results" else DIFF)
    assert judge.main() == 1
    assert capsys.readouterr().out.splitlines()[3:] == [
        "all: 3 mutants, 1 by answers timeout, 1 killed, 1 survived",
        "1 not killed, 0 of them argued in judge.yaml",
        f"  lammps_cases.verdict.outcome.judge_failure: {judge.change(DIFF)}",
    ]


def test_argument_covers_one_change_or_a_function(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "judge.yaml"
    file.write_text("[{id: a.f, what: x → y, reason: same}, {id: a.g, what: '*', reason: when it is loaded}]")
    monkeypatch.setattr(judge, "ARGUED", file)
    survivors = [("a.f", "x → y"), ("a.f", "x → z"), ("a.g", "any"), ("a.h", "x → y")]
    assert judge.unargued(survivors) == [("a.f", "x → z"), ("a.h", "x → y")]


def test_arguments_name_existing_functions_and_lines_in_them() -> None:
    for entry in read_yaml(judge.ARGUED):
        module = importlib.import_module(pkgutil.resolve_name(entry["id"]).__module__)
        assert module.__file__ is not None
        source = " ".join(Path(module.__file__).read_text().split())
        assert entry["what"] == "*" or " ".join(entry["what"].partition(" → ")[0].split()) in source, entry["what"]


# --- very many particles


def test_large_scenes_have_the_stated_number_of_particles() -> None:
    cases = {case.name: case for case in load((large.CASES,))}
    sizes = {"million": 1_000_000, "four-million": 4_000_000, "million-3d": 1_000_000}
    ranks = {"one": 1, "two": 2, "four": 4}
    assert {name: (math.prod(case.scene.positions.cells), case.scene.engine.ranks) for name, case in cases.items()} == {
        f"large.{size}.{count}": (sizes[size], ranks[count]) for size in sizes for count in ranks
    }
    assert all("long" in case.tags for case in cases.values())


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize(("limit", "code"), [(4e9, 0), (1e6, 1)])
def test_scene_is_judged_within_the_memory_limit(
    limit: float, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = tmp_path / "large.yaml"
    small.write_text(large.CASES.read_text(encoding="utf-8").replace("1000, 1000", "12, 10"), encoding="utf-8")
    monkeypatch.setattr(large, "CASES", small)
    monkeypatch.setattr(large, "LIMIT", limit)
    assert large.main(["large.million.one"]) == code
    line = capsys.readouterr().out
    assert line.startswith("large.million.one: explained, 120 particles; LAMMPS ")
    assert f" of {limit / 1e9:.0f}; report 0." in line


def test_difference_is_not_a_success(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "judged_apart", lambda *_: large.JudgedScene(10, 0.0, 0.0, 10, "differs"))
    assert large.main(["large.million.one"]) == 1


# --- faults in machine code

CASE = "ranges.background-ranges"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library("env", tmp_path_factory.mktemp("machine"))


@pytest.fixture
def right(library: Library) -> Library:
    """The library without a fault."""
    library.plant(None)
    return library


@pytest.fixture(scope="module")
def sites(library: Library) -> list[Site]:
    return machine_code.sites(library.place)


@pytest.mark.lammps
@pytest.mark.slow
def test_sites_are_instructions_of_rheo_classes(sites: list[Site]) -> None:
    kinds = {"operation exchanged", "condition turned", "store left out", "call left out"}
    classes = {site.function.partition("::")[0] for site in sites}
    assert {site.kind for site in sites} == kinds
    assert all("RHEO" in name for name in classes) and not machine_code.OTHERS & classes
    assert {"PairRHEO::compute", "FixRHEOPressure::calc_pressure"} <= {site.function for site in sites}
    assert all(site.old != site.new and len(site.old) == len(site.new) for site in sites)
    assert len({site.offset for site in sites}) == len(sites)


@pytest.mark.lammps
@pytest.mark.slow
def test_fault_is_planted_alone_and_reverted(right: Library, sites: list[Site]) -> None:
    before = right.place.read_bytes()
    right.plant(sites[0])
    after = right.place.read_bytes()
    differing = {k for k in range(len(before)) if before[k] != after[k]}
    assert differing and differing <= {*range(sites[0].offset, sites[0].offset + len(sites[0].old))}
    right.plant(None)
    assert right.place.read_bytes() == before


@pytest.mark.lammps
@pytest.mark.slow
def test_replaced_operation_on_pressures_is_detected(right: Library, sites: list[Site]) -> None:
    """Only one case, of pressures, is run; an instruction that it reaches traps."""
    assert right.red(CASE) == ""
    seen = ""
    for site in sites:
        if (site.function, site.kind) == ("FixRHEOPressure::calc_pressure", "operation exchanged"):
            right.plant(site)
            if seen := right.red(CASE):
                right.plant(site, TRAP)
                assert right.red(CASE).startswith("crashed")
                break
    assert seen.startswith("differs") and CASE in seen


@pytest.mark.lammps
@pytest.mark.slow
def test_traps_record_what_a_case_reaches(right: Library) -> None:
    """Those of its law, not those of heat; the traps do not change its numbers."""
    assert right.red(CASE) == ""
    reaching = right.reached(CASE)
    assert right.changed({CASE}) == set()
    assert {case for cases in reaching.values() for case in cases} == {CASE}
    of = {function for function, offset, _ in machine_code.instructions(right.place) if offset in reaching}
    assert "FixRHEOPressure::calc_pressure" in of and "PairRHEO::compute" not in of


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize(("reaching", "fate"), [((), "not reached"), ((CASE,), "without effect")])
def test_instruction_without_effect_on_numbers_is_classified(
    right: Library, sites: list[Site], reaching: tuple[str, ...], fate: str
) -> None:
    """An instruction of heat, of which the case has none, in place of one that it reaches without effect."""
    site = next(site for site in sites if site.function == "FixRHEOThermal::post_integrate")
    right.reached(CASE)
    assert machine_code.outcome(right, site, reaching, quick={CASE}) == (fate, "")


@pytest.mark.parametrize(
    ("symbol", "function"),
    [
        ("_ZN9LAMMPS_NS8PairRHEO7computeEii", "PairRHEO::compute"),
        ("_ZN9LAMMPS_NS8PairRHEOC1EPNS_6LAMMPSE", "PairRHEO::PairRHEO"),
        ("_ZTv0_n48_N9LAMMPS_NS11AtomVecRHEO11force_clearEim", "AtomVecRHEO::force_clear"),
        ("_ZN9LAMMPS_NS8PairRHEOC2EPNS_6LAMMPSE", ""),
        ("_ZN9LAMMPS_NS7PairLJC1Ev", ""),
        ("_ZNK9LAMMPS_NS13BondRHEOShell6singleEv", ""),
    ],
)
def test_name_of_another_package_is_ignored(symbol: str, function: str) -> None:
    assert machine_code.function_of(symbol) == function


# --- docs/examples.md


def test_document_contains_the_measurements_and_what_it_says_of_them() -> None:
    text, rows = examples_table.PAGE.read_text(encoding="utf-8"), json.loads(examples_table.FILE.read_text())
    assert examples_table.page(text, rows) == text
    assert examples_table.page(text, rows[1:]) != text
    vortex, plates = ({r["run"]: r for r in rows if r["deck"] == deck} for deck in ("taylor-green", "poiseuille"))
    away = {run: row["away"] for run, row in vortex.items()}
    log = next(of for run, of in away.items() if run.startswith("log of"))
    assert budgets.percent(away[budgets.LAMMPS]) == budgets.percent(away["as it is"]) == budgets.percent(log)
    assert vortex["no artificial viscosity"]["adds"] > away["as it is"] > 0 > vortex["no density diffusion"]["adds"]
    here, bare, half, fine = (
        plates[run]["away"]
        for run in (
            *("as it is", "no artificial viscosity", "half the spacing"),
            "half the spacing, no artificial viscosity",
        )
    )
    assert 0 < here < bare / 2, "most of the error of the walls is hidden"
    assert 0 < fine < 0.6 * bare, "of first order"
    assert bare - here > fine - half
