"""Expected differences between LAMMPS and the reference: a finding, or the explanation of a map."""

from __future__ import annotations

from dataclasses import dataclass

from lammps_cases.findings import LEDGER
from lammps_cases.studies.stability.lines import Agreement
from lammps_cases.studies.stability.maps import maps
from lammps_cases.studies.stability.model import MapCell


@dataclass(frozen=True)
class ExpectedDifference:
    """The reason why the engines differ; ``finding``: id of a ledger entry, empty where no statement is broken."""

    finding: str
    why: str


def expected_difference(line: Agreement | MapCell) -> ExpectedDifference | None:
    """Return the known reason why the engines differ on a line, or in a cell, if any."""
    for entry in LEDGER:
        for where in entry.expected_in_maps:
            if where.map == line.map and where.layer in (None, line.layer):
                return ExpectedDifference(entry.id, where.why)
    of = maps().get(line.map)
    return ExpectedDifference("", of.engines_differ) if of and of.engines_differ else None


def unexplained(lines: list[Agreement]) -> list[Agreement]:
    """Return the lines that differ for no expected reason."""
    return [line for line in lines if expected_difference(line) is None]
