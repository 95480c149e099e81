"""A chart: points of error against time, their frontier; its tables and its document.

On disk a chart is ``chart.json``, tables as CSV, pictures and a page.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lammps_cases.records.documents import SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text, write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.records.measure import ConfidenceInterval, Timing, verdict
from lammps_cases.studies.flows.record import FlowRecord, errors_csv

LAMMPS = "LAMMPS"
ONE_BIT = 2.0  # factor between two worst errors below which neither method is better
ONE_PER_CENT = 1.01  # the same for errors of discretisation, which are deterministic
DIGITS = 15.95  # of a double; an error of 0 is drawn there


def digits(error: float) -> float:
    """Return correct decimal digits, -log10 of an error; from 0 to those of a double."""
    if not math.isfinite(error):
        return 0.0
    return min(max(-math.log10(error), 0.0), DIGITS) if error > 0 else DIGITS


@dataclass(frozen=True)
class MethodPoint:
    """Error and time of one way to compute one quantity in one regime.

    Attributes
    ----------
    quantity : what is computed, as ``pressure of tait/water``
    regime : the conditions, as ``|rho/rho0 - 1| from 1e-6 to 1e-5``
    method : name of the method; LAMMPS' own begins with ``LAMMPS``
    error : the largest error found, dimensionless, relative to the scale of the panel
    ns : nanoseconds per particle (or per particle and step): median and its interval
    compiling : seconds that the first call took beyond the others
    reason : what it is and why to use it, in a line
    dominated_by : a method that is as accurate and measurably faster, or as fast and more accurate
    like : methods whose times do not differ measurably from this one's
    median, p99 : of the errors of all samples; None where only the largest is known
    worst_at : the input with the largest error, exactly
    """

    quantity: str
    regime: str
    method: str
    error: float
    ns: ConfidenceInterval
    compiling: float = 0.0
    reason: str = ""
    dominated_by: str = ""
    like: tuple[str, ...] = ()
    median: float | None = None
    p99: float | None = None
    worst_at: str = ""

    @property
    def digits(self) -> float:
        """Correct decimal digits of the largest error."""
        return digits(self.error)

    @property
    def engine(self) -> str:
        """The engine of the method."""
        return LAMMPS if self.method.startswith(LAMMPS) else "reference"


@dataclass(frozen=True)
class MethodPanel:
    """The points of one quantity, all measured in the same rounds.

    Attributes
    ----------
    error_of : definition of the error, and of its scale
    unit : unit of work that a time belongs to
    roofline_ns : time that moving the arrays alone takes on this machine, per unit; None: not bound by memory
    """

    id: str
    title: str
    about: str
    error_of: str
    unit: str
    points: tuple[MethodPoint, ...]
    roofline_ns: float | None = None

    @property
    def regimes(self) -> list[str]:
        """Regimes in the order of their points."""
        return list(dict.fromkeys(point.regime for point in self.points))

    def of(self, regime: str) -> list[MethodPoint]:
        """Return the points of one regime."""
        return [point for point in self.points if point.regime == regime]


@dataclass(frozen=True)
class Map:
    """Errors over two parameters: ``value[row][column]`` belongs to ``y[row]`` and ``x[column]``."""

    id: str
    title: str
    x_name: str
    y_name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    value: tuple[tuple[float, ...], ...]
    unit: str


def point(
    quantity: str, regime: str, method: str, error: float, timing: Timing, per: float, reason: str = ""
) -> MethodPoint:
    """Return a point from a timing of a call that treats ``per`` particles (or particles and steps)."""
    late = max(timing.first - timing.seconds.high, 0.0)
    ns = timing.seconds.scaled(1e9 / per)
    return MethodPoint(quantity, regime, method, error, ns, late, reason)


def measured(
    quantity: str,
    regime: str,
    errors: Mapping[str, float],
    timings: Mapping[str, Timing],
    per: float,
    reasons: Mapping[str, str] | None = None,
    same: float = ONE_BIT,
) -> tuple[MethodPoint, ...]:
    """Return the points of one regime, compared: of every method that has an error; see `point` and `compared`."""
    reasons = reasons or {}
    points = [point(quantity, regime, m, error, timings[m], per, reasons.get(m, "")) for m, error in errors.items()]
    return compared(points, timings, same)


def compared(
    points: Sequence[MethodPoint], timings: Mapping[str, Timing], same: float = ONE_BIT
) -> tuple[MethodPoint, ...]:
    """Compare the points of one regime by their errors and by their timings, which are of the same rounds.

    A method is dominated by another one that is measurably faster and no less accurate, or more accurate and not
    measurably slower. Times are compared round by round (`Timing.against`).

    Parameters
    ----------
    same : float
        Factor within which errors count as the same: one bit for rounding errors, by which the search for a worst case
        may fall short; `ONE_PER_CENT` for errors of discretisation.
    """
    marked = []
    for one in points:
        like, dominated = [], ""
        for other in points:
            if other is one:
                continue
            answer = verdict(timings[other.method].against(timings[one.method]))
            if answer == "cannot tell":
                like.append(other.method)
            better = other.error * same < one.error and answer != "slower"
            as_good = other.error <= one.error * same
            if (better or (as_good and answer == "faster")) and not dominated:
                dominated = other.method
        marked.append(replace(one, dominated_by=dominated, like=tuple(sorted(like))))
    return tuple(marked)


def frontier(points: Iterable[MethodPoint]) -> list[MethodPoint]:
    """Return the points that no other dominates, from the fastest to the most accurate."""
    return sorted((p for p in points if not p.dominated_by), key=lambda p: (p.ns.median, p.error))


@dataclass(frozen=True)
class Section:
    """One group of panels and maps, with the seconds it took; ``codes`` are flows solved by whole codes."""

    name: str
    title: str
    about: str
    seconds: float
    panels: tuple[MethodPanel, ...] = ()
    maps: tuple[Map, ...] = ()
    codes: tuple[FlowRecord, ...] = ()


@dataclass(frozen=True)
class Chart(Study):
    """Everything measured."""

    sections: tuple[Section, ...]
    schema: str = SCHEMAS["chart"]

    @property
    def panels(self) -> list[MethodPanel]:
        """Panels of all sections."""
        return [panel for section in self.sections for panel in section.panels]


DOCUMENT = Document("chart", Chart)


def sections(folder: Path) -> Parts[Section]:
    """Return the journal ``sections.jsonl`` of finished sections."""
    return Parts(folder / "sections.jsonl", Section)


def write(chart: Chart, folder: Path) -> None:
    """Write ``chart.json`` and the tables."""
    write_atomically(folder / "points.csv", csv_text(_point_rows(chart)))
    write_atomically(folder / "errors.csv", errors_csv(run for section in chart.sections for run in section.codes))
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
        *("median", "p99", "worst_at"),
    )
    for panel in chart.panels:
        for p in panel.points:
            yield (
                *(p.quantity, p.regime, p.method, p.error, p.ns.median),
                *(round(p.digits, 2), p.ns.low, p.ns.high, panel.unit, p.compiling, p.dominated_by),
                *("; ".join(p.like), p.reason, p.median, p.p99, p.worst_at),
            )
