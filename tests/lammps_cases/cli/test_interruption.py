"""What Ctrl-C says of a command that keeps what is done."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.engine import session
from lammps_cases.studies.chart import collect as chart_collect
from lammps_cases.studies.chart.record import Section
from lammps_cases.studies.mutation import collect
from lammps_cases.studies.stability import atlas
from lammps_cases.studies.validation import run
from tests.support.outcome import Outcome

COMMANDS = {
    "stability": (atlas, "measure", "cells.jsonl"),
    "validate": (run, "validate", "runs.jsonl"),
    "power": (collect, "collect", "planted.jsonl"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("done", [0, 1])
def test_what_is_done_is_said_to_be_kept(
    command: str,
    done: int,
    eos_ref_command: Callable[..., Outcome],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    module, function, journal = COMMANDS[command]
    file = tmp_path / "out" / journal

    def interrupted(*_: Any, **__: Any) -> None:
        if done:
            file.write_text("{}\n")
        raise KeyboardInterrupt

    monkeypatch.setattr(module, function, interrupted)
    code, _, err = eos_ref_command(command, "--out", tmp_path / "out")
    says = f"what is done is in {file}; the same command, without --fresh, resumes"
    assert code == 130
    assert err.splitlines()[-1] == "eos-ref: interrupted" + (f": {says}" if done else "; no partial files were written")
    assert file.exists() == bool(done)


def test_a_chart_says_which_sections_it_has(
    eos_ref_command: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def section(name: str, *_: Any) -> Section:
        if name == "sums":
            raise KeyboardInterrupt
        return Section(name, name, "", 0.0)

    monkeypatch.setattr(chart_collect, "_section", section)
    monkeypatch.setattr(session, "open_lammps", lambda *_: None)
    monkeypatch.setattr(session, "describe", lambda *_: {})
    code, _, err = eos_ref_command("chart", "laws", "sums", "--out", tmp_path)
    assert code == 130
    assert err.splitlines()[-1] == f"eos-ref: interrupted: {tmp_path / 'chart.json'} holds laws; no page was drawn"
    assert (tmp_path / "chart.json").exists()
    assert not (tmp_path / "report.html").exists()
