"""Figures by matplotlib: one style, as elements of a page and as files."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lammps_cases.records.files import write_atomically

matplotlib.use("svg")
RED, BLUE, GREY = "#c0392b", "#1f5fa8", "#8a8f98"
# Stand-ins for colours of the style sheet, which follow the reader's light or dark mode; OF is that of a CSS class.
INK, FAINT, LINE, PAPER, DIFFERS, LINK, OF = (f"#0102{k:02x}" for k in range(7))
_NAMES = {INK: "ink", FAINT: "faint", LINE: "line", PAPER: "paper", DIFFERS: "differs", LINK: "link", OF: "of"}
_DARK = re.compile(r"#[0-3][0-9a-f][0-3][0-9a-f][0-3][0-9a-f]\b")
STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "svg.fonttype": "none",
    "svg.hashsalt": "eos-ref",  # the same bits on every run
}
THEMED: Any = STYLE | {
    "grid.color": LINE,
    "axes.edgecolor": LINE,
    "xtick.color": LINE,
    "ytick.color": LINE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": FAINT,
    "text.color": INK,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
}


def plain_log_axis(axis: Any) -> None:
    """Make an axis logarithmic, with few ticks, as plain numbers; its limits are set."""
    low, high = axis.get_view_interval()
    getattr(axis.axes, f"set_{axis.axis_name}scale")("log")
    axis.set_major_locator(LogLocator(10.0, (1.0,) if high > 100 * low else (1.0, 2.0, 5.0), numticks=6))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _plain(value)))
    axis.set_minor_formatter(NullFormatter())


def _plain(value: float) -> str:
    """Format a number of an axis: as it is, or as a power of ten if that has more than five digits."""
    if 1e-4 <= value < 1e5:
        return f"{value:g}"
    mantissa, _, exponent = f"{value:e}".partition("e")
    times = "" if float(mantissa) == 1 else rf"{float(mantissa):g}\cdot"
    return rf"${times}10^{{{int(exponent)}}}$"


def plain_text(words: str) -> str:
    """Escape text so that matplotlib prints it as it is: no mathematics between dollar signs."""
    return words.replace("$", r"\$")


def svg(figure: Figure) -> str:
    """Return the figure as an SVG element, without a file's metadata."""
    file = io.StringIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    return re.sub(r"^.*?(?=<svg)|\s*<metadata>.*?</metadata>", "", file.getvalue(), flags=re.DOTALL)


def saved(figure: Figure, folder: Path, name: str) -> Markup:
    """Write a figure as ``NAME.svg`` and ``NAME.png``; return its element for a page."""
    text = svg(figure)
    write_atomically(folder / f"{name}.svg", f'<?xml version="1.0" encoding="utf-8"?>\n{text}')
    figure.set_layout_engine("none")  # already laid out; that takes half of the time
    figure.savefig(folder / f"{name}.png", dpi=150, metadata={"Software": None})
    return Markup(_in_page(with_own_names(text, name)))


def _in_page(svg: str) -> str:
    """Make near-black, white and grid colours follow the reader's light or dark mode."""
    svg = svg.replace("#ffffff", "var(--paper)").replace(STYLE["grid.color"], "var(--line)")
    return _DARK.sub("var(--ink)", svg)


def themed(figure: Figure, name: str, label: str, marks: Mapping[str, tuple[str, str]]) -> Markup:
    """Return the element of a figure in the colours of the page.

    Parameters
    ----------
    name : str
        Of the figure, unique in its page.
    label : str
        Description of the figure, for a screen reader.
    marks : mapping
        By the ``gid`` of a mark: its CSS class and its tooltip.
    """
    text = with_own_names(svg(figure), name)
    for colour, of in _NAMES.items():
        text = text.replace(colour, f"var(--{of})")
    for gid, (css, title) in marks.items():
        group = f'<g class="{css}"><title>{escape(title)}</title>'
        text = text.replace(f'<g id="{name}-{gid}">', group)
    return Markup(text.replace("<svg ", f'<svg class="themed" role="img" aria-label="{escape(label)}" ', 1))


def with_own_names(svg: str, name: str) -> str:
    """Prefix the ids of a picture, and references to them, with its name; links out of the picture stay."""
    ids = set(re.findall(r'\bid="([^"]+)"', svg))
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    return re.sub(r'(href="#|url\(#)([^")]+)', lambda m: f"{m[1]}{name}-{m[2]}" if m[2] in ids else m[0], svg)
