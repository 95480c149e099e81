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
from lammps_cases.records.wording import brief, number
from lammps_cases.studies.flows import page
from lammps_cases.studies.flows.catalogue import VALIDATIONS
from lammps_cases.studies.flows.page import DOCUMENT, LAMMPS, REFERENCE, FlowRecord, Validated

MEASURED = Path(__file__).with_suffix(".json")
BEGIN, END = "<!-- measured:begin -->", "<!-- measured:end -->"


def joined(parts: Sequence[Validated]) -> Validated:
    """Return several validations on one LAMMPS as one, flows in their order, without curves."""
    runs = [replace(run, curves={}) for part in parts for run in part.runs]
    ordered = sorted(runs, key=lambda run: list(VALIDATIONS).index(run.flow))
    command = " ".join(["eos-ref validate", *dict.fromkeys(run.flow for run in ordered)])  # and no folder of a machine
    return replace(parts[0], command=command, seconds=sum(part.seconds for part in parts), runs=tuple(ordered))


def table(validated: Validated) -> str:
    """Return the errors at the finest resolution with their orders, the quantities, what changes them, as Markdown."""
    lines = [
        "| flow | error of | N | reference | LAMMPS | order, reference | order, LAMMPS |",
        "|---|---|---|---|---|---|---|",
        *(row for name in validated.flows for row in _errors(validated, name)),
        "",
        "| flow | quantity | N | known | reference | LAMMPS |",
        "|---|---|---|---|---|---|",
        *(row for name in validated.flows for row in _quantities(validated, name)),
        "",
        "| flow | run | N | quantity | value | reference | difference | known |",
        "|---|---|---|---|---|---|---|---|",
        *(row for name in validated.flows for row in _alone(validated, name)),
        "",
        *(f"- {name}: {words}." for name in validated.flows for words in page.stops(validated, VALIDATIONS[name])),
    ]
    return "\n".join(lines)


def _alone(validated: Validated, flow: str) -> Iterable[str]:
    """Yield the effect of another unit of length on LAMMPS, as observed, and of each finding on the reference."""
    tabled = not any(run.message for run in validated.of(flow, LAMMPS))
    sides = [side for side in validated.sides(flow) if side != LAMMPS or not tabled]
    runs = tuple(run for run in validated.runs if run.flow == flow and run.side in sides)
    for of in page.effects(replace(validated, runs=runs), VALIDATIONS[flow]):
        yield _row(flow, of.run, str(of.n), of.quantity, of.found, of.ours, of.change, of.published)


def _last(validated: Validated, flow: str) -> tuple[FlowRecord, FlowRecord]:
    ours, theirs = (validated.of(flow, side)[-1] for side in (REFERENCE, LAMMPS))
    return ours, theirs


def _errors(validated: Validated, flow: str) -> Iterable[str]:
    ours, theirs = _last(validated, flow)
    for panel in VALIDATIONS[flow].panels:
        fits = (validated.order(flow, side, panel.name).order for side in (REFERENCE, LAMMPS))
        orders = map(page.order, fits)
        errors = (_said(run, run.errors.get(panel.name)) for run in (ours, theirs))
        yield _row(flow, panel.name, str(ours.n), *errors, *orders)


def _quantities(validated: Validated, flow: str) -> Iterable[str]:
    ours, theirs = _last(validated, flow)
    for quantity in VALIDATIONS[flow].quantities:
        values = (_said(run, run.quantities.get(quantity.name), 4) for run in (ours, theirs))
        yield _row(flow, quantity.name, str(ours.n), number(quantity.published, 4), *values)


def _said(run: FlowRecord, value: float | None, digits: int = 2) -> str:
    if value is None:
        return "stopped" if run.message else ""
    return brief(value) if digits == 2 else number(value, digits)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


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
