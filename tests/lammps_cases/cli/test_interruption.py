"""The message after Ctrl-C in a command that can be resumed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.audit import examples
from lammps_cases.engine import session
from lammps_cases.studies.chart import collect as chart_collect
from lammps_cases.studies.chart.record import DOCUMENT, Section
from lammps_cases.studies.flows import run
from lammps_cases.studies.stability import atlas
from tests.support.outcome import Outcome

COMMANDS = {
    "stability": (atlas, "measure", "cells.jsonl"),
    "validate": (run, "validate", "runs.jsonl"),
    "chart": (chart_collect, "collect", "sections.jsonl"),
    "examples": (examples, "collect", "decks.jsonl"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("done", [0, 1])
def test_message_states_what_is_kept(
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
    (tmp_path / "in.flow").touch()
    words = ["--from", tmp_path] if command == "examples" else []
    code, _, err = eos_ref_command(command, *words, "--out", tmp_path / "out")
    says = f"what is done is in {file}; the same command, without --fresh, resumes"
    assert code == 130
    end = f": {says}" if done else "; files are whole or not written"
    assert err.splitlines()[-1] == f"eos-ref: interrupted{end}"
    assert file.exists() == bool(done)


def test_interrupted_chart_is_drawn_and_resumed(
    eos_ref_command: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
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
    assert eos_ref_command(*command, "--quick")[0] == 0  # other methods: nothing of the first is reused
    assert measured[2:] == ["laws", "kernels"]
    assert eos_ref_command(*command, "--fresh")[0] == 0
    assert measured[4:] == ["laws", "kernels"]
