"""Findings of the ledger that explain why LAMMPS and the reference fail at different places."""

from __future__ import annotations

from dataclasses import dataclass

from lammps_cases.stability.lines import Agreement
from lammps_cases.stability.model import Cell


@dataclass(frozen=True)
class Known:
    """A map on which a finding makes the engines differ.

    Attributes
    ----------
    map, layer : where; layer None: on all of them
    finding : id of a ledger entry
    why : how the finding moves the boundary
    """

    map: str
    finding: str
    why: str
    layer: str | None = None


KNOWN: tuple[Known, ...] = ()


def finding(line: Agreement | Cell) -> Known | None:
    """What explains that the engines differ on a line, or in a cell; None: nothing known."""
    return next((k for k in KNOWN if k.map == line.map and k.layer in (None, line.layer)), None)


def unexplained(lines: list[Agreement]) -> list[Agreement]:
    """The lines that differ for no known reason."""
    return [line for line in lines if finding(line) is None]
