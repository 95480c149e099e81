"""Mutants of the judge, from the words of mutmut: what each changes, where, and whether an argument speaks of it."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest

from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.studies.mutation import judge

RESULTS = """
    lammps_cases.verdict.outcome.x_judge_failure__mutmut_13: survived
    lammps_cases.findings.entry.xǁFindingǁpredicts__mutmut_2: no tests
    lammps_cases.verdict.law_mistakes.x__each_law__mutmut_1: killed
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
        "lammps_cases.verdict.law_mistakes._each_law",
    ]


def test_a_change_is_the_old_lines_and_the_new() -> None:
    assert judge.change(DIFF) == "order = sorted(engines, key=Version) → order = sorted(engines, key=None)"


def test_an_argument_is_of_one_change_or_of_a_function(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "judge.yaml"
    file.write_text("[{id: a.f, what: x → y, reason: same}, {id: a.g, what: '*', reason: when it is loaded}]")
    monkeypatch.setattr(judge, "ARGUED", file)
    survivors = [("a.f", "x → y"), ("a.f", "x → z"), ("a.g", "any"), ("a.h", "x → y")]
    assert judge.unargued(survivors) == [("a.f", "x → z"), ("a.h", "x → y")]


def test_arguments_speak_of_functions_that_there_are() -> None:
    """And of lines that stand in them."""
    for entry in read_yaml(judge.ARGUED):
        function = pkgutil.resolve_name(entry["id"])
        assert callable(function)
        module = importlib.import_module(function.__module__)
        if entry["what"] != "*":
            assert module.__file__ is not None
            source = " ".join(Path(module.__file__).read_text().split())
            assert " ".join(entry["what"].partition(" → ")[0].split()) in source, entry["what"]
