"""A campaign as events: a main process that hands out cases, workers that judge them, shards side by side."""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np

from lammps_cases.run.shards import balanced
from lammps_cases.studies.capacity.costs import QUANTILES, CampaignCosts, SimulatedCampaign


def judged(seconds: Sequence[float], workers: int, main: float) -> float:
    """Return when all cases of a shard are judged: each goes to the worker that is free first, one after another."""
    free, now = [0.0] * workers, 0.0
    for cost in seconds:
        now = max(now, free[0]) + main
        heapq.heapreplace(free, now + cost)
    return max(free)


def drawn(costs: CampaignCosts, cases: int, predictions: str) -> dict[str, float]:
    """Return the seconds of so many cases by name, drawn from those that were measured."""
    evenly = np.random.default_rng(1).uniform(0, QUANTILES - 1, cases)
    seconds = np.interp(evenly, np.arange(QUANTILES), costs.worker[predictions])
    return {f"{k:07d}": float(each) for k, each in enumerate(seconds)}


def simulated(costs: CampaignCosts, cases: int, shards: int, workers: int, predictions: str) -> SimulatedCampaign:
    """Deal cases out to shards as a run with --costs does, and let them run."""
    seconds = drawn(costs, cases, predictions)
    ends = (judged([seconds[name] for name in sorted(part)], workers, costs.main) for part in balanced(seconds, shards))
    return SimulatedCampaign(cases, shards, workers, predictions, max(ends))


def on_paper(costs: CampaignCosts, plan: SimulatedCampaign) -> float:
    """Return the seconds that the workers of a shard need for its cases, or its main process for its part of them."""
    share = plan.cases / plan.shards
    return share * max((costs.mean(plan.predictions) + costs.main) / plan.workers, costs.main)
