"""Printed text fits the terminal, is complete in a file, uses singular and plural; and the notes of a run."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.cli import findings, run, shared
from lammps_cases.engine import forkserver
from lammps_cases.findings import KNOWN, LEDGER, accepted_cases, by_cause
from lammps_cases.records.levels import SEVERITIES
from lammps_cases.records.wording import MEANINGS
from lammps_cases.report.history import store
from lammps_cases.report.history.store import History
from lammps_cases.run import campaign
from lammps_cases.scene import casefile
from tests.conftest import ROOT
from tests.support import made_runs
from tests.support.outcome import Outcome

Write = Callable[..., Path]
Run = Callable[..., Outcome]


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A history of two runs with long names."""
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "h.sqlite"))
    monkeypatch.chdir(tmp_path)
    cases = [made_runs.case("walls-moving.driven.quintic"), made_runs.case("walls-moving.at-rest.rk1", "differs")]
    with History(tmp_path / "h.sqlite") as history:
        for version in ("2025.7.22.1.0", "2025.7.22.2.0"):
            history.add(made_runs.run(version, f"2026-11-0{version[10]}T08:00:00Z", cases))


WALLS = {"walls-moving.driven.quintic", "walls-moving.at-rest.rk1"}
# Commands; words that are not broken at 60 columns; and parts of the output to a file.
COMMANDS: dict[str, tuple[set[str], list[str]]] = {
    "list": ({"walls-moving.driven.quintic"}, ["units"]),
    "ledger": ({entry.id for entry in LEDGER}, [entry.title for entry in LEDGER]),
    "ledger force-per-volume": (set(), []),
    "history": ({"2025.7.22.1.0", "2025.7.22.2.0"}, ["vs. same engine", "vs. previous version", "1 pass, 1 differs"]),
    "history walls-moving": (WALLS, []),
    "history walls-moving.driven.quintic": (set(), []),
    "explain explained": (set(), [MEANINGS["explained"]]),
}


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("command", COMMANDS)
def test_output_fits_the_terminal_and_is_complete_in_a_file(
    command: str, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, parts = COMMANDS[command]
    out = eos_ref_command(*command.split()).out
    assert "…" not in out and not [part for part in parts if part not in out]
    for columns in (60, 80, 120):
        monkeypatch.setenv("COLUMNS", str(columns))
        code, out, err = eos_ref_command(*command.split())
        assert code == 0, err
        assert max(len(line.rstrip()) for line in out.splitlines() if not line.startswith("page: ")) <= columns, out
        assert whole <= set(out.split())


def test_column_that_does_not_fit_is_shortened(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    shared.table(("name", "more"), [("n" * 60, "more")], drop=("more",))
    out = capsys.readouterr().out
    assert "n" * 20 in out and "…" in out and "more" not in out
    assert max(map(len, out.splitlines())) <= 40


def test_long_messages_break_between_words(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    red = made_runs.case("walls", "differs").model_copy(update={"message": "leaves its bound " * 20})
    monkeypatch.setenv("COLUMNS", "60")
    shared.finish(made_runs.run(cases=[red]), tmp_path, as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in lines if not line.startswith("report: ")) <= 60
    assert sum(line.split().count("bound") for line in lines) == 20


def test_ledger_is_ordered_by_cause(eos_ref_command: Run) -> None:
    rows = [line.split() for line in eos_ref_command("ledger").out.splitlines()]
    listed = [(row[0], row[1]) for row in rows if row and row[0] in SEVERITIES]
    assert listed == [(entry.severity, entry.id) for entry in by_cause(accepted_cases())]


def test_consecutive_versions_are_named_as_a_range() -> None:
    first, second, third, *_, last = KNOWN
    for versions, words in ((KNOWN, f"{first} to {last}"), ((first, second), f"{first}, {second}"),
                            ((first, third, last), f"{first}, {third}, {last}")):  # fmt: skip
        assert findings._versions(versions) == words


def test_count_of_one_is_singular(eos_ref_command: Run) -> None:
    for name, count in (("near-rho0.linear.2d", "1 case"), ("near-rho0.linear.*", "2 cases")):
        assert eos_ref_command("list", name).out.splitlines()[0].strip() == count


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("command", ["ledger", "ledger --json", "--help"])
def test_full_disk_and_closed_pipe(command: str, unbuffered: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    program = [sys.executable, "-m", "lammps_cases.cli.main", *command.split()]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(program, stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    message = "eos-ref: output: cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (2, message)
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(program, stdout=write, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


# --- eos-ref run: start-up, and notes on constants left at their defaults and mistakes that go undetected


@pytest.mark.parametrize("tag", ["quick", *run.WITHOUT_PAIRS])
@pytest.mark.parametrize("fresh", [True, False])
def test_workers_preload_the_neighbour_search_if_many_cases_need_it(
    tag: str, fresh: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Run
) -> None:
    begun = list[bool]()
    monkeypatch.setattr(forkserver, "fork_for_judging", begun.append)
    monkeypatch.setattr(campaign, "run_cases", None)
    eos_ref_command("run", "--tag", tag, "--out", tmp_path / "out", *(["--fresh"] if fresh else []))
    need = [case.scene.whole_model for case in casefile.select(casefile.load(), tag=tag)]
    many = any(need) if fresh else sum(need) > 0.1 * len(need)
    assert begun == [many]


def test_garbage_collection_is_enabled_again_after_bad_input() -> None:
    with pytest.raises(InputError), shared.uncollected():
        assert not gc.isenabled()
        raise InputError("cases", "must be there")
    assert gc.isenabled()


def notes(out: str) -> list[str]:
    return [line.removeprefix("note: ") for line in out.splitlines() if line.startswith("note: ")]


GIVEN = [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}]
LINEAR = [{"types": "*", "style": "linear"}]
UNITS = {"units": {"a": {"units": "lj"}, "b": {"units": "si"}}}
MISTAKES = "cs instead of cs^2, cs ignored, rho0 ignored, rho0 and cs exchanged"


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("scene", "words", "first"),
    [
        ({"types": [{"mass": 1.31}], "pressure": LINEAR, "matrix": UNITS}, "",
         ["defaults used in 2 cases: rho0 = 1, cs = 1", f"2 cases cannot tell apart: {MISTAKES}"]),
        ({"types": [{"mass": 1.31}], "pressure": LINEAR, "matrix": UNITS}, "mine.a --json", []),
        ({"types": GIVEN, "pressure": LINEAR}, "", []),
        ({"types": GIVEN, "compare": ["viscosity"]}, "", ["defaults used in 1 case: viscosity = 0.1", ...]),
        (None, "defaults.linear", []),  # a shipped case
    ],
)  # fmt: skip
def test_constants_and_mistakes_are_noted(
    scene: dict[str, Any] | None, words: str, first: list[Any], case_file: Write, eos_ref_command: Run, tmp_path: Path
) -> None:
    files = () if scene is None else ("--cases", case_file(**scene))
    code, out, _ = eos_ref_command("run", *files, *words.split(), "--out", tmp_path / "report")
    more = ... in first
    assert code == 0 or more
    assert notes(out)[: 1 if more else None] == [line for line in first if line is not ...]


@pytest.mark.lammps
@pytest.mark.parametrize("interrupted", [False, True])
def test_uninterrupted_run_is_noted(interrupted: bool, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    command = ("run", "--cases", case_file(types=GIVEN), "--out", tmp_path / "report", "--resume")
    if interrupted:
        (tmp_path / "report.interrupted" / "journal").mkdir(parents=True)
        (tmp_path / "report.interrupted" / "journal" / "broken").touch()
    begins = ["nothing to resume; running 1 case from the beginning"]
    assert notes(eos_ref_command(*command).out) == ([] if interrupted else begins)
    assert notes(eos_ref_command(*command, "--json").out) == []
