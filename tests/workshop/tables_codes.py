"""The table of whole codes in docs/accuracy.md: ``python -m tests.workshop.tables_codes [FOLDER]``.

Keeps the codes of the chart in FOLDER as ``tables_codes.json``, and writes their table into the document.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

from lammps_cases.records.files import write_atomically
from lammps_cases.studies.chart.codes import rows, without
from lammps_cases.studies.chart.record import DOCUMENT, Chart
from tests.workshop.tables_validation import placed

MEASURED = Path(__file__).with_suffix(".json")


def kept(chart: Chart) -> Chart:
    """Return only the whole codes of a chart, without the paths of the machine."""
    sections = tuple(section for section in chart.sections if section.codes)
    command = "eos-ref chart codes" + (" --quick" if chart.quick else "") + (" --pysph PYTHON" * (not without(chart)))
    engine = {key: value for key, value in chart.engine.items() if key != "library"}
    seconds = sum(section.seconds for section in sections)
    return replace(chart, command=command, engine=engine, sections=sections, seconds=seconds)


def table(chart: Chart) -> str:
    """Return a row for every code and flow as Markdown: errors and seconds, the finest's particles and steps."""
    return "\n".join(_lines(chart))


def _lines(chart: Chart) -> Iterator[str]:
    about = chart.engine["distribution"] + (f", PySPH {chart.engine['pysph']}" if "pysph" in chart.engine else "")
    yield f"`{chart.command}`, LAMMPS {about}, {chart.machine['processor']}:"
    yield "\n| flow, error of | code | N: error in seconds of one core | particles, steps at the finest N |"
    yield "|---|---|---|---|"
    every = [row for section in chart.sections for row in rows(section.codes)]
    for (flow, measure, code), of in groupby(every, key=lambda row: row[:3]):
        runs = list(of)
        cells = "; ".join(
            f"{n}: {error}" + (f" in {seconds} s" if seconds != "0" else "") for *_, n, _, _, seconds, error in runs
        )
        yield f"| {flow}, {measure} | {code} | {cells} | {runs[-1][4]}, {runs[-1][5]} |"
    if words := without(chart):
        yield f"\n{words}"


def main(folders: Sequence[str]) -> None:
    """Keep the measurement, and write the table."""
    for folder in folders:
        DOCUMENT.write(MEASURED, kept(DOCUMENT.read(Path(folder) / "chart.json")))
    path = Path(__file__).parents[2] / "docs" / "accuracy.md"
    write_atomically(path, placed(path.read_text(encoding="utf-8"), table(DOCUMENT.read(MEASURED))))


if __name__ == "__main__":
    main(sys.argv[1:])
