"""Mutants of the judge, from the output of mutmut: what each changes, where, and whether an argument covers it."""

from __future__ import annotations

import importlib
import json
import pkgutil
from pathlib import Path

import pytest

from lammps_cases.records.yaml_files import read_yaml
from tests.workshop import judge

RESULTS = """
    lammps_cases.verdict.outcome.x_judge_failure__mutmut_13: survived
    lammps_cases.findings.entry.xǁFindingǁpredicts__mutmut_2: no tests
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


def test_statuses_and_functions_are_read_from_the_results() -> None:
    statuses = judge.statuses(RESULTS)
    assert list(statuses.values()) == ["survived", "no tests", "killed"]
    assert [judge.function_of(mutant) for mutant in statuses] == [
        "lammps_cases.verdict.outcome.judge_failure",
        "lammps_cases.findings.entry.Finding.predicts",
        "lammps_cases.verdict.mistakes._each_law",
    ]


def test_mutants_are_counted_by_module() -> None:
    assert judge.table(judge.statuses(RESULTS)) == [
        "findings.entry: 1 mutants, 1 no tests",
        "verdict.mistakes: 1 mutants, 1 killed",
        "verdict.outcome: 1 mutants, 1 survived",
        "all: 3 mutants, 1 killed, 1 no tests, 1 survived",
    ]


def test_mutant_that_judges_an_answer_differently_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A survivor that is not argued is a gap."""
    answered = tmp_path / "answered.json"
    answered.write_text(json.dumps({"lammps_cases.findings.entry.xǁFindingǁpredicts__mutmut_2": "timeout"}))
    monkeypatch.setattr(judge, "ANSWERED", answered)
    monkeypatch.setattr(judge, "mutmut", lambda word, *_: RESULTS if word == "results" else DIFF)
    assert judge.main() == 1
    assert capsys.readouterr().out.splitlines()[3:] == [
        "all: 3 mutants, 1 by answers timeout, 1 killed, 1 survived",
        "1 not killed, 0 of them argued in judge.yaml",
        f"  lammps_cases.verdict.outcome.judge_failure: {judge.change(DIFF)}",
    ]


def test_change_has_the_old_and_the_new_lines() -> None:
    assert judge.change(DIFF) == "order = sorted(engines, key=Version) → order = sorted(engines, key=None)"


def test_argument_covers_one_change_or_a_function(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "judge.yaml"
    file.write_text("[{id: a.f, what: x → y, reason: same}, {id: a.g, what: '*', reason: when it is loaded}]")
    monkeypatch.setattr(judge, "ARGUED", file)
    survivors = [("a.f", "x → y"), ("a.f", "x → z"), ("a.g", "any"), ("a.h", "x → y")]
    assert judge.unargued(survivors) == [("a.f", "x → z"), ("a.h", "x → y")]


def test_arguments_name_existing_functions() -> None:
    """And lines that occur in them."""
    for entry in read_yaml(judge.ARGUED):
        function = pkgutil.resolve_name(entry["id"])
        assert callable(function)
        module = importlib.import_module(function.__module__)
        if entry["what"] != "*":
            assert module.__file__ is not None
            source = " ".join(Path(module.__file__).read_text().split())
            assert " ".join(entry["what"].partition(" → ")[0].split()) in source, entry["what"]
