"""Comparable wall times: alternatives called in turns, in calibrated loops, medians with intervals.

A machine drifts (clock, other work), so that later measurements differ. Alternatives are therefore
called in rounds, each once per round and in an order that rotates from round to round, and compared round by round: the
ratio of two times of one round is free of the drift.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from statistics import median
from timeit import timeit
from typing import Literal

Call = Callable[[], object]
Answer = Literal["faster", "slower", "cannot tell"]
ROUNDS = 9  # the least number whose median has a 95 % interval narrower than the range
CONFIDENCE = 0.95


@dataclass(frozen=True)
class ConfidenceInterval:
    """A median and its 95 % confidence interval."""

    median: float
    low: float
    high: float

    def scaled(self, factor: float) -> ConfidenceInterval:
        """Return the interval times a positive number."""
        return ConfidenceInterval(self.median * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True)
class Timing:
    """Wall times of one alternative.

    Attributes
    ----------
    seconds_r : seconds of one call, in every round
    calls : calls per round
    first : seconds of the very first call, which may compile and load
    """

    seconds_r: tuple[float, ...]
    calls: int
    first: float

    @cached_property
    def seconds(self) -> ConfidenceInterval:
        """Median time of one call."""
        return interval(self.seconds_r)

    def scaled(self, factor: float) -> Timing:
        """Return the wall times of more work by a factor; the first call is not changed."""
        return Timing(tuple(factor * seconds for seconds in self.seconds_r), self.calls, self.first)

    def against(self, other: Timing) -> ConfidenceInterval:
        """Return the ratio of this time to another one of the same rounds."""
        return interval(tuple(a / b for a, b in zip(self.seconds_r, other.seconds_r, strict=True)))


def interval(values: tuple[float, ...]) -> ConfidenceInterval:
    r"""Return the median and its distribution-free confidence interval.

    The k-th smallest and k-th largest of n independent values enclose the median with probability
    :math:`1 - 2^{1-n}\sum_{i<k}\binom ni`; the largest k that still gives 95 % is taken. Fewer than six values do not
    reach 95 %: the interval is then their range.
    """
    from scipy.stats import binom  # heavy, and every run imports this module

    ordered = sorted(values)
    # Of `scipy.stats.quantile_test` this is the confidence interval, a hundred times as fast.
    k = max(1, int(binom.ppf((1 - CONFIDENCE) / 2, len(values), 0.5)))
    return ConfidenceInterval(median(ordered), ordered[k - 1], ordered[-k])


def effort(quick: bool) -> tuple[int, float]:
    """Return the rounds and the least seconds of a measurement for `in_turns`: a quick one, or one to be kept."""
    return (6, 0.004) if quick else (ROUNDS, 0.02)


def in_turns(calls: Mapping[str, Call], rounds: int = ROUNDS, at_least: float = 0.02) -> dict[str, Timing]:
    """Time alternatives against each other.

    Parameters
    ----------
    calls : mapping
        The alternatives, by name.
    rounds : int
        How often each is measured.
    at_least : float
        Seconds that one measurement lasts at least; a quicker call is repeated within it.
    """
    first, repeats = {}, {}
    for name, call in calls.items():
        first[name] = timeit(call, number=1)
        repeats[name] = _calibrated(call, at_least)
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    names = list(calls)
    for turn in range(rounds):
        start = turn % len(names)
        order = names[start:] + names[:start]
        for name in order if turn % 2 == 0 else order[::-1]:
            seconds[name].append(timeit(calls[name], number=repeats[name]) / repeats[name])
    return {name: Timing(tuple(seconds[name]), repeats[name], first[name]) for name in names}


def _calibrated(call: Call, at_least: float) -> int:
    """Return the number of calls that last long enough, by doubling, which also warms up."""
    repeats = 1
    while (seconds := timeit(call, number=repeats)) < at_least / 2 and repeats < 2**20:
        repeats = max(2 * repeats, min(int(repeats * at_least / max(seconds, 1e-9)) // 2, 64 * repeats))
    return repeats


def verdict(ratio: ConfidenceInterval) -> Answer:
    """Compare two times by their ratio: an interval that holds 1 is inconclusive."""
    return "faster" if ratio.high < 1 else "slower" if ratio.low > 1 else "cannot tell"


def cpuinfo() -> dict[str, str]:
    """Return Linux' description of the first processor, by key; empty on other systems."""
    facts: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            key, _, value = line.partition(":")
            facts.setdefault(key.strip(), value.strip())
    except OSError:
        pass
    return facts


def machine() -> dict[str, str | float | int]:
    """Describe the machine that measures, and its load."""
    return {
        "processor": cpuinfo().get("model name") or platform.processor() or platform.machine(),
        "cores": os.cpu_count() or 1,
        "load": round(os.getloadavg()[0], 2),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
    }
