"""Printed text fits the terminal, is complete in a file, uses singular and plural, and suggests corrections."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.cli import findings, shared
from lammps_cases.findings import KNOWN, LEDGER, accepted_cases, by_cause
from lammps_cases.records.levels import SEVERITIES
from lammps_cases.records.wording import MEANINGS
from lammps_cases.report.history import store
from lammps_cases.report.history.store import History
from lammps_cases.scene.fields import FIELDS
from tests.conftest import ROOT
from tests.support import made_runs
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
WIDTHS = (60, 80, 120)


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A history of two runs with long names."""
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "h.sqlite"))
    monkeypatch.chdir(tmp_path)
    cases = [made_runs.case("walls-moving.driven.quintic"), made_runs.case("walls-moving.at-rest.rk1", "differs")]
    with History(tmp_path / "h.sqlite") as history:
        for version in ("2025.7.22.1.0", "2025.7.22.2.0"):
            history.add(made_runs.run(version, f"2026-11-0{version[10]}T08:00:00Z", cases))


COMMANDS = [("list",), ("ledger",), ("ledger", "force-per-volume"), ("history",), ("history", "walls-moving")]
COMMANDS += [("history", "walls-moving.driven.quintic"), ("explain", "explained")]


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("columns", WIDTHS)
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_no_line_is_wider_than_the_terminal(
    command: tuple[str, ...], columns: int, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    code, out, err = eos_ref_command(*command)
    assert code == 0, err
    assert max(len(line.rstrip()) for line in out.splitlines() if not line.startswith("page: ")) <= columns, out


@pytest.mark.usefixtures("runs")
def test_names_are_not_broken_at_60_columns(eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert {entry.id for entry in LEDGER} <= set(eos_ref_command("ledger").out.split())
    assert "walls-moving.driven.quintic" in eos_ref_command("list").out.split()
    assert {"walls-moving.driven.quintic", "walls-moving.at-rest.rk1"} <= set(
        eos_ref_command("history", "walls-moving").out.split()
    )
    assert {"2025.7.22.1.0", "2025.7.22.2.0"} <= set(eos_ref_command("history").out.split())


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_output_to_a_file_is_complete(command: tuple[str, ...], eos_ref_command: Run) -> None:
    out = eos_ref_command(*command).out
    assert "…" not in out
    for part in {
        ("ledger",): [entry.title for entry in LEDGER],
        ("history",): ["vs. same engine", "vs. previous version", "1 pass, 1 differs"],
        ("explain", "explained"): [MEANINGS["explained"]],
        ("list",): ["units"],
    }.get(command, []):
        assert part in out, part


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
    run = made_runs.run(cases=[red])
    monkeypatch.setenv("COLUMNS", "60")
    shared.finish(run, tmp_path, as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, (line for line in lines if not line.startswith("report: ")))) <= 60
    assert sum(line.split().count("bound") for line in lines) == 20


def test_ledger_is_ordered_by_cause(eos_ref_command: Run) -> None:
    rows = [line.split() for line in eos_ref_command("ledger").out.splitlines()]
    listed = [(row[0], row[1]) for row in rows if row and row[0] in SEVERITIES]
    assert listed == [(entry.severity, entry.id) for entry in by_cause(accepted_cases())]


def test_consecutive_versions_are_named_as_a_range() -> None:
    first, second, third, *_, last = KNOWN
    assert findings._versions(KNOWN) == f"{first} to {last}"
    assert findings._versions((first, second)) == f"{first}, {second}"
    assert findings._versions((first, third, last)) == f"{first}, {third}, {last}"


@pytest.mark.slow
def test_findings_fields_and_verdicts_are_explained(eos_ref_command: Run) -> None:
    kinds = ([entry.id for entry in LEDGER], list(FIELDS), list(MEANINGS))
    for name in (name for names in kinds for name in names[:: len(names) // 2]):  # each loads every case
        code, out, err = eos_ref_command("explain", name)
        assert code == 0, err
        assert out.startswith(name)
        assert json.loads(eos_ref_command("explain", name, "--json").out)


def test_document_has_the_same_text_on_verdicts() -> None:
    text = (ROOT / "docs" / "verdicts.md").read_text().replace("`", "").replace("[findings](findings.md)", "findings")
    for verdict, meaning in MEANINGS.items():
        assert any(verdict in line and meaning in line for line in text.splitlines()), verdict


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "near-rh0"), "no such case: 'near-rh0' (did you mean 'near-rho0'?)"),
        (("explain", "force-per-volum"), "(did you mean 'force-per-volume'?)"),
        (("explain", "surface/dvr"), "(did you mean 'surface/divr'?)"),
        (("explain", "explaind"), "(did you mean 'explained'?)"),
        (("ledger", "force-per-volum"), "no such finding: 'force-per-volum' (did you mean 'force-per-volume'?)"),
        (("run", "--tag", "quik"), "tag: no case has the tag 'quik'; did you mean 'quick'? (tags: "),
        (("audit", "in.deck", "--fields", "presure"), "(did you mean 'pressure'?)"),
    ],
)
def test_suggestions(
    arguments: tuple[str, ...], said: str, eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.deck").write_text("units lj\n")
    code, _, err = eos_ref_command(*arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert said in err


def test_unknown_engine_lists_available_ones(
    eos_ref_command: Run, case_file: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    said = "ERROR: no lammps[mpi]==9.9.9 (from versions: 8.1.0, 9.9.8)\nERROR: No matching distribution found\n"
    monkeypatch.setenv("EOS_REF_CACHE", str(tmp_path / "cache"))
    done = subprocess.CompletedProcess([], 1, "", said)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    code, _, err = eos_ref_command("run", "--cases", case_file(), "--engine", "pypi:9.9.9")
    assert code == 2
    assert "no such version; did you mean '9.9.8'? Available: 8.1.0, 9.9.8, found 'pypi:9.9.9'" in err


def test_count_of_one_is_singular(eos_ref_command: Run) -> None:
    for name, count in (("near-rho0.linear.2d", "1 case"), ("near-rho0.linear.*", "2 cases")):
        assert eos_ref_command("list", name).out.splitlines()[0].strip() == count


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("command", [("ledger",), ("ledger", "--json"), ("--help",)])
def test_full_disk_and_closed_pipe(command: tuple[str, ...], unbuffered: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    program = [sys.executable, "-m", "lammps_cases.cli.main", *command]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(program, stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    said = "eos-ref: output: cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (2, said)
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(program, stdout=write, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")
