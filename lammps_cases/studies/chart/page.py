"""The page of a chart, and its pictures as files: frontiers, convergence, maps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from lammps_cases.records.files import write_atomically
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.figures import BLUE, GREY, RED, STYLE, plain_log_axis, saved
from lammps_cases.studies.chart import codes
from lammps_cases.studies.chart.recommend import recommendation
from lammps_cases.studies.chart.record import DIGITS, LAMMPS, Chart, Map, MethodPoint, Panel, Section, digits, frontier
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Flow
from lammps_cases.studies.flows.solve import Convergence

ASSETS = Path(__file__).parent / "assets"
# Distinguished by colour and by shape; LAMMPS' own methods are always red stars.
_COLOURS = ("#1f5fa8", "#2e8b57", "#d98200", "#7b4fa3", "#0f9ba8", "#8c5a3c", "#c2559d", "#5c6b7a")
_OTHERS = ("#111111", "#e5007d", "#7fb800", "#00b3e6")  # further engines
_PEER, _SCHEMES = "#2e8b57", {"tvf": "s", "edac": "^", "wcsph": "D"}  # PySPH
_SHAPES = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h", "d")


Marks = dict[str, tuple[str, str]]  # colour and shape of a method


def panel_figure(panel: Panel, others: Sequence[tuple[str, Panel]] = (), marks: Marks | None = None) -> Figure:
    """Draw correct digits against time, one plot per regime: the frontier drawn, dominated methods hollow.

    ``marks`` may have more methods than the panel. ``others`` are the same panel measured with other engines, by their
    versions: LAMMPS' points and the frontier of these are drawn.
    """
    with matplotlib.rc_context(STYLE):
        regimes = panel.regimes
        columns = min(len(regimes), 3)
        rows = -(-len(regimes) // columns)
        marks = marks or marks_of(panel.points)
        handles = [*_legend(panel, marks), *_legend_of_others(others)]
        legend_columns = 1 if len(handles) <= 16 * rows else 2
        figure = Figure(figsize=(3.5 * columns + 1.9 * legend_columns, 2.9 * rows + 0.5), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        for axis, regime in zip(axes, regimes, strict=False):
            _draw_regime(axis, panel, regime, marks)
            for (_, other), colour in zip(others, _OTHERS, strict=False):
                _draw_other(axis, other, regime, marks, colour)
        for axis in axes[len(regimes) :]:
            axis.set_visible(False)
        figure.supxlabel(f"ns per {panel.unit} (log)", fontsize=9)
        figure.supylabel("correct digits", fontsize=9)
        figure.legend(handles=handles, loc="outside right center", frameon=False, fontsize=8, ncols=legend_columns)
        return figure


def marks_of(points: Sequence[MethodPoint]) -> Marks:
    """Choose the colour and shape of every method; LAMMPS' way of a method of the reference has its shape, in red."""
    methods = sorted({p.method for p in points if p.engine != LAMMPS})
    marks = {m: (_COLOURS[k % len(_COLOURS)], _SHAPES[k % len(_SHAPES)]) for k, m in enumerate(methods)}
    theirs = sorted({p.method for p in points if p.engine == LAMMPS})
    own = {m: m.removeprefix(LAMMPS).strip(" ,") for m in theirs}
    return marks | {m: (RED, marks[own[m]][1] if own[m] in marks else "*") for m in theirs}


def _draw_regime(axis: Any, panel: Panel, regime: str, marks: Marks) -> None:
    points = panel.of(regime)
    best = frontier(points)
    far = 2 * max(p.ns.high for p in panel.points)
    x, y = [p.ns.median for p in best], [p.digits for p in best]
    # All of a double's digits if they are in reach, else the range of the points.
    best_digits = max(p.digits for p in panel.points)
    top, floor = (DIGITS + 0.8, -0.5) if best_digits > 8 else (1.1 * best_digits + 0.2, -0.1)
    axis.step([x[0], *x, far], [floor, *y, y[-1]], where="post", color=BLUE, lw=1.2, alpha=0.6)
    axis.fill_between([*x, far], [*y, y[-1]], floor, step="post", color=BLUE, alpha=0.05, lw=0)
    for p in points:
        colour, shape = marks[p.method]
        axis.plot([p.ns.low, p.ns.high], [p.digits] * 2, color=colour, lw=1)
        if p.median is not None:
            axis.plot([p.ns.median] * 2, [p.digits, digits(p.median)], color=colour, lw=1, alpha=0.5)
        size = 11 if p.engine == LAMMPS and shape == "*" else 6
        face = "white" if p.dominated_by and p.engine != LAMMPS else colour
        axis.plot([p.ns.median], [p.digits], shape, ms=size, mec=colour, mfc=face, mew=1.2, ls="none")
    if panel.roofline_ns:
        axis.axvline(panel.roofline_ns, color=GREY, ls="--", lw=1)
    first = min(p.ns.low for p in panel.points)
    axis.set_xlim(0.6 * min(first, panel.roofline_ns or first), far)
    plain_log_axis(axis.xaxis)
    axis.set_ylim(floor, top)
    axis.set_title(regime)


