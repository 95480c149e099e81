"""What is drawn of a history: a line of text for the terminal, the marks of a case for pages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lammps_cases.records.outcome import CaseOutcome
from lammps_cases.records.wording import counted
from lammps_cases.report.history.views import CaseView

_BARS = "▁▂▃▄▅▆▇█"
FLOOR = -4  # decade below which errors are not distinguished


@dataclass(frozen=True)
class RunMark:
    """A mark: its column's label and lesser label, kind of verdict, difference/bound, what a pointer over it says."""

    label: str
    under: str
    kind: str
    ratio: float | None
    says: str


def spark(values: Sequence[float | None], logarithmic: bool = False) -> str:
    """Draw a line of bars, lowest to highest; ``·`` for nothing, ``×`` for what is not finite."""
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


def mark(label: str, day: str, when: str, outcome: CaseOutcome) -> RunMark:
    """Return the mark of an outcome on an engine; ``when`` says in full of which runs it is."""
    field = f", worst in {outcome.worst_field}" if outcome.worst_field else ""
    return RunMark(label, day, outcome.kind, outcome.worst, f"{label}, {when}: {outcome.kind}{field}")


def points(view: CaseView) -> list[RunMark]:
    """Return a mark for every span of a case."""
    return [
        mark(span.label, span.since[:10], f"{span.days}, {counted(span.lammps.count, 'run')}", span.outcome)
        for span in view.spans
    ]
