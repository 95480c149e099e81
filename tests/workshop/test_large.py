"""docs/capacity.md: what was measured, and the simulation that the hours on paper are held against."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lammps_cases.scene.casefile import load
from lammps_cases.studies.capacity import large, summary
from lammps_cases.studies.capacity.costs import DOCUMENT, CampaignCosts, JudgedScene
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


# --- very many particles


def test_large_scenes_have_as_many_particles_as_they_say() -> None:
    cases = {case.name: case for case in load((large.CASES,))}
    sizes = {"million": 1_000_000, "four-million": 4_000_000}
    ranks = {"one": 1, "two": 2}
    assert {name: (math.prod(case.scene.positions.cells), case.scene.engine.ranks) for name, case in cases.items()} == {
        f"large.{size}.{count}": (sizes[size], ranks[count]) for size in sizes for count in ranks
    }
    assert all("long" in case.tags for case in cases.values())


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize(("limit", "code"), [(4e9, 0), (1e6, 1)])
def test_a_scene_is_judged_within_so_much_memory(
    limit: float, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = tmp_path / "large.yaml"
    small.write_text(large.CASES.read_text(encoding="utf-8").replace("1000, 1000", "12, 10"), encoding="utf-8")
    monkeypatch.setattr(large, "CASES", small)
    monkeypatch.setattr(large, "LIMIT", limit)
    assert large.main(["large.million.one"]) == code
    line = capsys.readouterr().out
    assert line.startswith("large.million.one: explained, 120 particles; LAMMPS ")
    assert f" of {limit / 1e9:.0f}; report 0." in line


def test_a_difference_is_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "judged_apart", lambda *_: JudgedScene(10, 0.0, 0.0, 10, "differs"))
    assert large.main(["large.million.one"]) == 1
