"""Reports of a run: a page for people, a summary for a pull request, JUnit for a CI server.

Everything is made from the models of ``run.json`` and, where present, the per-atom arrays in
``fields/CASE.npz``.
"""

from __future__ import annotations

from pathlib import Path

from lammps_cases.records import RunRecord, write_atomically


def write_report(run: RunRecord, directory: Path) -> Path:
    """Write ``summary.md``, ``junit.xml`` and ``report.html`` into a report folder.

    Parameters
    ----------
    run : RunRecord
        The run, of cases or of an audit.
    directory : Path
        Report folder; ``fields/CASE.npz`` is read from it where a case has fields and the file exists.

    Returns
    -------
    Path
        The page. The same input gives the same bytes.

    Raises
    ------
    InputError
        plotly, whose script is embedded in the page, is not installed.
    """
    from lammps_cases.report import junit, markdown, page

    write_atomically(directory / "summary.md", markdown.summary(run))
    write_atomically(directory / "junit.xml", junit.document(run))
    path = directory / "report.html"
    write_atomically(path, page.render(run, directory / "fields"))
    return path
