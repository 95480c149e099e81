"""Pictures of stability maps: where each kind of failure begins, on both engines; particles just before it."""

from __future__ import annotations

import io
import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator
from matplotlib.transforms import ScaledTranslation

from eos_ref.eos.table import FloatArray
from eos_ref.model.box import BoolArray
from lammps_cases.report.pages.figures import BLUE, GREY, RED, STYLE, plain_log_axis, plain_text
from lammps_cases.scene.atoms import IntArray
from lammps_cases.studies.stability.model import (
    KINDS,
    Axis,
    Boundary,
    CellRun,
    Engine,
    Kind,
    MapCell,
    MapRecord,
    Theory,
)

# Colours of Okabe & Ito (2008), which colour-blind readers can distinguish, and a separate shape for every kind.
MARKS: dict[Kind, tuple[str, str]] = {
    "stable": ("#c9d3dc", "o"),
    "lost digits": ("#009e73", "d"),
    "misclassified surface": ("#56b4e9", "s"),
    "ill-conditioned matrix": ("#e69f00", "^"),
    "failed matrix": ("#d55e00", "v"),
    "loss of hyperbolicity": ("#0072b2", "D"),
    "negative pressure": ("#56b4e9", "d"),
    "clumping": ("#009e73", "p"),
    "overlap": ("#009e73", "P"),
    "energy growth": ("#d55e00", "o"),
    "wall penetration": ("#cc79a7", ">"),
    "vanishing density": ("#f0e442", "<"),
    "negative density": ("#f0e442", "v"),
    "overflow": ("#cc79a7", "*"),
    "non-finite": ("#000000", "X"),
    "lost particles": ("#0072b2", "h"),
    "error": ("#7a8590", "s"),
    "crash": ("#000000", "*"),
    "hang": ("#000000", "8"),
}
EDGE = "#2b3137"
ENGINE_COLOURS: dict[Engine, str] = {"lammps": RED, "reference": BLUE}
# Lines of theory, by dashes and by shade.
_LINES: tuple[dict[str, Any], ...] = (
    {"ls": "--", "color": "#2b3137"},
    {"ls": ":", "color": "#2b3137", "lw": 1.6},
    {"ls": "-.", "color": "#7b4fa3"},
    {"ls": (0, (6, 2, 1, 2, 1, 2)), "color": "#2e8b57"},
    {"ls": (0, (1, 2.5)), "color": "#8c5a3c", "lw": 1.8},
)
Link = Callable[[MapCell], str]
Places = dict[tuple[float, float], dict[Engine, Kind]]


def map_figure(drawn: MapRecord, theory: Sequence[Theory] = (), link: Link = lambda cell: cell.anchor) -> Figure:
    """Draw LAMMPS, the reference, and where they differ, side by side; a row of pictures for each layer.

    Parameters
    ----------
    drawn : MapRecord
    theory : sequence of Theory
        Drawn over the layers they belong to.
    link : callable
        Address of a cell.
    """
    ran, boundaries = drawn.cells, drawn.boundaries
    layers = [layer for layer in drawn.layers if any(r.cell.layer == layer for r in ran)] or list(drawn.layers[:1])
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(11.6, 2.75 * len(layers) + 0.5), layout="constrained")
        axes = figure.subplots(len(layers), 3, squeeze=False, sharex=True, sharey=True)
        for row, layer in zip(axes, layers, strict=True):
            of_layer = [r for r in ran if r.cell.layer == layer]
            lines = [b for b in boundaries if b.layer == layer]
            for axis, engine in zip(row, ("lammps", "reference"), strict=False):
                _draw_boundaries(axis, drawn, [b for b in lines if b.engine == engine])
                own = [r for r in of_layer if r.engine == engine]
                _draw_cells(axis, own, link, f"{engine}-{layers.index(layer)}")
                if not own:
                    axis.text(0.5, 0.5, "not run", transform=axis.transAxes, ha="center", color=GREY)
            _draw_difference(row[2], drawn, of_layer, lines, link)
            titles = ("LAMMPS", "reference", "where they differ")
            for axis, title in zip(row, titles, strict=True):
                _draw_theory(axis, drawn, [t for t in theory if t.layer in (None, layer)], theory)
                axis.set_title(plain_text(f"{title}: {layer}" if layer else title))
        for axis in axes.ravel():
            _scale(axis, drawn)
        figure.supxlabel(_label(drawn.x), fontsize=9)
        figure.supylabel(_label(drawn.y), fontsize=9)
        figure.legend(handles=_legend(theory, ran), loc="outside right center", frameon=False, fontsize=8)
        return figure


