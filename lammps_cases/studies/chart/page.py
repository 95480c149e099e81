"""The page of a chart, and its pictures as files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from lammps_cases.records.files import write_atomically
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.figures import saved
from lammps_cases.studies.chart import codes, draw
from lammps_cases.studies.chart.points import LAMMPS, MethodPoint, Panel, frontier
from lammps_cases.studies.chart.record import Chart, Section
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.converge import Convergence
from lammps_cases.studies.flows.flow import Flow

ASSETS = Path(__file__).parent / "assets"


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
        maps={m.id: saved(draw.map_figure(m), figures, m.id) for section in chart.sections for m in section.maps},
        flows={section.name: list(_flows(section, figures)) for section in chart.sections},
        codes={section.name: _codes(section, figures) for section in chart.sections if section.codes},
        without=codes.without(chart),
        busy=_busy(chart),
        rows=rows,
        methods=methods,
        sentence=sentence,
        error=lambda value: f"{value:.2g}" if math.isfinite(value) else "none right",
    )
    write_atomically(folder / "report.html", html)


def _panel_figures(chart: Chart, others: Sequence[Chart]) -> Iterator[tuple[str, Figure]]:
    """Draw every panel by its id; a method has the same mark in all of a section."""
    for section in chart.sections:
        marks = draw.marks_of([point for panel in section.panels for point in panel.points])
        for panel in section.panels:
            yield panel.id, draw.panel_figure(panel, _of_others(panel, others), marks)


def methods(section: Section) -> list[tuple[list[str], str]]:
    """Return the methods of a section and what they are; those of which the same is said together.

    What LAMMPS does by a method of the reference is not listed again.
    """
    points = [point for panel in section.panels for point in panel.points]
    own = {point.method for point in points if point.engine != LAMMPS}
    said: dict[str, dict[str, None]] = {}
    for point in points:
        if point.method.removeprefix(LAMMPS).strip() not in own or point.engine != LAMMPS:
            said.setdefault(point.reason, {})[point.method] = None
    return [(list(names), reason) for reason, names in said.items()]


def _of_others(panel: Panel, others: Sequence[Chart]) -> list[tuple[str, Panel]]:
    """Return the same panel of other engines, by their versions."""
    return [(chart.label, theirs) for chart in others for theirs in chart.panels if theirs.id == panel.id]


def _facts(chart: Chart, others: Sequence[Chart]) -> list[tuple[str, str]]:
    (_, lammps), (_, processor), took = chart.facts
    beside = f", and beside it, measured afterwards: {', '.join(other.label for other in others)}" if others else ""
    return [
        ("LAMMPS", f"{lammps}{beside}"),
        *([("PySPH", chart.engine["pysph"])] if "pysph" in chart.engine else []),
        ("processor", f"{processor}, load {chart.machine['load']} at the start"),
        took,
    ]


def _busy(chart: Chart) -> str:
    """Warn of a machine that did other things meanwhile; empty if a core was free for what is timed."""
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
        picture = saved(draw.convergence_figure(runs, measure), figures, f"flow-{name}")
        yield FlowView(FLOWS[name], measure, runs, picture)


def _codes(section: Section, figures: Path) -> dict[str, Any]:
    about = {case.flow.title: case.about for case, _ in codes.compared(section.codes)}
    picture = saved(draw.codes_figure(section.codes), figures, section.name)
    return {"picture": picture, "about": about, "rows": list(codes.rows(section.codes))}


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
