"""Wall times and their statistics. Nothing here depends on the speed of the machine."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from scipy.stats import quantile_test

from lammps_cases.records.measure import (
    CONFIDENCE,
    ConfidenceInterval,
    Timing,
    in_turns,
    interval,
    machine,
    verdict,
)

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 8, 9, 12, 20, 51, 100])
def test_interval_has_the_stated_coverage_of_the_median(n: int) -> None:
    """Order statistics: the ends' ranks miss the median with at most 5 % probability, and the next narrower do not.

    It is the interval of `scipy.stats.quantile_test`, which begins with six values.
    """

    def missed(k: int) -> float:
        return float(2 * sum(math.comb(n, i) for i in range(k)) / 2**n)

    found = interval(tuple(float(k) for k in range(1, n + 1)))
    rank = round(found.low)
    assert (found.median, found.high) == ((n + 1) / 2, n + 1 - rank)
    assert rank == 1 or missed(rank) <= 1 - CONFIDENCE
    assert missed(rank + 1) > 1 - CONFIDENCE or rank + 1 > n // 2
    random = np.random.default_rng(n)
    for values in (random.standard_cauchy(n), random.integers(0, 4, n).astype(float)):
        found = interval(tuple(values.tolist()))
        assert min(values) <= found.low <= found.median <= found.high <= max(values)
        if n >= 6:
            expected = quantile_test(values).confidence_interval(CONFIDENCE)
            assert (found.low, found.high) == (expected.low, expected.high)


def test_common_drift_cancels_in_the_ratio() -> None:
    """Times grow tenfold over the rounds: medians alone cannot resolve 5 %, ratios per round can."""
    drift = np.geomspace(1.0, 10.0, 15)
    fast, slow = (Timing(tuple((factor * drift).tolist()), 1, 0.0) for factor in (1.0, 1.05))
    assert verdict(fast.against(slow)) == "faster"
    assert verdict(slow.against(fast)) == "slower"
    assert verdict(fast.against(fast)) == "cannot tell"
    assert fast.seconds.low < slow.seconds.low < fast.seconds.high  # not separable without the pairing


def test_all_are_called_in_every_round_in_varying_order() -> None:
    called: list[str] = []
    found = in_turns({name: (lambda name=name: called.append(name)) for name in "abc"}, rounds=6, at_least=0.0)
    assert set(found) == set("abc")
    assert all(len(timing.seconds_r) == 6 and timing.calls == 1 for timing in found.values())
    rounds = ["".join(called[k : k + 3]) for k in range(6, len(called), 3)]  # after 3 first calls and 3 for calibration
    assert all(sorted(turn) == ["a", "b", "c"] for turn in rounds)
    assert len(set(rounds)) > 2
    assert max(Counter(turn[0] for turn in rounds).values()) < 6


def test_quick_calls_are_repeated_until_they_last() -> None:
    count = Counter[str]()
    found = in_turns({"quick": lambda: count.update("q")}, rounds=2, at_least=1e-3)
    assert found["quick"].calls > 1
    assert count["q"] > 2 * found["quick"].calls


@pytest.mark.parametrize(
    ("low", "high", "answer"),
    [(0.8, 0.9, "faster"), (1.1, 1.2, "slower"), (0.9, 1.1, "cannot tell"), (1.0, 1.2, "cannot tell")],
)
def test_verdict(low: float, high: float, answer: str) -> None:
    assert verdict(ConfidenceInterval((low + high) / 2, low, high)) == answer


def test_the_machine_is_named() -> None:
    found = machine()
    assert found["processor"]
    assert int(found["cores"]) >= 1