def _label(axis: Axis) -> str:
    return plain_text(f"{axis.name} (log)" if axis.log else axis.name)


def _scale(axis: Any, drawn: MapRecord) -> None:
    axis.set_xlim(*_margins(drawn.x))
    axis.set_ylim(*_margins(_heights(drawn)))
    for scale, own in ((axis.xaxis, drawn.x), (axis.yaxis, drawn.y)):
        if own.log:
            plain_log_axis(scale)
            scale.set_minor_locator(NullLocator())


def _heights(drawn: MapRecord) -> Axis:
    """Return the range of the vertical axis in which lines were run; all of it for a single line."""
    low, high = min(drawn.lines), max(drawn.lines)
    return drawn.y if low == high else replace(drawn.y, low=low, high=high)


def _margins(axis: Axis) -> tuple[float, float]:
    """Return the limits of an axis, with room for the marks at its ends."""
    if axis.log:
        room = (axis.high / axis.low) ** 0.05
        return axis.low / room, axis.high * room
    spread = 0.05 * (axis.high - axis.low)
    return axis.low - spread, axis.high + spread


def _draw_cells(axis: Any, ran: Sequence[CellRun], link: Link, name: str) -> None:
    for k, kind in enumerate(KINDS):
        cells = [r.cell for r in ran if r.outcome.kind == kind]
        if not cells:
            continue
        colour, shape = MARKS[kind]
        style = {"c": colour, "marker": shape, "linewidths": 0.7, "edgecolors": EDGE, "zorder": 3}
        marks = axis.scatter([c.x for c in cells], [c.y for c in cells], s=26 if kind == "stable" else 44, **style)
        # A single address would be dropped: one more than the cells keeps one per cell.
        marks.set_urls([*(link(c) for c in cells), ""])
        marks.set_gid(f"{name}-{k}")


def _draw_boundaries(axis: Any, drawn: MapRecord, boundaries: Sequence[Boundary], colour: str = GREY) -> None:
    """Draw bands between low and high, joined over neighbouring lines where the same kinds meet."""
    for chain in chains(drawn, boundaries):
        low, high, y = ([getattr(b, name) for b in chain] for name in ("low", "high", "y"))
        axis.fill_betweenx(y, low, high, color=colour, alpha=0.25, lw=0, zorder=1)
        axis.plot([drawn.x.middle(b.low, b.high) for b in chain], y, color=colour, lw=1.0, alpha=0.8, zorder=1)
        for b in chain:
            axis.plot([b.low, b.high], [b.y, b.y], color=colour, lw=3, alpha=0.5, solid_capstyle="butt", zorder=1)


def chains(drawn: MapRecord, boundaries: Sequence[Boundary]) -> list[list[Boundary]]:
    """Return the boundaries between the same kinds, from line to line; a line without one ends the chain."""
    heights = sorted({b.y for b in boundaries} | set(drawn.lines))
    by_kinds: dict[tuple[Kind, Kind, int], dict[float, Boundary]] = defaultdict(dict)
    for y in heights:
        count: dict[tuple[Kind, Kind], int] = defaultdict(int)
        for b in sorted((b for b in boundaries if b.y == y), key=lambda b: b.low):
            by_kinds[b.below, b.above, count[b.below, b.above]][y] = b
            count[b.below, b.above] += 1
    parts = []
    for by_height in by_kinds.values():
        for present, group in itertools.groupby(heights, key=by_height.__contains__):
            if present:
                parts.append([by_height[y] for y in group])
    return parts


def _draw_difference(
    axis: Any, drawn: MapRecord, ran: Sequence[CellRun], boundaries: Sequence[Boundary], link: Link
) -> None:
    """Draw both boundaries, and the cells of both engines: small and grey where they agree, in both colours if not."""
    for engine, colour in ENGINE_COLOURS.items():
        _draw_boundaries(axis, drawn, [b for b in boundaries if b.engine == engine], colour)
    for (x, y), kinds in places(ran).items():
        if len(kinds) < 2:
            continue
        if len(set(kinds.values())) == 1:
            axis.plot([x], [y], "o", ms=2.5, color=GREY, zorder=2)
            continue
        cell = next(r.cell for r in ran if (r.cell.x, r.cell.y) == (x, y))
        # Each engine's own mark, LAMMPS' on the left.
        for engine, shift in (("lammps", -4), ("reference", 4)):
            colour, shape = MARKS[kinds[engine]]
            offset = ScaledTranslation(shift / 72, 0, axis.figure.dpi_scale_trans)
            [mark] = axis.plot([x], [y], shape, ms=6.5, mfc=colour, mec=ENGINE_COLOURS[engine], mew=1.3, zorder=4)
            mark.set_transform(axis.transData + offset)
            mark.set_url(link(cell))


