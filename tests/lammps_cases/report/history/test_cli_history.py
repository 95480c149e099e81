"""eos-ref history."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.records.files import write_atomically
from lammps_cases.report.history import store
from lammps_cases.report.history.store import History
from tests.support import made_runs
from tests.support.outcome import Outcome


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Callable[..., Outcome]
) -> Callable[..., Outcome]:
    """Run ``eos-ref history ARGUMENTS`` on a separate history."""
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "h.sqlite"))
    return lambda *given: eos_ref_command("history", "--out", tmp_path / "out", *given)


@pytest.fixture
def filled(tmp_path: Path) -> None:
    case = made_runs.case
    with History(tmp_path / "h.sqlite") as history:
        history.add(made_runs.run("9.0", "2026-11-01T08:00:00Z", [case("walls.a"), case("walls.b", ratio=math.nan)]))
        history.add(
            made_runs.run("10.0", "2026-11-02T08:00:00Z", [case("walls.a", "differs", math.inf, "b"), case("walls.b")])
        )


def test_empty_history_is_reported(command: Callable[..., Outcome], tmp_path: Path) -> None:
    ended = command()
    assert ended.code == 0
    assert ended.out.startswith(f"no run is kept yet in {tmp_path / 'h.sqlite'}")
    assert list(tmp_path.iterdir()) == []
    assert json.loads(command("--json").out)["runs"] == []


@pytest.mark.usefixtures("filled")
def test_the_runs_are_listed_with_what_changed(command: Callable[..., Outcome], tmp_path: Path) -> None:
    ended = command()
    first, second = (line for line in ended.out.splitlines() if "2026-11-" in line)
    assert "2 pass" in first
    assert "first run" in first
    assert "9.0: other verdict in 1, other bits in 1" in second
    assert (tmp_path / "out" / "history.html").exists()


@pytest.mark.usefixtures("filled")
def test_one_case_is_listed_in_detail(command: Callable[..., Outcome]) -> None:
    out = command("walls.a").out
    assert "walls.a   error ▁×   LAMMPS ▁▁" in out
    assert "first changed in 10.0, from 9.0: pass to differs; different bits of f; verdict of f" in out


@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize(
    ("only", "cells"), [((), "pass 0.25"), (("--verdicts",), "pass"), (("--errors",), "0.25"), (("--times",), "0.1")]
)
def test_several_cases_are_a_table(command: Callable[..., Outcome], only: tuple[str, ...], cells: str) -> None:
    out = command("walls", *only).out
    (row,) = (line for line in out.splitlines() if "walls.a" in line)
    assert row.split()[2 : 2 + len(cells.split())] == cells.split()
    assert row.split()[-1] == "10.0"


@pytest.mark.usefixtures("filled")
def test_json_is_one_document(command: Callable[..., Outcome]) -> None:
    def strict(text: str) -> Any:
        return json.loads(text, parse_constant=lambda name: pytest.fail(name))

    ended = command("walls", "--json")
    assert ended.err == ""
    document = strict(ended.out)
    assert [run["label"] for run in document["runs"]] == ["9.0", "10.0"]
    assert [case["case"] for case in document["cases"]] == ["walls.a", "walls.b"]
    assert document["cases"][0]["spans"][1]["outcome"]["worst"] == "Infinity"
    assert document["cases"][1]["spans"][0]["outcome"]["worst"] == "NaN"
    assert document["cases"][0]["changes"][0]["engine"] == "10.0"
    assert "cases" not in strict(command("--json").out)
    assert ended.out == command("walls", "--json").out


def test_earlier_reports_are_added_once(command: Callable[..., Outcome], tmp_path: Path) -> None:
    record = made_runs.run()
    write_atomically(tmp_path / "run" / "run.json", record.to_json())
    for given in (tmp_path / "run", tmp_path / "run" / "run.json"):
        assert len(json.loads(command("--add", given, "--json").out)["runs"]) == 1
    with History(tmp_path / "h.sqlite") as history:
        assert not history.add(record)  # as eos-ref run would
    write_atomically(tmp_path / "run" / "run.json", "{}")
    ended = command("--add", tmp_path / "run")
    assert ended.code == 2
    assert len(ended.err.splitlines()) == 1


@pytest.mark.usefixtures("filled")
def test_runs_before_a_day_are_deleted(command: Callable[..., Outcome]) -> None:
    assert command("--forget", "2026-11-02").out == "1 run before 2026-11-02 forgotten, 1 left\n"
    assert len(json.loads(command("--json").out)["runs"]) == 1


@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("wall",), "eos-ref: no such case in any stored run: 'wall' (did you mean 'walls'?)"),
        (("walls", "--field", "speed"), "eos-ref: field: none of these cases has it, found 'speed'"),
        (("--since", "yesterday"), "eos-ref: date: must be a day such as 2026-01-31, found 'yesterday' (--since)"),
        (("--forget", "2026-02-30"), "eos-ref: date: must be a day such as 2026-01-31, found '2026-02-30' (--forget)"),
        (("--db", "/nowhere/h.sqlite"), "eos-ref: history: does not exist (/nowhere/h.sqlite)"),
        (("--db", "/proc"), "eos-ref: history: must be a regular file (/proc)"),
        (
            ("--out", "/proc/nowhere"),
            "eos-ref: output folder: cannot be written: No such file or directory, found '/proc/nowhere'",
        ),
    ],
)
def test_bad_input_is_one_line(command: Callable[..., Outcome], given: tuple[str, ...], said: str) -> None:
    ended = command(*given)
    assert (ended.code, ended.out, ended.err.splitlines()) == (2, "", [said])


def test_disabled_history_needs_a_file(
    command: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(store.VARIABLE, "off")
    assert command().err == "eos-ref: history: is switched off: EOS_REF_HISTORY is off; name a file with --db\n"
    write_atomically(tmp_path / "run" / "run.json", made_runs.run().to_json())
    ended = command("--db", tmp_path / "other.sqlite", "--add", tmp_path / "run", "--json")
    assert len(json.loads(ended.out)["runs"]) == 1
