"""Reports of a run: a page for people, a summary for a pull request, JUnit for a CI server.

Everything is made from the models of ``run.json`` and, where present, the per-atom arrays in
``fields/CASE.npz``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import RunRecord

if TYPE_CHECKING:
    from lammps_cases.findings import Finding
    from lammps_cases.history.reported import Past
    from lammps_cases.report.drawn import Drawn
    from lammps_cases.report.page import Making


def write_report(
    run: RunRecord,
    directory: Path,
    ledger: Sequence[Finding] | None = None,
    drawn: Mapping[str, Drawn] | None = None,
    history: Past | None = None,
    making: Making | None = None,
) -> Path:
    """Write ``summary.md``, ``junit.xml`` and ``report.html`` into a report folder.

    Parameters
    ----------
    run : RunRecord
        The run, of cases or of an audit.
    directory : Path
        Report folder; ``fields/CASE.npz`` is read from it where a case has fields and the file exists.
    ledger : sequence of Finding, optional
        The findings to look for in the run; the project's own unless given.
    drawn : mapping, optional
        What is shown of cases whose arrays were at hand; those of the others are read.
    history : Past, optional
        The runs before this one, as `lammps_cases.history.past` gives them; without them the page has no such part.
    making : Making, optional
        What makes the articles of cases, such as other processes; this one unless given.

    Returns
    -------
    Path
        The page. The same input gives the same bytes.

    Raises
    ------
    InputError
        plotly, whose script is embedded in the page, is not installed.
    """
    from lammps_cases.findings import LEDGER
    from lammps_cases.report import junit, markdown, page
    from lammps_cases.report.findings import outcome

    of_run = outcome(run, LEDGER if ledger is None else ledger)
    of_cases = page.RunPage(of_run, directory / "fields", drawn, history, making or page.here)
    write_atomically(directory / "summary.md", markdown.summary(of_run))
    write_atomically(directory / "junit.xml", junit.document(of_run))
    path = directory / "report.html"
    write_atomically(path, of_cases.render())
    return path
