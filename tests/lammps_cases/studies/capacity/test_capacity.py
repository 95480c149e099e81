"""docs/capacity.md: what was measured, and the simulation that the hours on paper are held against."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.studies.capacity import summary
from lammps_cases.studies.capacity.costs import DOCUMENT, CampaignCosts
from lammps_cases.studies.capacity.simulation import drawn, judged, on_paper, simulated


@pytest.fixture(scope="module")
def costs() -> CampaignCosts:
    return DOCUMENT.read(summary.MEASURED)


def test_the_document_has_what_was_measured(costs: CampaignCosts) -> None:
    text = (Path(__file__).parents[4] / "docs" / "capacity.md").read_text(encoding="utf-8")
    assert summary.document(text, costs) == text


def test_a_shard_by_hand() -> None:
    assert judged([3.0, 1.0, 1.0, 2.0], 2, 0.0) == 4.0  # 3 | 1, 1, 2
    assert judged([0.25] * 10, 4, 0.5) == 5.25  # the main process hands out the last after ten halves


@pytest.mark.parametrize("predictions", summary.KINDS)
def test_the_simulation_lies_between_its_bounds(costs: CampaignCosts, predictions: str) -> None:
    """R. L. Graham: no worker is idle while a case waits, so that what exceeds the mean load is one case."""
    cases, shards, workers = summary.PLANS[0]
    made = simulated(costs, cases, shards, workers, predictions)
    assert made in costs.simulated, "that of the document"
    seconds = drawn(costs, cases, predictions).values()
    share, longest = sum(seconds) / shards, max(seconds)
    most = (share + longest) / workers + longest + (cases / shards + shards) * costs.main
    assert max(share / workers, cases / shards * costs.main) <= made.seconds <= most


def test_hours_on_paper_are_those_of_the_simulation(costs: CampaignCosts) -> None:
    """But for two of the longest cases, and three standard errors of the mean cost of those that were drawn."""
    for plan in costs.simulated:
        longest = costs.worker[plan.predictions][-1]
        error = 3 * longest / plan.cases**0.5
        share = plan.cases / plan.shards
        assert abs(plan.seconds - on_paper(costs, plan)) <= 2 * longest + share / plan.workers * error
