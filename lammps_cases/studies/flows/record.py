"""Runs of flows as they are kept: one record for each flow, resolution and side, whatever asks for it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lammps_cases.records.documents import INFINITE, SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text
from lammps_cases.records.journal import Parts
from lammps_cases.studies.flows.known import Curve, Flow
from lammps_cases.studies.flows.solve import Fit, FlowResult, fit

REFERENCE, LAMMPS, UNIT, START = "reference", "LAMMPS", "LAMMPS in another unit of length", "reference, start "


@dataclass(frozen=True)
class Lost:
    """LAMMPS lost particles: the last step with all of them; findings with which the reference loses some, and when."""

    step: int
    findings: tuple[str, ...] = ()
    after: int | None = None


@dataclass(frozen=True)
class FlowRecord:
    """One flow at one resolution, as one side solved it.

    Attributes
    ----------
    side : reference, LAMMPS, LAMMPS in another unit of length, another code; reference with the name of a set-up or the
        number of another start; or the id of the finding that the reference had
    seconds : processor time of the steps alone, of one core
    message : of a side that failed; then all else is empty
    lost : the reason, if it lost particles; only at the coarsest resolution
    """

    __pydantic_config__ = INFINITE

    flow: str
    side: str
    n: int
    particles: int
    steps: int
    seconds: float
    message: str
    curves: Mapping[str, Curve]
    errors: Mapping[str, float]
    quantities: Mapping[str, float]
    lost: Lost | None = None


def recorded(of: Flow, n: int, side: str, result: FlowResult, lost: Lost | None = None) -> FlowRecord:
    """Return the record of a flow that was solved at a resolution with its own options."""
    head, shots = (of.name, side, n, result.n, result.steps, result.seconds, result.message), result.snapshots
    if result.message:
        return FlowRecord(*head, {}, {}, {}, lost)
    return FlowRecord(
        *head,
        {panel.name: panel.read(n, of.options, shots) for panel in of.panels},
        of.measures(n, of.options, shots),
        {quantity.name: quantity.read(n, of.options, shots) for quantity in of.quantities},
    )


def order(runs: Iterable[FlowRecord], measure: str) -> Fit:
    """Return the order of a measure's errors over the resolutions of one side; failed runs do not count."""
    errors = {run.n: run.errors[measure] for run in runs if measure in run.errors}
    return fit(list(errors), list(errors.values()))


def by_side(runs: Iterable[FlowRecord], flow: str) -> dict[str, list[FlowRecord]]:
    """Return the runs of a flow by side, from the coarsest on."""
    found: dict[str, list[FlowRecord]] = {}
    for run in runs:
        if run.flow == flow:
            found.setdefault(run.side, []).append(run)
    return {side: sorted(of_side, key=lambda run: run.n) for side, of_side in found.items()}


@dataclass(frozen=True)
class Validated(Study):
    """All runs of a validation."""

    runs: tuple[FlowRecord, ...]
    date: str = ""
    schema: str = SCHEMAS["validate"]

    @property
    def facts(self) -> list[tuple[str, str]]:
        """The facts at the top of the page, with the day of the runs."""
        return [*super().facts, ("measured", self.date)]

    @property
    def flows(self) -> list[str]:
        """Names of the flows, in their order."""
        return list(dict.fromkeys(run.flow for run in self.runs))

    def of(self, flow: str, side: str) -> list[FlowRecord]:
        """Return the runs of one side, from the coarsest on."""
        return by_side(self.runs, flow).get(side, [])

    def sides(self, flow: str) -> list[str]:
        """Return the sides that solved a flow."""
        return list(by_side(self.runs, flow))


DOCUMENT = Document("validate", Validated)


def journal(folder: Path) -> Parts[FlowRecord]:
    """Return the journal ``runs.jsonl`` of finished runs."""
    return Parts(folder / "runs.jsonl", FlowRecord)


def curves_csv(runs: Iterable[FlowRecord]) -> str:
    """Return the curves of runs as a table."""
    rows: list[Sequence[Any]] = [("flow", "side", "n", "panel", "x", "y")]
    for run in runs:
        for panel, (x, y) in run.curves.items():
            rows += ((run.flow, run.side, run.n, panel, *point) for point in zip(x, y, strict=True))
    return csv_text(rows)


def errors_csv(runs: Iterable[FlowRecord]) -> str:
    """Return the errors of runs, with the order of each measure on each side, as a table."""
    runs = list(runs)
    head = ("flow", "side", "measure", "n", "error", "order", "standard_error", "seconds", "particles", "steps")
    rows: list[Sequence[Any]] = [head]
    for flow in dict.fromkeys(run.flow for run in runs):
        for side, of_side in by_side(runs, flow).items():
            for measure in dict.fromkeys(name for run in of_side for name in run.errors):
                fitted = order(of_side, measure)
                for run in of_side:
                    error = run.errors.get(measure, math.nan)
                    cost = run.seconds, run.particles, run.steps
                    rows.append((flow, side, measure, run.n, error, fitted.order, fitted.standard_error, *cost))
    return csv_text(rows)
