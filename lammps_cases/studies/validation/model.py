"""What a validation is: a flow at several resolutions, what others know of it, and what a user would read off it."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.findings.entry import Finding
from lammps_cases.studies.flows.flow import Flow, Options, Snapshot
from lammps_cases.studies.flows.layout import relative

DATA = Path(__file__).parent / "data"
Curve = tuple[tuple[float, ...], tuple[float, ...]]  # x, y
Read = Callable[[int, Options, Sequence[Snapshot]], Curve]


@dataclass(frozen=True)
class ReferenceCurve:
    """What others know of a curve: points of an experiment or a table, drawn as marks, or a solution, as a line."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    source: str
    scatter: str = ""
    marks: bool = True

    def misfit(self, curve: Curve) -> float:
        """Return the root mean square of what a curve misses it by, over its own: where points are known, or run."""
        x, y = curve
        if self.marks:
            return relative(np.interp(self.x, x, y) - np.array(self.y), np.array(self.y))
        given = np.interp(x, self.x, self.y)
        return relative(np.array(y) - given, given)


def table(name: str, label: str) -> ReferenceCurve:
    """Return the points of ``data/NAME.csv``: lines ``# source`` and ``# scatter``, a header, x and y."""
    lines = (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    about = dict(line.removeprefix("# ").split(": ", 1) for line in lines if line.startswith("# "))
    _, *points = csv.reader(line for line in lines if not line.startswith("#"))
    x, y = zip(*((float(a), float(b)) for a, b in points), strict=True)
    return ReferenceCurve(label, x, y, about["source"], about["scatter"])


def line(label: str, x: FloatArray, y: FloatArray, source: str) -> ReferenceCurve:
    """Return a solution, drawn as a line."""
    return ReferenceCurve(label, tuple(x.tolist()), tuple(y.tolist()), source, marks=False)


def curve(x: FloatArray, y: FloatArray) -> Curve:
    """Return points in the order of x."""
    order = np.argsort(x, kind="stable")
    return tuple(np.asarray(x)[order].tolist()), tuple(np.asarray(y)[order].tolist())


@dataclass(frozen=True)
class FlowPanel:
    """A picture of a flow: what others know, the first of them what errors are taken against, and how a run is read."""

    name: str
    x: str
    y: str
    known: tuple[ReferenceCurve, ...]
    read: Read


@dataclass(frozen=True)
class FlowQuantity:
    """A number that a user reads off the flow.

    Attributes
    ----------
    published : what it should be, None: nobody knows
    absent : what is said where a run has no such number
    """

    name: str
    read: Callable[[int, Options, Sequence[Snapshot]], float]
    published: float | None = None
    source: str = ""
    absent: str = "no number"


@dataclass(frozen=True)
class Validation:
    """A flow that others have measured, computed or solved.

    Attributes
    ----------
    flow : how it starts, at which resolutions, with which options; its measures are the errors, the headline first
    title : of its section
    panels, quantities : what is compared
    findings : those of LAMMPS that change it, each tried alone on the reference
    left_out : what is not compared, and why
    """

    flow: Flow
    title: str
    panels: tuple[FlowPanel, ...]
    quantities: tuple[FlowQuantity, ...]
    findings: tuple[Finding, ...] = ()
    left_out: str = ""

    @property
    def name(self) -> str:
        """Name of the flow."""
        return self.flow.name


def misfits(panels: Sequence[FlowPanel]) -> Callable[[int, Options, Sequence[Snapshot]], dict[str, float]]:
    """Return the measures of a flow that is held against the first known curve of each panel."""

    def measures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
        return {panel.name: panel.known[0].misfit(panel.read(n, options, snapshots)) for panel in panels}

    return measures
