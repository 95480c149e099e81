"""The page of a chart, and its pictures as files: frontiers, convergence, maps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import number
from lammps_cases.report.pages import blocks
from lammps_cases.report.pages.blocks import (
    Abreast,
    Block,
    Bullets,
    Definitions,
    Details,
    Heading,
    PageRow,
    PageTable,
    Paragraph,
    Picture,
)
from lammps_cases.report.pages.figures import BLUE, GREY, RED, STYLE, saved
from lammps_cases.studies import draw
from lammps_cases.studies.chart import codes
from lammps_cases.studies.chart.recommend import recommendation
from lammps_cases.studies.chart.record import (
    DIGITS,
    LAMMPS,
    Chart,
    Map,
    MethodPanel,
    MethodPoint,
    Section,
    digits,
    frontier,
)
from lammps_cases.studies.draw import Curve
from lammps_cases.studies.flows.record import REFERENCE, FlowRecord

CSS = Path(__file__).parents[1] / "assets" / "chart.css"
# Distinguished by colour and by shape; LAMMPS' own methods are always red.
_COLOURS = ("#1f5fa8", "#2e8b57", "#d98200", "#7b4fa3", "#0f9ba8", "#8c5a3c", "#c2559d", "#5c6b7a")
_OTHERS = ("#111111", "#e5007d", "#7fb800", "#00b3e6")  # further engines
_PEER, _SCHEMES = "#2e8b57", {"tvf": "s", "edac": "^", "wcsph": "D"}  # PySPH
_SHAPES = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h", "d")
ABOUT = """Which way to compute a quantity is fast enough and accurate enough? Each mark is one: up and to the left is
better, correct decimal digits against time. LAMMPS is red, in the shape of the same method if there is one. Filled
marks lie on the frontier, the choice at their time; for a hollow one another method is measurably faster and as
accurate, or more accurate and no slower. Of flows and whole codes the error itself is drawn: down and to the left is
better."""
TIMES = """Times are medians of rounds in which all methods take turns, bars are 95 % intervals. Worst cases of
rounding that differ by less than a factor of two count as the same, errors of discretisation within 1 %. A
thin line leads from the largest error to the median, where both are known."""

Marks = dict[str, tuple[str, str]]  # colour and shape of a method
Others = Sequence[tuple[str, MethodPanel]]  # the same panel of other engines, by their versions


def write(chart: Chart, folder: Path, others: Sequence[Chart] = ()) -> None:
    """Write ``report.html`` and ``figures/*.svg|png``, with the frontiers of other engines laid over the first's."""
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    busy = [Paragraph(words, "warning") for words in [_busy(chart)] if words]
    html = blocks.page(
        "chart",
        "Speed against accuracy: LAMMPS, the reference, and other ways to compute the same",
        "speed against accuracy",
        [Paragraph(ABOUT, "about"), *busy, Paragraph(TIMES)],
        [
            blocks.PageSection(section.name, section.title, list(_section(section, chart, others, figures)))
            for section in chart.sections
        ],
        engine=chart.label,
        command=chart.command,
        facts=_facts(chart, others),
        styles=[CSS],
    )
    write_atomically(folder / "report.html", html)


def _facts(chart: Chart, others: Sequence[Chart]) -> list[tuple[str, str]]:
    (_, lammps), (_, processor), took = chart.facts
    further = f", and in addition, measured afterwards: {', '.join(other.label for other in others)}" if others else ""
    return [
        ("LAMMPS", f"{lammps}{further}"),
        *([("PySPH", chart.engine["pysph"])] if "pysph" in chart.engine else []),
        ("processor", f"{processor}, load {chart.machine['load']} at the start"),
        took,
    ]


def _busy(chart: Chart) -> str:
    """Warn that the machine was loaded during timing; empty if a core was free."""
    load, cores = float(chart.machine["load"]), int(chart.machine["cores"])
    if load <= max(1, cores - 1):
        return ""
    return (
        f"Other programs ran: load {load:.1f} on {cores} cores at the start. Timings are unreliable; errors are valid."
    )


def _section(section: Section, chart: Chart, others: Sequence[Chart], figures: Path) -> Iterator[Block]:
    yield Paragraph(section.about, "about")
    if section.panels:
        yield Definitions({"; ".join(names): what for names, what in methods(section)})
    marks = marks_of([point for panel in section.panels for point in panel.points])
    for panel in section.panels:
        yield from _panel(panel, _of_others(panel, others), marks, figures)
    if section.maps:
        yield Abreast([[Picture(saved(map_figure(one), figures, one.id))] for one in section.maps])
    if section.codes:
        yield from _codes(section, codes.without(chart), figures)


# --- methods


def _panel(
    panel: MethodPanel, others: Sequence[tuple[str, MethodPanel]], marks: Marks, figures: Path
) -> Iterator[Block]:
    roofline = f" Moving the arrays alone takes {number(panel.roofline_ns)} ns." if panel.roofline_ns else ""
    yield Heading(panel.title, panel.id)
    yield Paragraph(f"{panel.about} Error: {panel.error_of}.{roofline}")
    yield Paragraph(recommendation(panel), "about")
    yield Picture(saved(panel_figure(panel, others, marks), figures, panel.id))
    numbers: list[Block] = []
    for regime in panel.regimes:
        numbers += [Paragraph(f"{regime}: {sentence(panel, regime)}"), _points(panel, regime)]
    yield Details("numbers", numbers)


def _points(panel: MethodPanel, regime: str) -> PageTable:
    """Return the table of a regime, from the fastest method on; those off the frontier are faint."""
    points, best = sorted(panel.of(regime), key=lambda p: p.ns.median), frontier(panel.of(regime))
    spread = any(p.worst_at for p in points)
    columns = ["method", "#largest error", *(["#99 % below", "#median", "largest at"] if spread else []), "#digits"]
    return PageTable(
        [*columns, f"#ns per {panel.unit}", "#95 %", "beaten by", "indistinguishable from"],
        [
            PageRow(
                [
                    *(p.method, error(p.error), *([error(p.p99), error(p.median), p.worst_at] if spread else [])),
                    *(f"{p.digits:.1f}", number(p.ns.median), f"{number(p.ns.low)} to {number(p.ns.high)}"),
                    *(p.dominated_by, ", ".join(p.like)),
                ],
                " ".join(["theirs"] * (p.engine == LAMMPS) + ["off"] * (p not in best)),
            )
            for p in points
        ],
    )


def error(value: float | None) -> str:
    """Format an error; empty for None."""
    return "" if value is None else f"{value:.2g}" if math.isfinite(value) else "none right"


def methods(section: Section) -> list[tuple[list[str], str]]:
    """Return the methods of a section and what they are; those with the same description together.

    LAMMPS' versions of methods of the reference are not listed again.
    """
    points = [point for panel in section.panels for point in panel.points]
    own = {point.method for point in points if point.engine != LAMMPS}
    by_reason: dict[str, dict[str, None]] = {}
    for point in points:
        if point.method.removeprefix(LAMMPS).strip() not in own or point.engine != LAMMPS:
            by_reason.setdefault(point.reason, {})[point.method] = None
    return [(list(names), reason) for reason, names in by_reason.items()]


def sentence(panel: MethodPanel, regime: str) -> str:
    """Return the frontier in words."""
    best = frontier(panel.of(regime))
    if not best:
        return "no method is better than all others"
    parts = [f"{p.method} ({p.digits:.1f} digits, {p.ns.median:.3g} ns)" for p in best]
    return "frontier: " + ", then ".join(parts)


def _of_others(panel: MethodPanel, others: Sequence[Chart]) -> list[tuple[str, MethodPanel]]:
    """Return the same panel of other engines, by their versions."""
    return [(chart.label, theirs) for chart in others for theirs in chart.panels if theirs.id == panel.id]


def marks_of(points: Sequence[MethodPoint]) -> Marks:
    """Choose the colour and shape of every method; LAMMPS' way of a method of the reference has its shape, in red."""
    names = sorted({p.method for p in points if p.engine != LAMMPS})
    marks = {m: (_COLOURS[k % len(_COLOURS)], _SHAPES[k % len(_SHAPES)]) for k, m in enumerate(names)}
    theirs = sorted({p.method for p in points if p.engine == LAMMPS})
    own = {m: m.removeprefix(LAMMPS).strip(" ,") for m in theirs}
    return marks | {m: (RED, marks[own[m]][1] if own[m] in marks else "*") for m in theirs}


def panel_figure(
    panel: MethodPanel, others: Sequence[tuple[str, MethodPanel]] = (), marks: Marks | None = None
) -> Figure:
    """Draw correct digits against time, one plot per regime: the frontier drawn, dominated methods hollow.

    ``marks`` may have more methods than the panel. ``others`` are the same panel measured with other engines, by their
    versions: LAMMPS' points and the frontier of these are drawn.
    """
    marks = marks or marks_of(panel.points)
    # All of a double's digits if they are in reach, else the range of the points.
    best = max(p.digits for p in panel.points)
    floor, top = (-0.5, DIGITS + 0.8) if best > 8 else (-0.1, 1.1 * best + 0.2)
    first, far = min(p.ns.low for p in panel.points), 2 * max(p.ns.high for p in panel.points)
    limits = {"x": (0.6 * min(first, panel.roofline_ns or first), far), "y": (floor, top)}
    style: dict[str, Any] = {"lw": 1.2, "drawstyle": "steps-post"}
    regimes = []
    for regime in panel.regimes:
        points = sorted(panel.of(regime), key=lambda p: (p.engine == LAMMPS, p.method))
        curves = [_frontier(points, floor, far, {**style, "color": BLUE, "alpha": 0.6}, "frontier")]
        curves += [_mark(p, *marks[p.method], filled=not p.dominated_by or p.engine == LAMMPS) for p in points]
        curves += [_spread(p, p.median, marks[p.method][0]) for p in points if p.median is not None]
        for (version, other), colour in zip(others, _OTHERS, strict=False):
            label, theirs = f"LAMMPS {version}\nand its frontier", other.of(regime)
            curves.append(_frontier(theirs, floor, far, {**style, "color": colour, "ls": "--"}, label))
            shapes = {p: marks.get(p.method, ("", "*"))[1] for p in theirs if p.engine == LAMMPS}
            curves += [_mark(p, colour, shape, filled=False, label="") for p, shape in shapes.items()]
        if panel.roofline_ns:
            line = {"color": GREY, "ls": "--", "lw": 1}
            label = "moving the arrays\n(memory bandwidth)"
            curves.append(Curve(label, [panel.roofline_ns] * 2, [floor, top], line))
        regimes.append(draw.Panel(f"ns per {panel.unit} (log)", "correct digits", curves, regime, "x", (), limits))
    return draw.figure(regimes, share=True)


def _frontier(points: Sequence[MethodPoint], floor: float, far: float, style: dict[str, Any], label: str) -> Curve:
    best = frontier(points)
    if not best:
        return Curve("", [], [], style)
    x, y = [p.ns.median for p in best], [p.digits for p in best]
    return Curve(label, [x[0], *x, far], [floor, *y, y[-1]], style)


def _mark(point: MethodPoint, colour: str, shape: str, filled: bool, label: str | None = None) -> Curve:
    """Return the mark of a method; those of LAMMPS with a method's shape have one entry of the legend."""
    shared = "LAMMPS: same shape, red" if colour == RED and shape != "*" else point.method
    size = 11 if shape == "*" else 6
    face = colour if filled else "white"
    style = {"marker": shape, "ms": size, "mec": colour, "mfc": face, "mew": 1.2, "ls": "none", "color": colour}
    at = [point.ns.median], [point.digits]
    return Curve(shared if label is None else label, *at, style, [point.ns.low], [point.ns.high])


def _spread(point: MethodPoint, median: float, colour: str) -> Curve:
    """Return the line from the digits of the largest error to those of the median."""
    style = {"color": colour, "lw": 1, "alpha": 0.5}
    return Curve("to the median error", [point.ns.median] * 2, [point.digits, digits(median)], style)


def map_figure(data: Map) -> Figure:
    """Draw a map of errors, as digits."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.3, 3.0), layout="constrained")
        axis = figure.subplots()
        with np.errstate(divide="ignore"):
            digits = np.clip(-np.log10(np.array(data.value, float)), 0, DIGITS)
        logarithmic = min(data.x) > 0 and max(data.x) / min(data.x) > 50
        x = np.log10(data.x) if logarithmic else np.array(data.x)
        top = 16.0 if digits.max() > 8 else float(digits.max()) or 1.0
        mesh = axis.pcolormesh(x, data.y, digits, cmap="viridis", vmin=0, vmax=top, shading="nearest")
        axis.grid(False)
        axis.set(xlabel=f"log10 {data.x_name}" if logarithmic else data.x_name, ylabel=data.y_name, title=data.title)
        figure.colorbar(mesh, ax=axis, label="correct digits")
        return figure


# --- whole codes


def _code(name: str) -> dict[str, Any]:
    """Return the colour and mark of a code; the schemes of PySPH have a colour, and each its mark."""
    style: dict[str, Any] = {"color": _PEER, "marker": _SCHEMES.get(name.split()[-1], "X"), "zorder": 2}
    if name == REFERENCE:
        style = {"color": BLUE, "marker": "o", "zorder": 3}
    if name == LAMMPS:
        style = {"color": RED, "marker": "*", "mfc": RED, "ms": 10, "zorder": 2}
    return {"ms": 6, "mfc": "white", "lw": 1, **style}


def _codes(section: Section, without: str, figures: Path) -> Iterator[Block]:
    yield Picture(saved(codes_figure(section.codes), figures, section.name))
    yield Bullets([codes.recommendation(case, of) for case, of in codes.compared(section.codes)])
    if without:
        yield Paragraph(without)
    about = [Paragraph(f"{case.flow.title}: {case.about}") for case, _ in codes.compared(section.codes)]
    columns = ["flow", "error of", "code", "#N", "#particles", "#steps", "#seconds", "#error"]
    table = PageTable(columns, list(codes.rows(section.codes)), "Whole codes")
    yield Details("what each code solves, all numbers", [*about, table])


def codes_figure(runs: Sequence[FlowRecord]) -> Figure:
    """Draw the error of every flow against the seconds of a run: a line per code, each point with its resolution."""
    panels = []
    for case, by_code in codes.compared(runs):
        curves = []
        for code, of in by_code.items():
            solved = [run for run in of if run.errors]
            x, y = [run.seconds for run in solved], [run.errors[case.measure] for run in solved]
            curves.append(Curve(code, x, y, _code(code), texts=[str(run.n) for run in solved]))
        x_name = "seconds of one core, all steps (log)"
        panels.append(draw.Panel(x_name, f"error: {case.measure}", curves, case.flow.title, "xy"))
    return draw.figure(panels, size=(3.2, 2.7))
