"""Shared by all tests: scenes made on the fly and the command line in this process."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from lammps_cases.cli import main
from lammps_cases.comparison import store
from lammps_cases.history import store as history
from tests.support.outcome import Outcome

BASE: dict[str, Any] = {
    "dimension": 2,
    "types": [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}],
    "positions": {"lattice": "sq", "spacing": 0.8, "cells": [5, 4], "disorder": 0.2},
    "pressure": [{"types": "*", "style": "tait/general", "gamma": 2.3}],
    "rho": {"ratio": [0.8, 1.3]},
}


@pytest.fixture(autouse=True, scope="session")
def own_store(tmp_path_factory: pytest.TempPathFactory) -> None:
    """No test finds what an earlier run of the tests predicted."""
    os.environ[store.VARIABLE] = str(tmp_path_factory.mktemp("predictions"))


@pytest.fixture(autouse=True, scope="session")
def no_service() -> None:
    """Runs of the tests are not announced to the CI service that runs the tests."""
    for service in ("GITHUB_ACTIONS", "GITLAB_CI"):
        os.environ.pop(service, None)


@pytest.fixture(autouse=True, scope="session")
def own_history(tmp_path_factory: pytest.TempPathFactory) -> None:
    """No run of the tests is kept in the user's history."""
    os.environ[history.VARIABLE] = str(tmp_path_factory.mktemp("history") / "history.sqlite")


@pytest.fixture
def case_file(tmp_path: Path) -> Callable[..., Path]:
    """Write a case file: keys replace those of a small valid scene, None removes one."""

    def write(name: str = "mine", matrix: dict[str, Any] | None = None, **changes: Any) -> Path:
        scene = {key: value for key, value in {**BASE, **changes}.items() if value is not None}
        path = tmp_path / f"{name}.yaml"
        data = {"name": name, "about": "A scene of the tests.", "scene": scene}
        path.write_text(yaml.safe_dump(data | ({"matrix": matrix} if matrix else {})))
        return path

    return write


@pytest.fixture
def eos_ref_command(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run ``eos-ref ARGUMENTS`` in this process."""

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["eos-ref", *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as left:
            main.main()
        out, err = capfd.readouterr()
        return Outcome(int(left.value.code or 0), out, err)

    return run
