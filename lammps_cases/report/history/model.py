"""A run and a case of it as a history stores them; see `lammps_cases.records.outcome` for how the case ended."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from lammps_cases.records.run_record import EngineRecord, RunRecord
from lammps_cases.records.wording import by_severity, kind


@dataclass(frozen=True)
class StoredRun:
    """A run without its cases; ``counts`` is the number of cases of each kind of verdict.

    ``revision`` is the git revision of eos-ref (empty: unknown), ``reference`` the versions of its packages.
    """

    id: int
    sha256: str
    date: str
    engine: EngineRecord
    revision: str
    reference: dict[str, str]
    machine: dict[str, str]
    command: str
    strict: bool
    shard: str
    seconds: float
    counts: dict[str, int]

    @classmethod
    def of(cls, run: RunRecord, sha256: str = "", revision: str = "") -> StoredRun:
        """Return a run record without its cases; ``revision`` is used where the run holds none."""
        counts = dict(Counter(kind(case) for case in run.cases))
        engine = run.engine.model_copy(update={"library": "", "mpi": ""})  # a path, and what the hash says already
        made_by = engine, run.reference.get("git", "") or revision, run.reference, run.machine
        return cls(0, sha256, run.date, *made_by, run.command, run.fail_on == "low", run.shard, run.seconds, counts)

    @property
    def cases(self) -> int:
        """Number of cases."""
        return sum(self.counts.values())

    @property
    def ordered_counts(self) -> dict[str, int]:
        """The counts, from the best verdict to the worst."""
        return by_severity(self.counts)

    @property
    def made_by(self) -> tuple[str, str]:
        """The eos-ref that judged: version and git revision."""
        return self.reference.get("eos-ref", ""), self.revision


@dataclass(frozen=True)
class StoredCase:
    """A case in a run: ids of the run and of the outcome, seconds in LAMMPS and in the reference."""

    run: int
    outcome: int
    case: str
    lammps: float
    reference: float
