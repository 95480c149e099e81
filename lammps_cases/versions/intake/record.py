"""``adopt.json``: what became of the ledger, the claims and the bad inputs on an engine that is taken in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.faults import MissingPart
from lammps_cases.records.run_record import EngineRecord

FindingStatus = Literal["there", "gone in some cases", "gone", "not asked"]


@dataclass(frozen=True)
class FindingRow:
    """A finding of the ledger on the engine: the cases and probes that show it, and those that would and do not.

    Attributes
    ----------
    known : whether it was seen on this very version before
    expected : whether it was seen on the nearest version that is known
    """

    id: str
    title: str
    severity: str
    status: FindingStatus
    known: bool
    expected: bool
    cases: tuple[str, ...]
    gone: tuple[str, ...]


@dataclass(frozen=True)
class ClaimRow:
    """A claim of the manual on the engine."""

    id: str
    text: str
    verdict: str
    findings: tuple[str, ...]
    unexplained: bool


@dataclass(frozen=True)
class AdoptedInput:
    """A bad input, and what LAMMPS does with it."""

    id: str
    words: str
    reaction: str
    text: str
    ledger: str


@dataclass(frozen=True)
class Difference:
    """A case that differs, or ends otherwise, without an explanation."""

    case: str
    verdict: str
    message: str


@dataclass(frozen=True)
class Adoption:
    """An engine taken in.

    Attributes
    ----------
    nearest : folder of the accepted baseline that differs least
    changed : by baseline, how many fields and cases are not the same
    differences : what changed from the nearest baseline, a sentence for each group
    seconds : wall time of each part
    faults : what is missing because eos-ref failed to make it
    """

    engine: EngineRecord
    date: str
    command: str
    findings: tuple[FindingRow, ...]
    claims: tuple[ClaimRow, ...]
    inputs: tuple[AdoptedInput, ...]
    unexplained: tuple[Difference, ...]
    skipped: tuple[Difference, ...]
    counts: dict[str, int]
    nearest: str = ""
    changed: dict[str, int] = field(default_factory=dict)
    differences: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    faults: list[MissingPart] = field(default_factory=list)
    schema: str = SCHEMAS["adopt"]

    @property
    def sentence(self) -> str:
        """Say in a line what became of the ledger."""
        there = sum(row.status in ("there", "gone in some cases") for row in self.findings)
        first = sum(bool(row.cases) and not row.known for row in self.findings)
        gone = sum(row.status == "gone" and row.expected for row in self.findings)
        return f"{there} findings there, {first} of them new here; {gone} gone; {len(self.unexplained)} unexplained"


DOCUMENT = Document("adopt", Adoption)
