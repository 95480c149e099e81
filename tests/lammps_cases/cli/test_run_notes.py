"""Notes of eos-ref run on a user's cases: constants left at their defaults, and mistakes that go undetected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.outcome import Outcome

Write = Callable[..., Path]
Run = Callable[..., Outcome]
LINEAR = [{"types": "*", "style": "linear"}]


def notes(out: str) -> list[str]:
    return [line for line in out.splitlines() if line.startswith("note: ")]


@pytest.mark.lammps
def test_default_constants_are_noted(case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    changes = {"units": {"a": {"units": "lj"}, "b": {"units": "si"}}}
    file = case_file(types=[{"mass": 1.31}], pressure=LINEAR, matrix=changes)
    code, out, _ = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 0
    mistakes = "cs instead of cs^2, cs ignored, rho0 ignored, rho0 and cs exchanged"
    assert notes(out) == [
        "note: defaults used in 2 cases: rho0 = 1, cs = 1",
        f"note: 2 cases cannot tell apart: {mistakes}",
    ]
    code, out, _ = eos_ref_command("run", "--cases", file, "mine.a", "--out", tmp_path / "report", "--json")
    assert notes(out) == []


@pytest.mark.lammps
def test_given_constants_are_not_noted(case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    given = case_file(types=[{"mass": 1.31, "rho0": 1.2, "cs": 3.1}], pressure=LINEAR)
    code, out, _ = eos_ref_command("run", "--cases", given, "--out", tmp_path / "report")
    assert (code, notes(out)) == (0, [])


@pytest.mark.lammps
def test_shipped_cases_are_not_noted(eos_ref_command: Run, tmp_path: Path) -> None:
    code, out, _ = eos_ref_command("run", "defaults.linear", "--out", tmp_path / "report")
    assert (code, notes(out)) == (0, [])


@pytest.mark.lammps
def test_compared_viscosity_is_noted(case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    file = case_file(types=[{"mass": 1.31, "rho0": 1.2, "cs": 3.1}], compare=["viscosity"])
    out = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report").out
    assert notes(out)[0] == "note: defaults used in 1 case: viscosity = 0.1"


@pytest.mark.lammps
@pytest.mark.parametrize("interrupted", [False, True])
def test_uninterrupted_run_is_noted(interrupted: bool, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    command = [
        "run",
        "--cases",
        case_file(types=[{"mass": 1.31, "rho0": 1.2, "cs": 3.1}]),
        "--out",
        tmp_path / "report",
    ]
    if interrupted:
        (tmp_path / "report.interrupted" / "journal").mkdir(parents=True)
        (tmp_path / "report.interrupted" / "journal" / "broken").touch()
    begins = ["note: nothing to resume; running 1 case from the beginning"]
    assert notes(eos_ref_command(*command, "--resume").out) == ([] if interrupted else begins)
    assert notes(eos_ref_command(*command, "--resume", "--json").out) == []
