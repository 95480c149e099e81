"""The files of a run: run.json and the reports made from it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import RunRecord

if TYPE_CHECKING:
    from lammps_cases.history.reported import Past
    from lammps_cases.report.drawn import Drawn


def write_run(run: RunRecord, folder: Path, drawn: Mapping[str, Drawn] | None = None, past: Past | None = None) -> None:
    """Write run.json and the reports made from it; ``drawn`` and ``past`` as in `lammps_cases.report.write_report`."""
    from lammps_cases.report import write_report

    write_atomically(folder / "run.json", run.to_json())
    write_report(run, folder, drawn=drawn, history=past)


def write_partial(run: RunRecord, folder: Path) -> None:
    """Write what there is in a moment of the report of an interrupted run; ``eos-ref report`` makes the page."""
    from lammps_cases.report import junit, markdown
    from lammps_cases.report.findings import outcome

    of_run = outcome(run)
    write_atomically(folder / "run.json", run.to_json())
    write_atomically(folder / "summary.md", markdown.summary(of_run))
    write_atomically(folder / "junit.xml", junit.document(of_run))
