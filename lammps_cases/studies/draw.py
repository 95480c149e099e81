"""Panels of curves, as values, and the one way to draw them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from lammps_cases.report.pages.figures import STYLE, plain_log_axis, plain_text


@dataclass(frozen=True)
class Curve:
    """A line, or marks, of one side.

    Attributes
    ----------
    label : in the legend, where each label stands once; empty for a curve that needs none
    style : keywords of matplotlib's ``plot``
    low, high : intervals of x, drawn as bars
    texts : at the points
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    style: Mapping[str, Any] = field(default_factory=dict)
    low: Sequence[float] = ()
    high: Sequence[float] = ()
    texts: Sequence[str] = ()


@dataclass(frozen=True)
class Panel:
    """Curves over common axes; ``log`` names the logarithmic ones, ``ticks`` are the only ones along x."""

    x: str
    y: str
    curves: Sequence[Curve]
    title: str = ""
    log: str = ""
    ticks: Sequence[float] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def figure(
    panels: Sequence[Panel],
    columns: int = 3,
    size: tuple[float, float] = (3.5, 2.9),
    share: bool = False,
    further: Sequence[Line2D] = (),
) -> Figure:
    """Draw panels in rows, with one legend at the right that holds every label once.

    Parameters
    ----------
    columns : int
        Panels of a row.
    size : tuple of float
        Of a panel (inches).
    share : bool
        Whether all panels have the same axes, whose names then stand once.
    further : sequence of Line2D
        Additional entries of the legend.
    """
    with matplotlib.rc_context(STYLE):
        columns = min(columns, len(panels))
        rows = -(-len(panels) // columns)
        labels: dict[str, Any] = {}
        for curve in (curve for panel in panels for curve in panel.curves if curve.label):
            labels.setdefault(curve.label, Line2D([], [], **curve.style))
        labels |= {str(line.get_label()): line for line in further}
        wide = 1 if len(labels) <= 16 * rows else 2
        drawn = Figure(figsize=(size[0] * columns + 1.9 * wide, size[1] * rows + 0.4), layout="constrained")
        axes = drawn.subplots(rows, columns, squeeze=False, sharex=share, sharey=share).ravel()
        for axis, panel in zip(axes, panels, strict=False):
            _draw(axis, panel, named=not share)
        for axis in axes[len(panels) :]:
            axis.set_visible(False)
        if share:
            drawn.supxlabel(plain_text(panels[0].x), fontsize=9)
            drawn.supylabel(plain_text(panels[0].y), fontsize=9)
        drawn.legend(
            list(labels.values()),
            [plain_text(label) for label in labels],
            loc="outside right center",
            frameon=False,
            fontsize=8,
            ncols=wide,
        )
        return drawn


def _draw(axis: Any, panel: Panel, named: bool) -> None:
    for curve in panel.curves:
        axis.plot(curve.x, curve.y, **curve.style)
        for low, high, y in zip(curve.low, curve.high, curve.y, strict=False):
            axis.plot([low, high], [y, y], color=curve.style["color"], lw=1)
        for x, y, text in zip(curve.x, curve.y, curve.texts, strict=False):
            axis.annotate(text, (x, y), xytext=(4, 4), textcoords="offset points", fontsize=7)
    axis.set(title=plain_text(panel.title), **{f"{name}lim": limits for name, limits in panel.limits.items()})
    if named:
        axis.set(xlabel=plain_text(panel.x), ylabel=plain_text(panel.y))
    for name in panel.log:
        axis.set(**{f"{name}scale": "log"})
        plain_log_axis(getattr(axis, f"{name}axis"))
    if panel.ticks:
        axis.set_xticks(panel.ticks, [f"{tick:g}" for tick in panel.ticks])
        axis.minorticks_off()
