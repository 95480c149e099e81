"""Content of a run's reports that the page and the summary share, built once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lammps_cases.findings import Finding
from lammps_cases.records.run_record import RunRecord
from lammps_cases.report import agreement, findings


@dataclass(frozen=True)
class Content:
    """A run with its tables of agreement, and the ledger's findings as the run shows them."""

    run: RunRecord
    matrices: list[agreement.Matrix]
    findings: list[findings.RunFinding]

    @classmethod
    def of(cls, run: RunRecord, ledger: Sequence[Finding]) -> Content:
        """Build the content of a run's reports."""
        return cls(run, agreement.matrices(run), findings.of_run(run, ledger))
