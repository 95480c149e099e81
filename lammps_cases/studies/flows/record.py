"""A validation on disk: ``validate.json``, ``curves.csv``; ``runs.jsonl``, from which an interrupted one goes on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lammps_cases.records.documents import INFINITE, SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text, write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.studies.flows.converge import Fit, fit
from lammps_cases.studies.flows.flow import Curve

REFERENCE, LAMMPS, UNIT = "reference", "LAMMPS", "LAMMPS in another unit of length"


def called(side: str) -> str:
    """Return what a side is called in tables and legends."""
    return {UNIT: "LAMMPS, particles 0.75 apart"}.get(
        side, side if side in (REFERENCE, LAMMPS) else f"reference with {side}"
    )


@dataclass(frozen=True)
class Lost:
    """LAMMPS lost particles: the last step with all of them; findings with which the reference has lost some, when."""

    step: int
    findings: tuple[str, ...] = ()
    after: int | None = None


@dataclass(frozen=True)
class FlowRecord:
    """One flow at one resolution, as one side solved it.

    Attributes
    ----------
    side : reference, LAMMPS, LAMMPS in another unit of length; or the id of the finding that the reference had
    message : of LAMMPS, if it failed; then there is nothing else
    lost : why, if it lost particles; of the coarsest resolution alone
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


@dataclass(frozen=True)
class Validated(Study):
    """All that was run."""

    runs: tuple[FlowRecord, ...]
    schema: str = SCHEMAS["validate"]

    @property
    def flows(self) -> list[str]:
        """Names of the flows, in their order."""
        return list(dict.fromkeys(run.flow for run in self.runs))

    def of(self, flow: str, side: str) -> list[FlowRecord]:
        """Return the runs of one side, from the coarsest on."""
        return sorted((run for run in self.runs if (run.flow, run.side) == (flow, side)), key=lambda run: run.n)

    def sides(self, flow: str) -> list[str]:
        """Return the sides that solved a flow."""
        return list(dict.fromkeys(run.side for run in self.runs if run.flow == flow))

    def order(self, flow: str, side: str, measure: str) -> Fit:
        """Return the order of convergence of a measure."""
        runs = [run for run in self.of(flow, side) if measure in run.errors]
        return fit([run.n for run in runs], [run.errors[measure] for run in runs])


DOCUMENT = Document("validate", Validated)


def runs(folder: Path) -> Parts[FlowRecord]:
    """Return ``runs.jsonl``: runs as they come."""
    return Parts(folder / "runs.jsonl", FlowRecord)


def write(validated: Validated, folder: Path) -> None:
    """Write ``validate.json`` and ``curves.csv``."""
    write_atomically(folder / "curves.csv", csv_text(_rows(validated)))
    DOCUMENT.write(folder / "validate.json", validated)


def _rows(validated: Validated) -> Iterable[Sequence[Any]]:
    yield ("flow", "side", "n", "panel", "x", "y")
    for run in validated.runs:
        for panel, (x, y) in run.curves.items():
            yield from ((run.flow, run.side, run.n, panel, *point) for point in zip(x, y, strict=True))
