"""With --json a failure is a JSON document on standard output, with the same exit code."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.engine.session import EngineMissing
from lammps_cases.scene import casefile
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("list", "nera-rho0"), {"what": "no such case", "rule": "'nera-rho0' (did you mean 'near-rho0'?)"}),
        (("run", "--engine", "conda:5"), {"what": "engine", "value": "conda:5"}),
        (("list", "--cases", "/nowhere/a.yaml"), {"what": "case file", "where": "/nowhere/a.yaml"}),
        (("run", "--bogus"), {"what": "usage", "value": None, "where": None}),
        (("rnu",), {"what": "usage", "rule": "no such command: 'rnu' (did you mean 'run'?)"}),
    ],
)
def test_failure_is_a_document(arguments: tuple[str, ...], error: dict[str, str], eos_ref_command: Run) -> None:
    plain, document = eos_ref_command(*arguments), eos_ref_command(*arguments, "--json")
    assert plain.code == document.code == 2
    assert (plain.out, document.err) == ("", "")
    said = json.loads(document.out)
    assert list(said) == ["error"]
    assert list(said["error"]) == ["what", "rule", "value", "where"]
    assert said["error"] | error == said["error"]


def test_document_lists_all_mistakes(case_file: Callable[..., Path], eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command("list", "--cases", case_file(units="furlong", presure=[]), "--json")
    said = json.loads(out)
    assert (code, err) == (2, "")
    assert said["error"] == said["errors"][0]
    assert [(each["what"], each["value"]) for each in said["errors"]] == [("presure", None), ("units", "furlong")]
    assert all("mine.yaml, line " in each["where"] for each in said["errors"])


@pytest.mark.parametrize(
    ("raised", "code", "what"),
    [
        (EngineMissing("no lammps"), 3, "LAMMPS"),
        (KeyboardInterrupt(), 130, "run"),
        (RuntimeError("boom"), 3, "eos-ref"),
        (PermissionError(13, "denied", "/x"), 2, "file"),
    ],
)
def test_every_kind_of_failure_is_a_document(
    raised: BaseException, code: int, what: str, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise raised

    monkeypatch.setattr(casefile, "load", fail)
    ended = eos_ref_command("list", "--json")
    assert ended.code == code == eos_ref_command("list").code
    assert json.loads(ended.out)["error"]["what"] == what
