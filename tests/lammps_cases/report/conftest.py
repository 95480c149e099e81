"""The report of a run, made once for the tests of a module."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.records.run_record import RunRecord
from lammps_cases.report.formats import write_report
from tests.support.made_report import FINDINGS, example
from tests.support.pages import Page, unpacked


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def run(folder: Path) -> RunRecord:
    run = example(folder)
    assert write_report(run, folder, FINDINGS) == folder / "report.html"
    return run


@pytest.fixture(scope="module")
def html(run: RunRecord, folder: Path) -> str:
    return unpacked((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def parsed(html: str) -> Page:
    return Page(html)
