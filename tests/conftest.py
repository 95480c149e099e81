"""Shared by all tests: scenes made on the fly and the command line in this process."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from lammps_cases.audit.options import TRUST
from lammps_cases.cli import main
from lammps_cases.comparison import store
from lammps_cases.engine import containment, forkserver
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Workers
from lammps_cases.report.history import store as history
from tests.support.outcome import Outcome, Solver

BASE: dict[str, Any] = {
    "dimension": 2,
    "types": [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}],
    "positions": {"lattice": "sq", "spacing": 0.8, "cells": [5, 4], "disorder": 0.2},
    "pressure": [{"types": "*", "style": "tait/general", "gamma": 2.3}],
    "rho": {"ratio": [0.8, 1.3]},
}


if containment.means() == "none":  # the project's decks are audited nevertheless
    os.environ[TRUST] = "1"

ROOT = Path(__file__).parents[1]
MADE_BY_TOOLS = {"__pycache__", ".pytest_cache", ".hypothesis", ".ruff_cache", ".mypy_cache"}
at_start = pytest.StashKey[set[Path]]()


def _in_the_checkout() -> set[Path]:
    """The files at the top of the checkout and among its reports."""
    paths = {path for folder in (ROOT, ROOT / "reports") if folder.is_dir() for path in folder.iterdir()}
    return {path for path in paths if path.name not in MADE_BY_TOOLS}


def pytest_sessionstart(session: pytest.Session) -> None:
    session.config.stash[at_start] = _in_the_checkout()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail if the tests left anything in the checkout; with several processes the one that distributes them looks."""
    if hasattr(session.config, "workerinput"):
        return
    left = sorted(_in_the_checkout() - session.config.stash[at_start])
    if left:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
        reporter = session.config.pluginmanager.get_plugin("terminalreporter")
        reporter.ensure_newline()
        reporter.write_line(f"left behind by the tests: {', '.join(map(str, left))}", red=True)


APART = {"browser", "campaign", "kills", "root", "slurm", "soak", "typed", "unittest", "workshop"}
LONGEST = ("test_chart.py",)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow files come first: processes that share the tests file by file then end at about the same time.

    Tests with a separate make target count as slow, so that ``-m "not lammps and not slow"`` leaves it out as well.
    """
    for item in items:
        if APART & {mark.name for mark in item.iter_markers()}:
            item.add_marker("slow")
    marked = {(item.path, mark.name) for item in items for mark in item.iter_markers()}

    def place(item: pytest.Item) -> tuple[int, bool, bool]:
        longest = LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST)
        return longest, (item.path, "lammps") not in marked, (item.path, "slow") not in marked

    items.sort(key=place)


@pytest.fixture(autouse=True, scope="session")
def own_store(tmp_path_factory: pytest.TempPathFactory) -> None:
    """No test finds predictions of an earlier run of the tests or of a user."""
    os.environ[store.VARIABLE] = str(tmp_path_factory.mktemp("predictions"))


@pytest.fixture(autouse=True, scope="session")
def no_service() -> None:
    """Runs of the tests are not announced to the CI service that runs the tests."""
    for service in ("GITHUB_ACTIONS", "GITLAB_CI"):
        os.environ.pop(service, None)


@pytest.fixture(autouse=True, scope="session")
def no_width() -> None:
    """Output has no width unless a test sets one: processes that share the tests are given one."""
    os.environ.pop("COLUMNS", None)


@pytest.fixture(autouse=True, scope="session")
def own_history(tmp_path_factory: pytest.TempPathFactory) -> None:
    """No run of the tests is kept in the user's history."""
    os.environ[history.VARIABLE] = str(tmp_path_factory.mktemp("history") / "history.sqlite")


@pytest.fixture(autouse=True, scope="module")
def server(request: pytest.FixtureRequest, own_store: None, no_service: None, own_history: None) -> None:
    """Workers are forked from a process that has imported the judge of cases, as those of ``eos-ref run`` are."""
    items = (item for item in request.session.items if item.path == request.path)
    if any(item.get_closest_marker("lammps") for item in items):
        forkserver.preload("lammps_cases.verdict.cases", "lammps_cases.report.page")


@pytest.fixture(scope="module")
def workers(server: None) -> Iterator[Workers]:
    """Real LAMMPS in two worker processes."""
    with Workers(None, 2) as pool:
        yield pool


@pytest.fixture(scope="module")
def solver(workers: Workers) -> Solver:
    """Run real LAMMPS, which must answer."""

    def solve(job: Job) -> Answer:
        answer = workers.outcome(workers.submit(job, 120.0))
        assert isinstance(answer, Answer), answer
        return answer

    return solve


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Programs started by a test can be interrupted, even if the tests run as a background job, which cannot."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # what is ignored here is ignored in children
    yield
    signal.signal(signal.SIGINT, before)


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