def _draw_other(axis: Any, panel: Panel, regime: str, marks: Marks, colour: str) -> None:
    """Draw LAMMPS' points and the frontier of another engine over those of the first."""
    best = frontier(panel.of(regime))
    if best:
        x, y = [p.ns.median for p in best], [p.digits for p in best]
        end, (floor, _) = axis.get_xlim()[1], axis.get_ylim()
        axis.step([x[0], *x, end], [floor, *y, y[-1]], where="post", color=colour, lw=1.2, ls="--", alpha=0.8)
    for p in panel.of(regime):
        if p.engine == LAMMPS:
            shape = marks.get(p.method, ("", "*"))[1]
            size = 11 if shape == "*" else 6
            axis.plot([p.ns.low, p.ns.high], [p.digits] * 2, color=colour, lw=1)
            axis.plot([p.ns.median], [p.digits], shape, ms=size, mec=colour, mfc="none", mew=1.2, ls="none")


def _legend_of_others(others: Sequence[tuple[str, Panel]]) -> list[Line2D]:
    style: dict[str, Any] = {"ls": "--", "lw": 1.2, "marker": "*", "mfc": "none", "ms": 9}
    return [
        Line2D([], [], color=colour, label=f"LAMMPS {version}\nand its frontier", **style)
        for (version, _), colour in zip(others, _OTHERS, strict=False)
    ]


def _legend(panel: Panel, marks: Marks) -> list[Line2D]:
    here = {p.method for p in panel.points}
    marks = {method: mark for method, mark in marks.items() if method in here}
    on = {p.method for p in panel.points if not p.dominated_by}
    stars = [method for method, (colour, shape) in marks.items() if colour == RED and shape == "*"]
    handles = []
    for method, (colour, shape) in marks.items():
        if colour != RED or method in stars:
            face = colour if method in on or colour == RED else "white"
            size = 10 if shape == "*" else 6
            style: dict[str, Any] = {"marker": shape, "ls": "none", "mec": colour, "mfc": face, "ms": size}
            handles.append(Line2D([], [], label=method, **style))
    if len(stars) < sum(colour == RED for colour, _ in marks.values()):
        handles.append(Line2D([], [], marker="o", ls="none", mec=RED, mfc=RED, ms=6, label="LAMMPS: same shape, red"))
    handles.append(Line2D([], [], color=BLUE, lw=1.2, alpha=0.6, label="frontier"))
    if panel.roofline_ns:
        handles.append(Line2D([], [], color=GREY, ls="--", lw=1, label="moving the arrays\n(memory bandwidth)"))
    return handles


