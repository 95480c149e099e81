"""The files of a run: run.json and the reports made from it."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.records.faults import part
from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import HeadlineRecord, RunRecord
from lammps_cases.report import history

if TYPE_CHECKING:
    from lammps_cases.report.history import Past
    from lammps_cases.report.page import Making


def write_run(
    run: RunRecord,
    folder: Path,
    past: Past | None = None,
    making: Making | None = None,
) -> None:
    """Write run.json and the reports made from it; see `lammps_cases.report.formats.write_report`."""
    from lammps_cases.report import formats

    with _uncollected():
        made = lambda: formats.write_report(run, folder, history=past, making=making)  # noqa: E731
        if part("report", run.faults, made, None) is None:
            write_atomically(folder / "summary.md", formats.bare_summary(run))
            write_atomically(folder / "report.html", formats.bare_page(run))
        write_atomically(folder / "run.json", run.to_json())  # last: it holds what the report lacks


def write_kept_run(run: RunRecord, folder: Path, making: Making | None = None) -> None:
    """Write a run with the runs before it, and keep it in the user's history."""
    past = past_of(run)
    write_run(run, folder, past, making)
    before = len(run.faults)
    part("entry in the history", run.faults, lambda: history.collect(run, folder), None)
    if len(run.faults) > before:
        write_run(run, folder, past, making)


def past_of(run: RunRecord) -> Past | None:
    """Return what the report of a run shows of the runs before it."""
    return part("history", run.faults, lambda: history.past(run), None)


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
    from lammps_cases.report import formats, markdown
    from lammps_cases.report.findings import outcome

    def made() -> tuple[str, bytes]:
        of_run = outcome(run)
        run.headline = HeadlineRecord(state=of_run.headline.state, sentence=of_run.headline.sentence)
        return markdown.summary(of_run), formats.junit(of_run)

    summary, document = part("summary.md", run.faults, made, None) or (formats.bare_summary(run), None)
    write_atomically(folder / "run.json", run.to_json())
    write_atomically(folder / "summary.md", summary)
    if document:
        write_atomically(folder / "junit.xml", document)
