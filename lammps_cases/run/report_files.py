"""The files of a run: run.json and the reports made from it."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import HeadlineRecord, RunRecord

if TYPE_CHECKING:
    from lammps_cases.history.reported import Past
    from lammps_cases.report.drawn import Drawn
    from lammps_cases.report.findings import Outcome
    from lammps_cases.report.page import Making


def write_run(
    run: RunRecord,
    folder: Path,
    drawn: Mapping[str, Drawn] | None = None,
    past: Past | None = None,
    making: Making | None = None,
) -> None:
    """Write run.json and the reports made from it; what is given is as in `lammps_cases.report.write_report`."""
    from lammps_cases.report import write_report
    from lammps_cases.report.findings import outcome

    with _uncollected():
        _with_headline(run, outcome(run))
        write_atomically(folder / "run.json", run.to_json())
        write_report(run, folder, drawn=drawn, history=past, making=making)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Make a report without a search for garbage, of which it leaves little: a fifth of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def write_partial(run: RunRecord, folder: Path) -> None:
    """Write what there is in a moment of the report of an interrupted run; ``eos-ref report`` makes the page."""
    from lammps_cases.report import junit, markdown
    from lammps_cases.report.findings import outcome

    of_run = outcome(run)
    _with_headline(run, of_run)
    write_atomically(folder / "run.json", run.to_json())
    write_atomically(folder / "summary.md", markdown.summary(of_run))
    write_atomically(folder / "junit.xml", junit.document(of_run))


def _with_headline(run: RunRecord, of_run: Outcome) -> None:
    run.headline = HeadlineRecord(state=of_run.headline.state, sentence=of_run.headline.sentence)
