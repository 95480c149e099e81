"""A flow with what is known of it: published curves and numbers, a closed solution, the order expected by theory."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.findings.entry import Finding
from lammps_cases.records.files import DATA
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, relative

Curve = tuple[tuple[float, ...], tuple[float, ...]]  # x, y
Read = Callable[[int, Options, Sequence[Snapshot]], Curve]
Measures = Callable[[int, Options, Sequence[Snapshot]], dict[str, float]]


@dataclass(frozen=True)
class ReferenceCurve:
    """A published curve: points of an experiment or a table, drawn as marks, or a solution, as a line."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    source: str
    scatter: str = ""
    marks: bool = True

    def misfit(self, curve: Curve) -> float:
        """Return the RMS deviation of a curve from it over its own RMS: where points are known, or run."""
        x, y = curve
        if self.marks:
            return relative(np.interp(self.x, x, y) - np.array(self.y), np.array(self.y))
        given = np.interp(x, self.x, self.y)
        return relative(np.array(y) - given, given)


def table(name: str, label: str) -> ReferenceCurve:
    """Return the points of ``data/NAME.csv``: lines ``# source`` and ``# scatter``, a header, x and y."""
    lines = (DATA / "flows" / f"{name}.csv").read_text(encoding="utf-8").splitlines()
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
    """A picture of a flow: published curves, the first as the reference for errors, and how to read a run."""

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
    published : its right value, None: unknown
    absent : text in place of the number for a run without one
    """

    name: str
    read: Callable[[int, Options, Sequence[Snapshot]], float]
    published: float | None = None
    source: str = ""
    absent: str = "no number"


def misfits(panels: Sequence[FlowPanel]) -> Measures:
    """Return the measures of a flow that is compared with the first known curve of each panel."""

    def measures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
        return {panel.name: panel.known[0].misfit(panel.read(n, options, snapshots)) for panel in panels}

    return measures


@dataclass(frozen=True)
class Published:
    """Published results of a benchmark with one kernel.

    Attributes
    ----------
    benchmark : title that the kernels of a benchmark share
    errors : by N, of the flow's first measure; empty where a norm is not published
    order : as printed; NaN if none is
    meaning : what the published numbers measure, and how this flow differs from theirs
    """

    benchmark: str
    errors: Mapping[int, float]
    order: float
    meaning: str


@dataclass(frozen=True)
class Flow:
    """A flow with a closed solution, an experiment, or a table.

    Attributes
    ----------
    name, about : what it is, and its further options
    resolutions : particles per wavelength, height or diameter; at least three
    expected : the order that theory allows, and why
    start : particles and scene of a resolution
    measures : relative errors of snapshots by name, the headline first
    options : the set-up that shows the convergence
    quick : cheap resolutions, where the others are not
    full : finer resolutions, on request
    title : of its section in a validation
    panels, quantities : what a validation compares
    findings : findings of LAMMPS that change it, each tried alone on the reference
    left_out : what a validation omits, and why
    published : results of the paper behind RHEO
    validates : what of the method it shows
    setups : other set-ups, by name, for the reference alone
    limits : what limits those, and the order
    """

    name: str
    about: str
    resolutions: tuple[int, ...]
    expected: str
    start: Callable[[int, Options], Start]
    measures: Measures
    options: Options = field(default_factory=Options)
    quick: tuple[int, ...] = ()
    title: str = ""
    panels: tuple[FlowPanel, ...] = ()
    quantities: tuple[FlowQuantity, ...] = ()
    findings: tuple[Finding, ...] = ()
    left_out: str = ""
    full: tuple[int, ...] = ()
    published: Published | None = None
    validates: str = ""
    setups: Mapping[str, Options] = field(default_factory=dict)
    limits: str = ""

    @property
    def heading(self) -> str:
        """Its title, or its name in words."""
        return self.title or self.name.replace("-", " ").capitalize()
