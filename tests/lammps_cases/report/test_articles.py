"""The articles of cases made by workers are those made in one process."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.run_record import RunRecord
from lammps_cases.report import findings, page
from lammps_cases.report.page import Family, RunPage
from lammps_cases.run import report_files
from tests.support.made_report import FINDINGS


@pytest.fixture
def families(run: RunRecord, folder: Path) -> list[Family]:
    return RunPage(findings.outcome(run, FINDINGS), folder / "fields").families


@pytest.mark.slow
def test_workers_make_the_same_articles(families: list[Family]) -> None:
    with Workers(None, 2) as workers:
        assert report_files.begin_articles(workers, families)() == page.articles(families)


@pytest.mark.parametrize("count", [1, 3])
def test_articles_lost_by_workers_are_made_locally(count: int, families: list[Family]) -> None:
    failing: Any = SimpleNamespace(
        count=count, call=lambda *arguments, **options: None, outcome=lambda _: Failure("crashed", "it died")
    )
    assert report_files.begin_articles(failing, families)() == page.articles(families)


def test_shares_are_about_equal_and_hold_every_family_once(families: list[Family]) -> None:
    entries = [entry for family in families for entry in family.entries]
    made = [Family(entries[:1] * (k + 1), Path(), {}, frozenset(), True) for k in range(20)]
    shares = report_files.article_shares(made, 4)
    assert sorted(k for share in shares for k in share) == [*range(20)]
    sizes = [sum(k + 1 for k in share) for share in shares]
    assert max(sizes) < 1.1 * min(sizes), sizes
    assert len(report_files.article_shares(made[:3], 8)) == 3
