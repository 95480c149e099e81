"""The table of bad input on disk: ``inputs.json``, ``inputs.csv``, and the decks of what LAMMPS takes or dies of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lammps_cases.claims.probes.probe import REACTIONS
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import csv_text, write_atomically
from lammps_cases.versions.inputs.table import InputRow

COLUMNS = (
    *("id", "area", "about", "kind", "mutation", "words", "refusal", "reaction", "text", "taken_for"),
    *("promise", "candidate", "ledger"),
)


@dataclass(frozen=True)
class InputTable:
    """All rows, and the LAMMPS that they are of, by its own account of itself."""

    command: str
    engine: dict[str, str]
    seconds: float
    rows: tuple[InputRow, ...]
    schema: str = SCHEMAS["inputs"]

    @property
    def reactions(self) -> Mapping[str, int]:
        """How many of the inputs that the reference refuses end in each way, the best first."""
        ends = Counter(row.reaction for row in self.rows if row.refusal)
        return {kind: ends[kind] for kind in REACTIONS if ends[kind]}

    @property
    def agreements(self) -> Mapping[str, int]:
        """How many inputs both sides take, one alone, or neither."""
        return dict(Counter(row.agreement for row in self.rows).most_common())

    @property
    def unexplained(self) -> tuple[InputRow, ...]:
        """Those that the manual rules out, and of which no finding speaks."""
        return tuple(row for row in self.rows if row.candidate and not row.ledger)


DOCUMENT = Document("inputs", InputTable)


def write(table: InputTable, folder: Path) -> None:
    """Write ``inputs.json`` and ``inputs.csv``."""
    rows = ([getattr(row, name) for name in COLUMNS] for row in table.rows)
    write_atomically(folder / "inputs.csv", csv_text([COLUMNS, *rows]))
    DOCUMENT.write(folder / "inputs.json", table)


def read(folder: Path) -> InputTable:
    """Return the table of a folder.

    Raises
    ------
    InputError
        There is none, or it is of another schema.
    """
    return DOCUMENT.read(folder / "inputs.json")


def changes(before: Sequence[InputRow], after: Sequence[InputRow]) -> list[tuple[InputRow, InputRow]]:
    """Return the inputs that both tables have and that end in another way, or with another reading."""
    old = {row.id: row for row in before}
    pairs = [(old[row.id], row) for row in after if row.id in old]
    return [(a, b) for a, b in pairs if (a.reaction, a.taken_for) != (b.reaction, b.taken_for)]


def document(table: InputTable) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    return DOCUMENT.plain(table)
