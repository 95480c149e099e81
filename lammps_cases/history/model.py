"""What a history holds, as it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from lammps_cases.records.run_record import FieldRecord, Verdict
from lammps_cases.records.wording import EXPECTED_REFUSAL, field_name, size, verdict_kind

# From best to worst; as lammps_cases.records.run_record orders verdicts, with what was skipped last.
KINDS_OF_VERDICT = (
    *("exact", "pass", EXPECTED_REFUSAL, "explained"),
    *("refused", "differs", "timeout", "crashed", "error", "skipped"),
)
Kind = Literal["verdict", "bits", "finding"]
KINDS: tuple[Kind, ...] = ("verdict", "bits", "finding")


@dataclass(frozen=True)
class EngineName:
    """Which LAMMPS answered."""

    name: str
    distribution: str
    version_string: str
    git: str
    library_sha256: str

    @property
    def key(self) -> str:
        """The same for the same library, by whatever name it was called."""
        return self.library_sha256 or " ".join((self.name, self.distribution, self.version_string, self.git))


@dataclass(frozen=True)
class Run:
    """A run without its cases; ``counts`` is the number of cases of each kind of verdict.

    ``revision`` is the git revision of eos-ref (empty: unknown), ``reference`` the versions of its packages.
    """

    id: int
    sha256: str
    date: str
    engine: EngineName
    revision: str
    reference: dict[str, str]
    machine: dict[str, str]
    command: str
    strict: bool
    shard: str
    seconds: float
    counts: dict[str, int]

    @property
    def cases(self) -> int:
        """Number of cases."""
        return sum(self.counts.values())

    @property
    def ordered_counts(self) -> dict[str, int]:
        """The counts, from the best verdict to the worst."""
        return {kind: self.counts[kind] for kind in KINDS_OF_VERDICT if self.counts.get(kind)}

    @property
    def made_by(self) -> tuple[str, str]:
        """The eos-ref that judged: version and git revision."""
        return self.reference.get("eos-ref", ""), self.revision


@dataclass(frozen=True)
class FieldOutcome:
    """How a field of a case ended."""

    field: str
    atom_type: int | None
    verdict: Verdict
    max_over_bound: float | None
    max_abs: float | None
    digest: str
    explained_by: tuple[str, ...]

    @property
    def name(self) -> str:
        """Field, and atom type if it is of one alone."""
        return field_name(self.field, self.atom_type)


@dataclass(frozen=True)
class Outcome:
    """How a case ended: everything but the time it took, so that runs of the same engine share it.

    ``worst`` is the largest difference in units of the bound, ``worst_field`` where it is (empty if there is none);
    ``fields`` are filled by `History.outcomes` only.
    """

    id: int
    case: str
    verdict: Verdict
    expected: bool
    natoms: int
    steps: int
    message: str
    explained_by: tuple[str, ...]
    worst: float | None
    worst_field: str
    fields: tuple[FieldOutcome, ...] = ()

    @property
    def kind(self) -> str:
        """The verdict, with an expected refusal kept apart."""
        return verdict_kind(self.verdict, self.expected)


@dataclass(frozen=True)
class Result:
    """A case in a run: ids of the run and of the outcome, seconds in LAMMPS and in the reference."""

    run: int
    outcome: int
    case: str
    lammps: float
    reference: float


def worst_of(fields: Sequence[FieldRecord | FieldOutcome]) -> tuple[float | None, str]:
    """Largest difference in units of the bound over the fields of a case, and where it is (empty if there is none)."""
    worst = max(fields, key=lambda field: size(field.max_over_bound), default=None)
    ratio = worst.max_over_bound if worst else None
    return ratio, worst.field if worst and ratio else ""