def places(ran: Iterable[CellRun]) -> Places:
    """Return the kinds by place and engine."""
    by_place: Places = defaultdict(dict)
    for r in ran:
        by_place[r.cell.x, r.cell.y][r.engine] = r.outcome.kind
    return dict(by_place)


def _draw_theory(axis: Any, drawn: MapRecord, here: Sequence[Theory], theory: Sequence[Theory]) -> None:
    low, high = _margins(_heights(drawn))
    heights = np.geomspace(low, high, 101) if drawn.y.log else np.linspace(low, high, 101)
    styles = _styles(theory)
    for line in here:
        x = [_value(line.x_of_y, float(y)) for y in heights]
        axis.plot(x, heights, **{"lw": 1.2, "zorder": 2, **styles[line.name]})


def _styles(theory: Sequence[Theory]) -> dict[str, dict[str, Any]]:
    """Return the style of every line: the same for those of one name in several layers."""
    named = dict.fromkeys(line.name for line in theory)
    return dict(zip(named, itertools.cycle(_LINES), strict=False))


def _value(x_of_y: Callable[[float], float], y: float) -> float:
    try:
        return float(x_of_y(y))
    except (ArithmeticError, ValueError):
        return math.nan


def _legend(theory: Sequence[Theory], ran: Sequence[CellRun]) -> list[Line2D | Patch]:
    kinds = {r.outcome.kind for r in ran}
    handles: list[Line2D | Patch] = []
    for kind, (colour, shape) in MARKS.items():
        if kind in kinds:
            size = 5 if kind == "stable" else 7
            handles.append(Line2D([], [], marker=shape, ls="none", mfc=colour, mec=EDGE, mew=0.7, ms=size, label=kind))
    handles.append(Patch(color=GREY, alpha=0.4, lw=0, label="boundary, uncertainty"))
    for name, style in _styles(theory).items():
        handles.append(Line2D([], [], label=plain_text(name), **{"lw": 1.2, **style}))
    handles.append(Line2D([], [], ls="none", label="where they differ:"))
    for colour, engine in ((RED, "LAMMPS"), (BLUE, "reference")):
        handles.append(Patch(color=colour, alpha=0.4, lw=0, label=engine))
    handles.append(Line2D([], [], marker="o", ls="none", color=GREY, ms=2.5, label="same kind"))
    return handles


# --- particles


def thumbnail(
    x_nc: FloatArray,
    colour_n: FloatArray,
    failing_n: IntArray,
    low_c: Sequence[float],
    high_c: Sequence[float],
    by_type: bool = False,
) -> bytes:
    """Draw particles as a small PNG, those that fail in a ring.

    Parameters
    ----------
    x_nc : (n, 2 or more)
        Positions; the first two coordinates are drawn.
    colour_n : (n,)
        Density, or type.
    failing_n : (k,)
        Places of the failing ones in the arrays.
    low_c, high_c : two or more each
        The box.
    by_type : bool
        Whether the colours are of types.
    """
    with matplotlib.rc_context(STYLE):
        wide, high = (max(float(b - a), 1e-300) for a, b in zip(low_c[:2], high_c[:2], strict=True))
        longest = max(wide, high)
        figure = Figure(figsize=(max(1.7 * wide / longest, 0.5), max(1.7 * high / longest, 0.5)))
        axis = figure.add_axes((0, 0, 1, 1))
        axis.set(xlim=(low_c[0], high_c[0]), ylim=(low_c[1], high_c[1]))
        axis.set_axis_off()
        good_n: BoolArray = np.asarray(np.isfinite(x_nc[:, :2]).all(axis=1))
        area = figure.get_figwidth() * figure.get_figheight()
        size = float(np.clip(0.35 * 72**2 * area / max(len(x_nc), 1), 1.5, 60))
        colours: dict[str, Any] = {"cmap": "tab10", "vmin": 0.5, "vmax": 10.5} if by_type else {"cmap": "cividis"}
        finite_n = np.where(np.isfinite(colour_n), colour_n, 0.0)
        axis.scatter(x_nc[good_n, 0], x_nc[good_n, 1], s=size, c=finite_n[good_n], linewidths=0, **colours)
        ringed_n = failing_n[good_n[failing_n]]
        ring: dict[str, Any] = {"facecolors": "none", "edgecolors": RED, "linewidths": 1.8}
        axis.scatter(x_nc[ringed_n, 0], x_nc[ringed_n, 1], s=2.5 * size + 40, **ring)
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=100, metadata={"Software": None})
    return file.getvalue()
