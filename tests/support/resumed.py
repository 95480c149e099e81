"""Reports of runs, compared bit for bit except for times and the use of the store of predictions."""

from __future__ import annotations

from pathlib import Path

from lammps_cases.records.case_parts import Predictions, Seconds
from lammps_cases.records.run_record import read_run
from lammps_cases.report.formats import write_report


def report(directory: Path, scratch: Path) -> dict[str, bytes]:
    """The files of a report, rendered again without seconds, date, command and the origin of its predictions."""
    names = {path.name for path in directory.iterdir()}
    assert names == {"run.json", "fields", "report.html", "summary.md", "junit.xml"}, "complete, and nothing else"
    run = read_run(directory)
    for case in run.cases:
        case.seconds, case.predictions = Seconds(), Predictions()
    run.seconds, run.date, run.command = 0.0, "", ""
    arrays = {path.name: path.read_bytes() for path in (directory / "fields").iterdir()}
    assert not [name for name in arrays if name.startswith(".")], "no file in the making"
    (scratch / "fields").mkdir(parents=True, exist_ok=True)
    for name, content in arrays.items():
        (scratch / "fields" / name).write_bytes(content)
    write_report(run.counted(), scratch)
    rendered = {path.name: path.read_bytes() for path in scratch.iterdir() if path.is_file()}
    return {"run.json": run.to_json().encode(), **rendered, **arrays}