def convergence_figure(runs: Sequence[Convergence], measure: str) -> Figure:
    """Draw the error against resolution and against wall time, with the fitted order of each engine."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.2, 2.7), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        for run in runs:
            if measure not in run.errors:
                continue
            style, ours = _code(run.engine), run.engine == "reference"
            error, fit = np.array(run.errors[measure]), run.fit(measure)
            spread = f" ± {fit.standard_error:.2f}" if np.isfinite(fit.standard_error) else ""
            label = f"{'reference' if ours else 'LAMMPS'}, order {round(fit.order, 2) + 0.0:.2f}{spread}"
            left.plot(run.resolutions, error, label=label, **style)
            work = 1e9 * np.array(run.seconds) / np.array(run.particles)
            right.plot(work, error, **style)
        left.set(yscale="log", xscale="log", xlabel="particles per length (log)", ylabel=f"error: {measure}")
        plain_log_axis(left.yaxis)
        ticks = sorted({n for run in runs for n in run.resolutions})
        left.set_xticks(ticks, [str(n) for n in ticks])
        left.minorticks_off()
        plain_log_axis(right.xaxis)
        right.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1000:g}"))
        right.set(xlabel="µs per particle, all steps (log)")
        left.legend(frameon=False, fontsize=8)
        return figure


def _code(engine: str) -> dict[str, Any]:
    """Return the colour and mark of a code; the schemes of PySPH have a colour, and each its mark."""
    if engine == "reference":
        return {"color": BLUE, "marker": "o", "ms": 6, "mfc": "white", "lw": 1, "zorder": 3}
    if engine == "lammps":
        return {"color": RED, "marker": "*", "ms": 10, "mfc": RED, "lw": 1, "zorder": 2}
    return {
        "color": _PEER,
        "marker": _SCHEMES.get(engine.split()[-1], "X"),
        "ms": 6,
        "mfc": "white",
        "lw": 1,
        "zorder": 2,
    }


def codes_figure(runs: Sequence[Convergence]) -> Figure:
    """Draw the error of every flow against the seconds of a run: a line per code, each point with its resolution."""
    with matplotlib.rc_context(STYLE):
        cases = list(codes.compared(runs))
        columns, lines = min(3, len(cases)), -(-len(cases) // 3)
        figure = Figure(figsize=(3.2 * columns + 1.6, 2.9 * lines + 0.2), layout="constrained")
        axes = figure.subplots(lines, columns, squeeze=False).ravel()
        for axis in axes[len(cases) :]:
            axis.set_visible(False)
        labels: dict[str, Any] = {}
        for axis, (case, of) in zip(axes, cases, strict=False):
            for run in of:
                style, error = _code(run.engine), run.errors.get(case.measure, ())
                labels[codes.name(run)] = Line2D([], [], **style)
                if error:
                    axis.plot(run.seconds, error, **style)
                    for n, x, y in zip(run.resolutions, run.seconds, error, strict=True):
                        axis.annotate(str(n), (x, y), xytext=(4, 4), textcoords="offset points", fontsize=7)
            axis.set(xscale="log", yscale="log", title=case.flow.title, ylabel=f"error: {case.measure}")
            for along in (axis.xaxis, axis.yaxis):
                plain_log_axis(along)
        figure.supxlabel("seconds of one core, all steps of a run (log)", fontsize=9)
        figure.legend(list(labels.values()), list(labels), loc="outside right center", frameon=False, fontsize=8)
        return figure


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


@dataclass(frozen=True)
class FlowView:
    """A flow as the page shows it: the run of every engine, and a picture of the headline error."""

    flow: Flow
    measure: str
    runs: list[Convergence]
    picture: Markup

    @property
    def agree(self) -> bool:
        """Whether the headline errors of the engines at the finest resolution are the same to a tenth."""
        last = [run.errors[self.measure][-1] if self.measure in run.errors else math.nan for run in self.runs]
        return all(abs(error - last[0]) <= 0.1 * abs(last[0]) for error in last)

    @property
    def speedup(self) -> float:
        """Time of LAMMPS over that of the reference, of all resolutions."""
        seconds = {run.engine: sum(run.seconds) for run in self.runs}
        return seconds.get("lammps", math.nan) / seconds.get("reference", math.nan)


def write(chart: Chart, folder: Path, others: Sequence[Chart] = ()) -> None:
    """Write ``report.html`` and ``figures/*.svg|png``, with the frontiers of other engines laid over the first's."""
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    html = frame.page(
        ASSETS,
        "chart",
        "good",
        chart=chart,
        facts=_facts(chart, others),
        pictures={id: saved(figure, figures, id) for id, figure in _panel_figures(chart, others)},
        maps={m.id: saved(map_figure(m), figures, m.id) for section in chart.sections for m in section.maps},
        flows={section.name: list(_flows(section, figures)) for section in chart.sections},
        codes={section.name: _codes(section, figures) for section in chart.sections if section.codes},
        without=codes.without(chart),
        busy=_busy(chart),
        rows=rows,
        methods=methods,
        sentence=sentence,
        recommendation=recommendation,
        error=lambda value: f"{value:.2g}" if math.isfinite(value) else "none right",
    )
    write_atomically(folder / "report.html", html)


def _panel_figures(chart: Chart, others: Sequence[Chart]) -> Iterator[tuple[str, Figure]]:
    """Draw every panel by its id; a method has the same mark in all of a section."""
    for section in chart.sections:
        marks = marks_of([point for panel in section.panels for point in panel.points])
        for panel in section.panels:
            yield panel.id, panel_figure(panel, _of_others(panel, others), marks)


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


def _of_others(panel: Panel, others: Sequence[Chart]) -> list[tuple[str, Panel]]:
    """Return the same panel of other engines, by their versions."""
    return [(chart.label, theirs) for chart in others for theirs in chart.panels if theirs.id == panel.id]


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


def _flows(section: Section, figures: Path) -> Iterator[FlowView]:
    for name in dict.fromkeys(run.flow for run in section.flows):
        runs = [run for run in section.flows if run.flow == name]
        measure = next((m for run in runs for m in run.errors), "")
        picture = saved(convergence_figure(runs, measure), figures, f"flow-{name}")
        yield FlowView(FLOWS[name], measure, runs, picture)


def _codes(section: Section, figures: Path) -> dict[str, Any]:
    about = {case.flow.title: case.about for case, _ in codes.compared(section.codes)}
    advice = [codes.recommendation(case, of) for case, of in codes.compared(section.codes)]
    picture = saved(codes_figure(section.codes), figures, section.name)
    return {"picture": picture, "about": about, "rows": list(codes.rows(section.codes)), "advice": advice}


def rows(panel: Panel, regime: str) -> list[tuple[MethodPoint, bool]]:
    """Return the points of a regime from the fastest on, and whether each is on the frontier."""
    best = frontier(panel.of(regime))
    return [(p, p in best) for p in sorted(panel.of(regime), key=lambda p: p.ns.median)]


def sentence(panel: Panel, regime: str) -> str:
    """Return the frontier in words."""
    best = frontier(panel.of(regime))
    if not best:
        return "no method is better than all others"
    parts = [f"{p.method} ({p.digits:.1f} digits, {p.ns.median:.3g} ns)" for p in best]
    return "frontier: " + ", then ".join(parts)
