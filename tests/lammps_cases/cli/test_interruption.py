"""Ctrl-C in a command that can be resumed: the message, what is kept, and the output folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.engine import session
from lammps_cases.studies.chart import collect as chart_collect
from lammps_cases.studies.chart.record import DOCUMENT, Section
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
COMMANDS = {  # the function that works, and its journal
    "stability": ("lammps_cases.studies.stability.atlas.measure", "cells.jsonl"),
    "validate": ("lammps_cases.studies.flows.run.validate", "runs.jsonl"),
    "chart": ("lammps_cases.studies.chart.collect.collect", "sections.jsonl"),
    "examples": ("lammps_cases.audit.examples.collect", "decks.jsonl"),
    "logs": ("lammps_cases.audit.logs.collect", "runs.jsonl"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("existed", [False, True])
@pytest.mark.parametrize("done", [0, 1])
def test_message_states_what_is_kept_and_an_empty_folder_is_removed(
    command: str, existed: bool, done: int, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    function, journal = COMMANDS[command]
    out = tmp_path / "reports" / "out"
    file = out / journal

    def interrupted(*_: Any, **__: Any) -> None:
        if done:
            file.write_text("{}\n")
        raise KeyboardInterrupt

    monkeypatch.setattr(function, interrupted)
    (tmp_path / "in.flow").touch()
    if existed:
        out.mkdir(parents=True)
    words = ["--from", tmp_path] if command in ("examples", "logs") else []
    code, _, err = eos_ref_command(command, *words, "--out", out)
    resumes = f": what is done is in {file}; the same command, without --fresh, resumes"
    assert code == 130
    assert err.splitlines()[-1] == f"eos-ref: interrupted{resumes if done else '; files are whole or not written'}"
    assert (file.exists(), out.exists()) == (bool(done), bool(done or existed))
    assert out.parent.exists() == out.exists()


def test_interrupted_chart_is_drawn_and_resumed(
    eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    measured, last = list[str](), ["kernels"]

    def section(name: str, *_: Any) -> Section:
        if name in last:
            raise KeyboardInterrupt
        measured.append(name)
        return Section(name, f"title of {name}", "", 1.0)

    def titles() -> list[str]:
        return [of.title for of in DOCUMENT.read(tmp_path / "chart.json").sections]

    monkeypatch.setattr(chart_collect, "_section", section)
    monkeypatch.setattr(session, "open_lammps", lambda *_: None)
    monkeypatch.setattr(session, "describe", lambda *_: {})
    command = ("chart", "laws", "kernels", "--out", tmp_path)
    assert eos_ref_command(*command)[0] == 130
    assert titles() == ["title of laws"]
    assert "title of laws" in (tmp_path / "report.html").read_text()
    last.clear()
    assert eos_ref_command(*command, "--resume")[0] == 0
    assert (measured, titles()) == (["laws", "kernels"], ["title of laws", "title of kernels"])
    for option in ("--quick", "--fresh"):  # other methods, or again: nothing of the first is reused
        measured.clear()
        assert eos_ref_command(*command, option)[0] == 0
        assert measured == ["laws", "kernels"]
