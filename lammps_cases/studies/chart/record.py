"""A chart on disk: ``chart.json``, tables as CSV, pictures, a page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lammps_cases.records.documents import SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text, write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.studies.chart.points import Map, Panel
from lammps_cases.studies.flows.converge import Convergence


@dataclass(frozen=True)
class Section:
    """One group of panels, maps and flows, with the seconds it took; ``codes`` are flows solved by whole codes."""

    name: str
    title: str
    about: str
    seconds: float
    panels: tuple[Panel, ...] = ()
    maps: tuple[Map, ...] = ()
    flows: tuple[Convergence, ...] = ()
    codes: tuple[Convergence, ...] = ()


@dataclass(frozen=True)
class Chart(Study):
    """Everything measured."""

    sections: tuple[Section, ...]
    schema: str = SCHEMAS["chart"]

    @property
    def panels(self) -> list[Panel]:
        """Panels of all sections."""
        return [panel for section in self.sections for panel in section.panels]


DOCUMENT = Document("chart", Chart)


def sections(folder: Path) -> Parts[Section]:
    """Return ``sections.jsonl``: sections as they come."""
    return Parts(folder / "sections.jsonl", Section)


def write(chart: Chart, folder: Path) -> None:
    """Write ``chart.json`` and the tables."""
    write_atomically(folder / "points.csv", csv_text(_point_rows(chart)))
    write_atomically(folder / "convergence.csv", csv_text(_convergence_rows(chart)))
    DOCUMENT.write(folder / "chart.json", chart)


def points_document(chart: Chart) -> dict[str, list[dict[str, Any]]]:
    """Return what ``--json`` prints."""
    header, *rows = _point_rows(chart)
    points = [dict(zip(header, row, strict=True)) for row in rows]
    finite = [{k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in p.items()} for p in points]
    return {"points": finite}


def _point_rows(chart: Chart) -> Iterable[Sequence[Any]]:
    yield (
        *("quantity", "regime", "method", "error", "ns"),
        *("digits", "ns_low", "ns_high", "unit", "compiling_s", "dominated_by", "like", "reason"),
    )
    for panel in chart.panels:
        for p in panel.points:
            yield (
                *(p.quantity, p.regime, p.method, p.error, p.ns.median),
                *(round(p.digits, 2), p.ns.low, p.ns.high, panel.unit, p.compiling, p.dominated_by),
                *("; ".join(p.like), p.reason),
            )


def _convergence_rows(chart: Chart) -> Iterable[Sequence[Any]]:
    yield (
        *("flow", "engine", "measure", "resolution", "error", "order", "standard_error"),
        *("seconds", "particles", "steps"),
    )
    for run in (run for section in chart.sections for run in (*section.flows, *section.codes)):
        for measure, errors in run.errors.items():
            fit = run.fit(measure)
            for k, (n, error) in enumerate(zip(run.resolutions, errors, strict=True)):
                yield (
                    *(run.flow, run.engine, measure, n, error, fit.order, fit.standard_error),
                    *(run.seconds[k], run.particles[k], run.steps[k]),
                )
