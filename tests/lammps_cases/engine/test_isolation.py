"""Each case is isolated: whatever LAMMPS does to its process costs that case alone, and the others continue."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.run import campaign
from tests.conftest import ROOT
from tests.support.faulty_lammps import faulty_lammps
from tests.support.outcome import Outcome

pytestmark = [pytest.mark.lammps, pytest.mark.slow]

Write = Callable[..., Path]
Run = Callable[..., Outcome]
# The faults, by their labels: the code that LAMMPS runs, the verdict, a part of the message.
FAULTS = {
    "good-first": ("", "exact", ""),
    "segfault": ("ctypes.string_at(0)", "crashed", "SIGSEGV"),
    "aborts": ("os.abort()", "crashed", "SIGABRT"),
    "hangs": ("time.sleep(600)", "timeout", "time limit of 3 s"),
    "quits": ("lmp.command('quit 7')", "crashed", "exited with code"),
    "memory": ("bytearray(10**15)", "crashed", "out of memory"),
    "killed": ("os.kill(os.getpid(), signal.SIGKILL)", "crashed", "SIGKILL"),
    "error": ("lmp.command('no_such_command')", "refused", "Unknown command: no_such_command"),
    "exception": ("raise Exception('ERROR: made up by the test')", "refused", "made up by the test"),
    "generator-exit": ("raise GeneratorExit('no more')", "error", "GeneratorExit: no more"),
    "surrogate": ("raise Exception('ERROR: \\udcff is no character')", "refused", "udcff is no character"),
    "prints": ("while True: os.write(1, b'words without end' * 1000)", "timeout", "time limit of 3 s"),
    "starts": ("subprocess.Popen(['sleep', '600'])", "exact", ""),
    "nan": ("lmp.numpy.extract_compute = nan(lmp.numpy.extract_compute)", "differs", "nan"),
    "callback": ("lmp.calls_back = True", "timeout", "time limit of 3 s"),
    "limit": ("bytearray(3 * 2**30)", "crashed", "out of memory"),
    "good-last": ("", "exact", ""),
}
MASSES = {label: 101.0 + k for k, label in enumerate(FAULTS)}  # which trigger them
# A package named lammps: the real one, except for these masses.
FAULTY = f"""
import ctypes, os, signal, subprocess, time
FAULTS = {[(MASSES[label], code) for label, (code, _, _) in FAULTS.items()]!r}

def nan(right):
    def wrong(*arguments):
        found = right(*arguments)
        found[:] = float("nan")
        return found
    return wrong

class lammps(_lammps):
    def commands_string(self, text):
        vars(self.numpy).pop("extract_compute", None)
        code = next((code for mass, code in FAULTS if f"mass 1 {{mass}}" in text), "")
        exec(code, globals() | {{"lmp": self}})
        return super().commands_string(text)

    def command(self, line):
        if vars(self).pop("calls_back", False):
            super().command("fix held all external pf/callback 1 1")
            self.set_fix_external_callback("held", lambda *_: ctypes.PyDLL(None).sleep(600))
        return super().command(line)
"""


@pytest.fixture(scope="module")
def faulty_engine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return faulty_lammps(tmp_path_factory.mktemp("engine"), FAULTY)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_fault_costs_its_own_case(
    jobs: int, faulty_engine: Path, case_file: Write, eos_ref_command: Run, tmp_path: Path
) -> None:
    faults = {label: {"types": [{"mass": mass, "rho0": 1.2, "cs": 3.1}]} for label, mass in MASSES.items()}
    file = case_file(matrix={"fault": faults}, engine={"time_limit": 3})
    code, out, _ = eos_ref_command(
        *("run", "--cases", file, "--engine", f"path:{faulty_engine}"),
        *("--memory", "2G", "--jobs", jobs, "--out", tmp_path / "report"),
    )
    assert code == 3
    run = json.loads((tmp_path / "report" / "run.json").read_text())
    found = {case["case"].split(".")[1]: case for case in run["cases"]}
    for label, (_, verdict, text) in FAULTS.items():
        assert found[label]["verdict"] == verdict, (label, found[label]["message"])
        assert text in found[label]["message"]
        assert (f"mine.{label}:" in out) == (verdict != "exact"), "the failed cases, and only they, are named"
    assert run["summary"] == Counter(verdict for _, verdict, _ in FAULTS.values())


def test_documented_table_of_faults_is_true() -> None:
    table = (ROOT / "docs" / "isolation.md").read_text().partition("| what LAMMPS does |")[2].splitlines()[2:]
    rows = [line.split("|") for line in table if line.startswith("|")]
    stated = {(row[3].strip().strip("`"), row[2].strip().strip("`")) for row in rows if row[3].strip()}
    assert stated == {(label, verdict) for label, (_, verdict, _) in FAULTS.items() if not label.startswith("good")}


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("import ctypes; ctypes.string_at(0)", "killed by SIGSEGV"),
        ("import os; os._exit(9)", "exited with code 9"),
        ("import time; time.sleep(600)", "time limit of 3 s"),
    ],
)
def test_engine_that_cannot_be_imported_is_reported_once(
    fault: str, message: str, case_file: Write, eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "OPENING", 1.0)
    package = tmp_path / "engine" / "lammps"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(fault)
    file = case_file(matrix={"copy": {"a": {}, "b": {}}}, engine={"time_limit": 3})
    out = tmp_path / "report"
    code, _, err = eos_ref_command("run", "--cases", file, "--engine", f"path:{package.parent}", "--out", out)
    assert code == 3
    assert len(err.strip().splitlines()) == 1 and "LAMMPS cannot be opened, for any case: " in err and message in err
    assert not out.exists() and not list(tmp_path.glob(".report*"))


def test_output_of_a_dying_lammps_stays_off_the_terminal(eos_ref_command: Run, tmp_path: Path) -> None:
    """LAMMPS aborts for a range of two stars; the output of the C++ runtime is kept for the message."""
    code, out, err = eos_ref_command("run", "refused.range-two-stars", "--out", tmp_path / "report")
    assert code == 0, "the ledger explains it"
    (case,) = json.loads((tmp_path / "report" / "run.json").read_text())["cases"]
    assert "terminate called" in case["message"] and "terminate called" not in err + out
    assert case["explained_by"] == ["double-star-abort"]


def _alive(mark: str) -> list[int]:
    """Processes that carry a mark in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark.encode() in (process / "environ").read_bytes():
                found.append(int(process.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="reads the process table of Linux")
def test_killed_run_ends_a_computing_lammps(case_file: Write, tmp_path: Path) -> None:
    """LAMMPS in a long run does not notice the death of its parent."""
    mark = f"EOS_REF_TEST={tmp_path.name}-{os.getpid()}"
    positions = {"lattice": "sq", "spacing": 0.8, "cells": [20, 20], "disorder": 0.2}
    file = case_file(evolve={"steps": 100000, "timestep": 0.001}, positions=positions)
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "--cases", str(file), "--out", str(tmp_path / "r")]
    environment = dict(os.environ, **dict([mark.split("=")]))
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 30
    while len(_alive(mark)) < 4:  # itself, server, watch, worker
        assert time.monotonic() < deadline
        time.sleep(0.1)
    time.sleep(1.0)  # the worker is running time steps
    process.kill()
    process.wait()
    while _alive(mark):
        assert time.monotonic() < deadline, "a process outlives the run"
        time.sleep(0.1)
