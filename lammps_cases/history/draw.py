"""Pictures of a history: a line of text for the terminal, SVG for pages. Colours are those of the page's verdicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape

from lammps_cases.history.views import CaseView, Spread
from lammps_cases.records.wording import counted, number, size

_BARS = "▁▂▃▄▅▆▇█"
_SLOT, _LEFT, _TOP = 112, 58, 8  # pixels: of a point along x, of the axis' labels, above the plot
_APART = 12  # pixels between two labels of an axis
_FLOOR = -4  # decade below which errors are not told apart


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
    return max(_FLOOR, math.log10(value)) if value > 0 else float(_FLOOR)


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


@dataclass(frozen=True)
class _Axis:
    """Decades of difference/bound over the height of a picture.

    No difference lies at the foot, and so does what has no error; what is not finite lies at the head.
    """

    low: int
    high: int
    height: int

    @classmethod
    def of(cls, marks: Sequence[Point], height: int) -> _Axis:
        finite = [math.log10(m.ratio) for m in marks if m.ratio and math.isfinite(m.ratio)]
        low, high = min(finite, default=0.0), max(finite, default=0.0)
        return cls(max(_FLOOR, math.floor(min(low, -1.0))), math.ceil(max(high, 1.0)), height)

    def y(self, ratio: float | None) -> float:
        """Pixels from the top."""
        if not ratio:
            return self.height
        if not math.isfinite(ratio):
            return _TOP
        foot, head = self.height - 14, _TOP + 12
        return foot - (foot - head) * (max(self.low, math.log10(ratio)) - self.low) / (self.high - self.low)


def errors(marks: Sequence[Point], height: int = 130) -> str:
    """Difference/bound of every mark on a log axis, with the bound as a line."""
    axis, count = _Axis.of(marks, height), len(marks)
    lines = _lines(axis, count, any(size(m.ratio) == math.inf for m in marks))
    at = [(_x(k), axis.y(m.ratio)) for k, m in enumerate(marks)]
    path = f'<polyline points="{" ".join(f"{x:g},{y:.1f}" for x, y in at)}"/>' if count > 1 else ""
    dots = "".join(_dot(f"v-{m.kind.replace(' ', '-')}", x, y, _title(m)) for m, (x, y) in zip(marks, at, strict=True))
    labels = _labels(tuple((m.label, m.under) for m in marks), height)
    return _svg("difference/bound by version", lines + path + dots + labels, count, height)


@lru_cache(maxsize=256)  # most cases of a report have the same
def _lines(axis: _Axis, count: int, infinite: bool) -> str:
    step = max(1, math.ceil((axis.high - axis.low) * 32 / axis.height))
    fixed = axis.y(1.0), axis.y(0.0)
    clear = [k for k in range(axis.low, axis.high + 1, step) if min(abs(axis.y(10.0**k) - y) for y in fixed) > _APART]
    lines = [_tick(axis.y(10.0**k), f"1e{k}", count) for k in clear]
    lines += [_tick(fixed[0], "bound", count, "limit"), _tick(fixed[1], "0", count)]
    return "".join([*lines, _tick(_TOP, "∞, nan", count)] if infinite else lines)


def times(spreads: dict[str, Spread], height: int = 70) -> str:
    """Median of LAMMPS' seconds of every engine, with their range."""
    top = max((spread.high for spread in spreads.values()), default=0.0) or 1.0

    def y(seconds: float) -> float:
        return height - (height - _TOP) * seconds / top

    parts = [_tick(y(top), f"{top:.2g} s", len(spreads)), _tick(height, "0", len(spreads))]
    for k, (label, spread) in enumerate(spreads.items()):
        told = f"{label}: {spread.median:.3g} s"
        if spread.count > 1:
            told += f", {spread.low:.3g} to {spread.high:.3g} s in {spread.count} runs"
        bar = f'<line class="range" x1="{_x(k)}" x2="{_x(k)}" y1="{y(spread.low):.1f}" y2="{y(spread.high):.1f}"/>'
        parts.append(bar + _dot("time", _x(k), y(spread.median), escape(told)))
    labels = _labels(tuple((label, counted(s.count, "run")) for label, s in spreads.items()), height)
    return _svg("seconds in LAMMPS by version", "".join(parts) + labels, len(spreads), height)


def _x(k: int) -> float:
    return _LEFT + _SLOT * (k + 0.5)


def _tick(y: float, label: str, count: int, kind: str = "") -> str:
    named = f' class="{kind}"' if kind else ""
    line = f'<path{named} d="M{_LEFT} {y:.1f}h{_SLOT * count}"/>'
    return f'{line}<text class="y" x="{_LEFT - 6}" y="{y + 4:.1f}">{label}</text>'


def _dot(kind: str, x: float, y: float, title: str) -> str:
    return f'<circle class="{kind}" cx="{x:g}" cy="{y:.1f}" r="5"><title>{title}</title></circle>'


@lru_cache(maxsize=256)
def _labels(columns: tuple[tuple[str, str], ...], height: int) -> str:
    """A label, once for neighbours that have the same, and a lesser one below."""
    parts = []
    for k, (label, under) in enumerate(columns):
        if not k or columns[k - 1][0] != label:
            parts.append(f'<text x="{_x(k):g}" y="{height + 17}">{escape(label)}</text>')
        parts.append(f'<text class="under" x="{_x(k):g}" y="{height + 31}">{escape(under)}</text>')
    return "".join(parts)


def _title(mark: Point) -> str:
    error = "" if mark.ratio is None else f", difference/bound {number(mark.ratio)}"
    return escape(mark.says + error)


def _svg(name: str, inside: str, count: int, height: int) -> str:
    width, tall = _LEFT + _SLOT * count + 8, height + 38
    size = f'width="{width}" height="{tall}" viewBox="0 0 {width} {tall}"'
    return f'<svg class="past" role="img" aria-label="{name}" {size}>{inside}</svg>'
