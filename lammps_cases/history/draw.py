"""What is drawn of a history: a line of text for the terminal, the marks of a case for pages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lammps_cases.history.views import CaseView
from lammps_cases.records.wording import counted

_BARS = "▁▂▃▄▅▆▇█"
FLOOR = -4  # decade below which errors are not told apart


@dataclass(frozen=True)
class Point:
    """A mark: its column's label and lesser label, kind of verdict, difference/bound, what a pointer over it says."""

    label: str
    under: str
    kind: str
    ratio: float | None
    says: str


def spark(values: Sequence[float | None], logarithmic: bool = False) -> str:
    """A line of bars, lowest to highest; ``·`` for nothing, ``×`` for what is not finite."""
    scaled = [_scaled(value, logarithmic) for value in values]
    finite = [value for value in scaled if value is not None and math.isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=0.0)

    def bar(value: float | None) -> str:
        if value is None:
            return "·"
        if not math.isfinite(value):
            return "×"
        return _BARS[round((len(_BARS) - 1) * (value - low) / (high - low))] if high > low else _BARS[0]

    return "".join(map(bar, scaled))


def _scaled(value: float | None, logarithmic: bool) -> float | None:
    if value is None or not logarithmic or not math.isfinite(value):
        return value
    return max(FLOOR, math.log10(value)) if value > 0 else float(FLOOR)


def points(view: CaseView) -> list[Point]:
    """A mark for every span of a case."""
    found = []
    for span in view.spans:
        ended = span.outcome
        days = span.since[:10] if span.since[:10] == span.until[:10] else f"{span.since[:10]} to {span.until[:10]}"
        field = f", worst in {ended.worst_field}" if ended.worst_field else ""
        says = f"{span.label}, {days}, {counted(span.lammps.count, 'run')}: {ended.kind}{field}"
        found.append(Point(span.label, span.since[:10], ended.kind, ended.worst, says))
    return found
