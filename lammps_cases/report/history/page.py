"""``history.html``, or ``cases.html`` for some cases: runs, changes, and results of cases; opens offline.

Figures show how the errors and the times of a case went by version.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import brief, counted, number
from lammps_cases.report.history.views import (
    FLOOR,
    CaseView,
    RunLine,
    RunMark,
    Spread,
    changed_findings,
    points,
    steps,
)
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.figures import DIFFERS, FAINT, LINK, OF, PAPER, THEMED, plain_text, themed

ASSETS = Path(__file__).parent / "assets"
_INCH = 96.0  # pixels of a page
_SLOT, _LEFT, _FOOT = 112, 66, 40  # pixels: of a point along x, of the labels of either axis
_MARK: Any = {"marker": "o", "ls": "none", "ms": 8, "mec": PAPER, "mew": 1.1, "zorder": 3, "clip_on": False}


def write(
    folder: Path, lines: Sequence[RunLine], views: Sequence[CaseView], labels: Sequence[str], pictured: bool
) -> Path:
    """Write the page of some runs and cases; with pictures of every case, or only the changes."""
    pictures = []
    if pictured:
        for view in views:
            errors = error_figure(points(view), f"errors-{view.case}")
            pictures.append((view, errors, time_figure(view.times, f"times-{view.case}")))
    html = frame.page(
        ASSETS,
        "history",
        lines=lines,
        labels=labels,
        steps=[step for label in labels for step in steps(views) if step.engine == label],
        changed=[view for view in views if pictured or view.changes],
        total=len(views),
        pictures=pictures,
        filters={"findings": changed_findings, "error": lambda ratio: "=" if ratio == 0 else brief(ratio)},
    )
    path = folder / ("cases.html" if pictured else "history.html")
    write_atomically(path, html)
    return path


def error_figure(marks: Sequence[RunMark], name: str, height: int = 130) -> Markup:
    """Draw difference/bound of every mark on a log axis, with the bound as a line.

    Zero differences and marks without an error lie at the bottom, infinite and NaN ones at the top.
    """
    decades = [math.log10(m.ratio) for m in marks if m.ratio and math.isfinite(m.ratio)]
    low = max(FLOOR, math.floor(min([*decades, -1.0])))
    high = math.ceil(max([*decades, 1.0]))
    at = [_height(m.ratio, low, high) for m in marks]
    with matplotlib.rc_context(THEMED):
        figure, axis = _empty([(m.label, m.under) for m in marks], height)
        step = max(1, math.ceil((high - low) * 32 / height))
        ticks = {float(k): f"1e{k}" for k in range(low, high + 1, step) if k} | {0.0: "bound", low - 1.0: "0"}
        ticks |= {high + 1.0: "∞, nan"} if max(at) > high else {}
        axis.set_yticks(list(ticks), list(ticks.values()))
        axis.set_ylim(low - 1.0, max(ticks))
        axis.axhline(0.0, color=DIFFERS, ls="--", lw=1, gid="limit")
        axis.plot(range(len(at)), at, color=FAINT, lw=0.8)
        for k, y in enumerate(at):
            axis.plot([k], [y], gid=f"mark-{k}", mfc=OF, **_MARK)
    titles = {}
    for k, m in enumerate(marks):
        ratio = "" if m.ratio is None else f", difference/bound {number(m.ratio)}"
        titles[f"mark-{k}"] = f"v-{m.kind.replace(' ', '-')}", m.says + ratio
    return themed(figure, name, "difference/bound by version", titles)


def time_figure(spreads: dict[str, Spread], name: str, height: int = 70) -> Markup:
    """Draw the median of LAMMPS' seconds of every engine, with their range."""
    top = max((spread.high for spread in spreads.values()), default=0.0) or 1.0
    titles = {}
    with matplotlib.rc_context(THEMED):
        figure, axis = _empty([(label, counted(spread.count, "run")) for label, spread in spreads.items()], height)
        axis.set_yticks([0.0, top], ["0", f"{top:.2g} s"])
        axis.set_ylim(0.0, top)
        for k, (label, spread) in enumerate(spreads.items()):
            axis.plot([k, k], [spread.low, spread.high], color=LINK, lw=1.6, gid=f"range-{k}")
            axis.plot([k], [spread.median], gid=f"mark-{k}", mfc=LINK, **_MARK)
            title = f"{label}: {spread.median:.3g} s"
            if spread.count > 1:
                title += f", {spread.low:.3g} to {spread.high:.3g} s in {spread.count} runs"
            titles[f"mark-{k}"] = "time", title
    return themed(figure, name, "seconds in LAMMPS by version", titles)


def _empty(columns: Sequence[tuple[str, str]], height: int) -> tuple[Figure, Any]:
    """Return a figure with a slot for every column: a label, once for equal neighbours, and a secondary one below."""
    width, tall = _LEFT + _SLOT * len(columns) + 8, height + _FOOT
    figure = Figure(figsize=(width / _INCH, tall / _INCH))
    axis = figure.add_axes((_LEFT / width, _FOOT / tall, 1 - (_LEFT + 8) / width, 1 - (_FOOT + 10) / tall))
    axis.spines[["left", "bottom"]].set_visible(False)
    axis.grid(False, axis="x")
    axis.tick_params(length=0)
    axis.set_xlim(-0.5, len(columns) - 0.5)
    repeated = [bool(k) and columns[k - 1][0] == label for k, (label, _) in enumerate(columns)]
    labels = ["" if again else plain_text(label) for again, (label, _) in zip(repeated, columns, strict=True)]
    axis.set_xticks(range(len(columns)), labels)
    for k, (_, under) in enumerate(columns):
        place: Any = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "xytext": (0, -26)}
        axis.annotate(plain_text(under), (k, 0), ha="center", color=FAINT, fontsize=8, **place)
    return figure, axis


def _height(ratio: float | None, low: int, high: int) -> float:
    if not ratio:
        return low - 1.0
    return max(float(low), math.log10(ratio)) if math.isfinite(ratio) else high + 1.0
