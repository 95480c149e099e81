"""The page of `eos-ref inputs`: what becomes of bad input, by argument and one by one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lammps_cases.claims.probes.probe import REACTIONS
from lammps_cases.records.files import write_atomically
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.frame import TableCell, TableRow
from lammps_cases.versions.inputs.record import InputTable
from lammps_cases.versions.inputs.table import counts

ASSETS = Path(__file__).parent / "assets"
ALONE = "LAMMPS alone refuses it"
ABOUT = {
    "clear error": "an error that names the argument, its keyword or the value",
    "vague error": "an error that names none of the words",
    "misleading error": "an error that names other words of the command",
    "warning": "continues, with a warning in the log",
    "no effect": "continues silently; results are bit-identical to those without the bad argument",
    "silent acceptance": "continues silently, with different numbers",
    "silent NaN": "continues silently, to numbers that are not finite",
    "crash": "the process crashes",
    "hang": "the process does not end",
}


def write(table: InputTable, folder: Path) -> None:
    """Write ``report.html``, one file that opens offline."""
    html = frame.page(
        ASSETS,
        "inputs",
        "bad" if table.unexplained else "good",
        engine=table.engine.get("distribution", ""),
        scripts=[frame.FILTER],
        table=table,
        about=ABOUT,
        facts=[
            ("LAMMPS", table.engine.get("distribution") or table.engine.get("version_string", "")),
            ("inputs", len(table.rows)),
            ("took", f"{table.seconds:.0f} s"),
        ],
        columns=["argument", *(f"#{kind}" for kind in _kinds(table)), f"#{ALONE}"],
        arguments=list(_arguments(table)),
        # Ordinary rows make the page long and tell nothing: refused by both with a clear error, or taken by both.
        rows=[row for row in table.rows if not (row.agreement == "both take it" or row.reaction == "clear error")]
        + [row for row in table.rows if row.agreement == ALONE and row.reaction == "clear error"],
    )
    write_atomically(folder / "report.html", html)


def _kinds(table: InputTable) -> list[str]:
    return [kind for kind in REACTIONS if kind in table.reactions]


def _arguments(table: InputTable) -> Iterator[TableRow]:
    """Yield a row for every argument: how its bad inputs end."""
    for (area, about), ends in counts(table.rows).items():
        cells = [TableCell(ends.get(kind, ""), "number") for kind in (*_kinds(table), ALONE)]
        yield TableRow(f"{area}: {about}" if about and about != area else area, cells)
