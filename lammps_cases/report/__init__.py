"""Reports of a run: a page for people, a summary for a pull request, JUnit for a CI server.

Everything is made from the models of ``run.json`` and, where present, the per-atom arrays in
``fields/CASE.npz``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.records.faults import part
from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import HeadlineRecord, RunRecord

if TYPE_CHECKING:
    from lammps_cases.findings import Finding
    from lammps_cases.report.history import Past
    from lammps_cases.report.page import Making


def write_report(
    run: RunRecord,
    directory: Path,
    ledger: Sequence[Finding] | None = None,
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
    history : Past, optional
        The runs before this one, as `lammps_cases.report.history.past` gives them; without them the page has no
        such part.
    making : Making, optional
        What makes the articles of cases, such as other processes; this one unless given.

    Returns
    -------
    Path
        The page. The same input gives the same bytes. What cannot be made of the report is noted in the run's faults,
        and costs that part; without its own page or summary the report has a bare one.
    """
    from lammps_cases.findings import LEDGER
    from lammps_cases.report import formats, markdown, page
    from lammps_cases.report.findings import Outcome, outcome

    def judged() -> Outcome:
        of_run = outcome(run, LEDGER if ledger is None else ledger)
        run.headline = HeadlineRecord(state=of_run.headline.state, sentence=of_run.headline.sentence)
        return of_run

    def made() -> tuple[str, str, bytes | None]:
        of_run = part("findings", run.faults, judged, Outcome(run, []))
        begun = lambda: page.RunPage(of_run, directory / "fields", history, making or page.here)  # noqa: E731
        of_cases = part("list of cases", run.faults, begun, None)
        summary = part("summary.md", run.faults, lambda: markdown.summary(of_run), None)
        document = part("junit.xml", run.faults, lambda: formats.junit(of_run), None)
        html = part("page", run.faults, of_cases.render, None) if of_cases else None
        return html or formats.bare_page(run), summary or formats.bare_summary(run), document

    before = [fault.part for fault in run.faults]
    html, summary, document = made()
    if [fault.part for fault in run.faults] != before:  # each says what the others lack
        html, summary, document = made()
    write_atomically(directory / "summary.md", summary)
    (directory / "junit.xml").unlink(missing_ok=True)
    if document:
        write_atomically(directory / "junit.xml", document)
    path = directory / "report.html"
    write_atomically(path, html)
    return path
