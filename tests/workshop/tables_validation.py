"""The measurements in docs/validation.md: ``python -m tests.workshop.tables_validation [FOLDER...]``.

Merges folders of validations, keeps them as ``tables_validation.json`` without their curves, and writes the table of
the document.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import number
from lammps_cases.studies.flows import page
from lammps_cases.studies.flows.catalogue import VALIDATIONS
from lammps_cases.studies.flows.known import Flow
from lammps_cases.studies.flows.record import DOCUMENT, LAMMPS, REFERENCE, Validated

MEASURED = Path(__file__).with_suffix(".json")
BEGIN, END = "<!-- measured:begin -->", "<!-- measured:end -->"


def joined(parts: Sequence[Validated]) -> Validated:
    """Return several validations on one LAMMPS as one, flows in their order, without curves."""
    runs = [replace(run, curves={}) for part in parts for run in part.runs]
    ordered = sorted(runs, key=lambda run: list(VALIDATIONS).index(run.flow))
    command = " ".join(["eos-ref validate", *dict.fromkeys(run.flow for run in ordered)])  # and no folder of a machine
    return replace(parts[0], command=command, seconds=sum(part.seconds for part in parts), runs=tuple(ordered))


def table(validated: Validated) -> str:
    """Return numbers and errors by N with their orders, error bars, and what spoils them in LAMMPS, as Markdown."""
    flows = [VALIDATIONS[name] for name in validated.flows]
    lines = [
        "| flow | number | run | N | value | known | order |",
        "|---|---|---|---|---|---|---|",
        *(row for of in flows for row in _rows(validated, of)),
        "",
        *(f"- {of.name}: {words}." for of in flows for words in _said(validated, of)),
    ]
    return "\n".join(lines)


def _rows(validated: Validated, of: Flow) -> Iterable[str]:
    """Yield the rows of both sides, and of the other set-ups of the reference."""
    sides = (REFERENCE, LAMMPS, *(f"{REFERENCE}, {name}" for name in of.setups))
    for row in page.rows(validated, of):
        if row.side in sides:
            ns, values = (", ".join(words) or "stopped" for words in (map(str, row.values), map(row.shown, row.values)))
            known = "" if row.is_error else number(row.known)
            yield f"| {' | '.join((of.name, row.name, row.side, ns, values, known, page.order(row.order)))} |"


def _said(validated: Validated, of: Flow) -> Iterable[str]:
    """Yield the error bar, the findings that spoil the flow, and why sides stopped."""
    yield from (f"error bar {words}" for title, words in page.statements(validated, of) if title == "error bar")
    yield from (f"`{bug}` spoils it in LAMMPS: {words}" for bug, words in page.spoils(validated, of).items())
    yield from page.stops(validated, of)


def document(text: str, validated: Validated) -> str:
    """Return a document with the table inserted."""
    return placed(text, table(validated))


def placed(text: str, words: str) -> str:
    """Return a document with the measurements inserted."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n{words}\n{END}{rest.split(END)[1]}"


def main(folders: Sequence[str]) -> None:
    """Merge validations, and write the table."""
    if folders:
        DOCUMENT.write(MEASURED, joined([DOCUMENT.read(Path(folder) / "validate.json") for folder in folders]))
    path = Path(__file__).parents[2] / "docs" / "validation.md"
    write_atomically(path, document(path.read_text(encoding="utf-8"), DOCUMENT.read(MEASURED)))


if __name__ == "__main__":
    main(sys.argv[1:])
