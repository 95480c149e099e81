"""`lammps_cases.run(...)`: its arguments, and refusals before LAMMPS is opened."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import lammps_cases.run
from eos_ref import InputError
from lammps_cases.engine import forkserver
from lammps_cases.run import campaign, command
from lammps_cases.run.options import CaseOptions, several


def test_one_name_or_path_is_a_list_of_one() -> None:
    assert several("walls") == ["walls"] and several(Path("a.yaml")) == ["a.yaml"]
    assert several(["a", Path("b")]) == ["a", "b"] and several(()) == []
    assert CaseOptions().processes >= 1


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"names": "no-such-case"}, "no such case: 'no-such-case'"),
        ({"tag": "no-such-tag"}, "tag: no case has the tag 'no-such-tag'"),
        ({"cases": "no-such-folder"}, "no-such-folder"),
        ({"engine": "nonsense"}, "env, pypi:VERSION or path:DIR"),
        ({"jobs": 0}, r"argument jobs: .*greater than or equal to 1, found 0 \(run\(\)\)"),
        ({"jobs": 1.5}, r"argument jobs: .*integer"),
        ({"fail_on": "never"}, "argument fail_on"),
        ({"allow": "support-units"}, "no such finding: 'support-units'.*support-unit"),
    ],
)
def test_bad_arguments_are_one_line(arguments: dict[str, Any], complaint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forkserver, "start_for_judging", lambda: None)
    with pytest.raises(InputError, match=complaint) as refused:
        command.run(**arguments)
    assert len(str(refused.value).splitlines()) == 1


def test_equivalent_command_is_in_the_record(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    given: list[Any] = []

    def run_cases(cases: Any, engine: Any, jobs: int, folder: Path, asked: campaign.Request, **_: Any) -> Any:
        given.extend([[case.name for case in cases], jobs, folder, asked.command, asked.fail_on, asked.allow])
        raise InputError("cases", "are not run here")

    monkeypatch.setattr(forkserver, "start_for_judging", lambda: None)
    monkeypatch.setattr(campaign, "run_cases", run_cases)
    with pytest.raises(InputError, match="are not run here"):
        lammps_cases.run("near-rho0.linear.2d", jobs=3, fail_on="high", allow="support-unit", out=tmp_path / "out")
    line = "eos-ref run near-rho0.linear.2d --allow support-unit"
    assert given == [["near-rho0.linear.2d"], 3, tmp_path / "out", line, "high", ["support-unit"]]
