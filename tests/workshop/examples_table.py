"""The table of docs/examples.md: contributions to the error of whole decks, measured by ``eos-ref examples --full``.

``python -m tests.workshop.examples_table REPORT`` reads the numbers of a report, and rewrites the table.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lammps_cases.audit import budgets
from lammps_cases.audit.examples import DOCUMENT, NAME, Examples
from lammps_cases.records.files import write_atomically

FILE = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).parents[2] / "docs" / "examples.md"
MARKS = "<!-- measured -->", "<!-- end -->"


def rows(examples: Examples) -> list[dict[str, Any]]:
    """Return a row for every run that a closed solution was compared with, LAMMPS' own and those of logs among them."""
    deviations: list[dict[str, Any]] = []
    for example in examples.examples:
        own = {"deck": example.name, "lammps": examples.engine.distribution}
        deviations.extend(
            own | {"run": part.name, "step": part.step, "away": part.deviation, "adds": part.contribution}
            for part in budgets.parts(example.case)
        )
        for log in example.logs:
            away = budgets.log_deviation(example.case.closed, log.columns)
            if away is not None:
                deviations.append(
                    own | {"run": f"log of {log.version}", "step": away[0], "away": away[1], "adds": None}
                )
    return deviations


def table(measured: Iterable[dict[str, Any]]) -> str:
    """Return rows as a table of Markdown."""
    lines = ["| deck | run | step | difference | what this adds |", "|---|---|---|---|---|"]
    for of in measured:
        who = f"LAMMPS {of['lammps']}" if of["run"] == budgets.LAMMPS else of["run"]
        shown = [of["deck"], who, str(of["step"]), budgets.percent(of["away"]), budgets.percent(of["adds"])]
        lines.append(f"| {' | '.join(shown)} |".replace("|  |", "| |"))
    return "\n".join(lines)


def page(text: str, measured: Iterable[dict[str, Any]]) -> str:
    """Return the text of the document with the table of some rows between its marks."""
    before, _, rest = text.partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    return f"{before}{MARKS[0]}\n\n{table(measured)}\n\n{MARKS[1]}{after}"


def main(report: str) -> None:
    """Keep the rows of a report, and write the document."""
    measured = rows(DOCUMENT.read(Path(report) / NAME))
    write_atomically(FILE, json.dumps(measured, indent=1) + "\n")
    write_atomically(PAGE, page(PAGE.read_text(encoding="utf-8"), measured))


if __name__ == "__main__":
    main(*sys.argv[1:])
