"""The outcome of a run: for every case and field the verdict, the findings that explain it, the digest of its numbers.

Histories store outcomes, accepted baselines consist of them, and comparisons classify what differs between two of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Literal, get_args

from lammps_cases.records.case_parts import CheckRecord, Ended, FieldRecord, Verdict, digest, worst
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import INSIDE, field_name, listed, size, verdict_kind

CRASHES: tuple[Ended, ...] = ("crashed", "timeout", "error")


@dataclass(frozen=True)
class StepOutcome:
    """A field at one step (None: the only evaluation of a case without steps)."""

    step: int | None
    verdict: Verdict
    digest: str
    max_abs: float | None = None


@dataclass(frozen=True)
class FieldOutcome:
    """Outcome of a field; ``digest`` is empty in runs older than digests."""

    field: str
    verdict: Verdict
    explained_by: tuple[str, ...] = ()
    max_over_bound: float | None = None
    digest: str = ""
    stage: str = ""
    by_step: tuple[StepOutcome, ...] = ()
    atom_type: int | None = None
    max_abs: float | None = None

    @classmethod
    def of(cls, record: FieldRecord, looks: Sequence[CheckRecord] = ()) -> FieldOutcome:
        """Return the outcome that a record of a field holds; the steps of an audit are those of its checks."""
        by_step = tuple(StepOutcome(s.step, s.verdict, s.digest, s.max_abs) for s in record.steps) or _steps(looks)
        bits = [at.digest for at in by_step]
        return cls(
            field=record.field,
            verdict=record.verdict,
            explained_by=tuple(record.explained_by),
            max_over_bound=record.max_over_bound,
            digest=digest(*bits) if looks and all(bits) else record.digest,
            stage=record.stage,
            by_step=by_step,
            atom_type=record.atom_type,
            max_abs=record.max_abs,
        )

    @property
    def name(self) -> str:
        """Name of the field, and atom type if it is restricted to one."""
        return field_name(self.field, self.atom_type)

    @property
    def steps(self) -> tuple[StepOutcome, ...]:
        """Every step; the field as a whole if there is only one evaluation."""
        return self.by_step or (StepOutcome(None, self.verdict, self.digest),)

    @property
    def parts(self) -> dict[Part, str]:
        """The parts of the outcome as text; empty if not recorded."""
        return {"verdict": self.verdict, "bits": self.digest, "finding": listed(self.explained_by)}


def _steps(looks: Sequence[CheckRecord]) -> tuple[StepOutcome, ...]:
    """Return the steps of a field of an audit; runs that check the same step are combined."""
    by_step: dict[int, list[CheckRecord]] = {}
    for look in looks:
        by_step.setdefault(look.step, []).append(look)
    return tuple(
        StepOutcome(
            step,
            worst([look.verdict for look in same]),
            same[0].digest if len(same) == 1 else digest(*(look.digest for look in same)),
            max(look.max_abs for look in same),
        )
        for step, same in sorted(by_step.items())
    )


@dataclass(frozen=True)
class CaseOutcome:
    """Outcome of a case, and its fields by name.

    Attributes
    ----------
    expected : whether the verdict leaves a run green
    expects : text of the refusal that the case tests; empty: none, or not stored (history)
    message : LAMMPS' error message, or the first deviation; empty in a baseline
    seconds : wall time of LAMMPS; 0 where it is not recorded, as in a history, whose runs share outcomes
    thermo : rows of thermo output of an audited deck, each by column
    worst, worst_field : largest difference in units of the bound, and its field (empty: no difference)
    id : key of the outcome in a history
    """

    case: str
    verdict: Verdict
    expected: bool
    ended: Ended = "answered"
    explained_by: tuple[str, ...] = ()
    expects: str = ""
    message: str = ""
    seconds: float = 0.0
    fields: Mapping[str, FieldOutcome] = field(default_factory=dict)
    natoms: int = 0
    steps: int = 0
    worst: float | None = None
    worst_field: str = ""
    id: int = 0
    thermo: tuple[Mapping[str, float], ...] = ()

    @classmethod
    def of(cls, record: CaseRecord) -> CaseOutcome:
        """Return the outcome that a record of a case holds."""
        looks: dict[tuple[str, int], list[CheckRecord]] = {}
        for look in record.checks:
            looks.setdefault((look.field, look.type), []).append(look)
        outcomes = [FieldOutcome.of(each, looks.get((each.field, each.atom_type or 0), ())) for each in record.fields]
        outcome = cls(
            case=record.case,
            verdict=record.verdict,
            expected=record.as_expected,
            ended="answered" if record.fields else record.ended,
            explained_by=tuple(record.explained_by),
            expects=record.expects,
            message=record.message,
            seconds=record.seconds.lammps,
            fields={each.name: each for each in outcomes},
            natoms=record.natoms,
            steps=record.steps,
            thermo=tuple(record.thermo),
        )
        return outcome.with_worst()

    @property
    def kind(self) -> str:
        """The verdict, with an expected refusal kept apart."""
        return verdict_kind(self.verdict, self.expected)

    @property
    def agrees(self) -> bool:
        """Whether it ended as the manual states."""
        return self.verdict in INSIDE or (self.verdict == "refused" and self.expected)

    @property
    def parts(self) -> dict[Part, str]:
        """The parts of the outcome of the case as a whole, as text."""
        return {"verdict": self.kind, "finding": listed(self.explained_by)}

    def with_worst(self) -> CaseOutcome:
        """Return self with the largest difference of its fields."""
        worst = max(self.fields.values(), key=lambda each: size(each.max_over_bound), default=None)
        ratio = worst.max_over_bound if worst else None
        return replace(self, worst=ratio, worst_field=worst.field if worst and ratio else "")

    def restricted(self, pattern: str) -> CaseOutcome:
        """Return the outcome decided by the fields of a pattern alone."""
        fields = {name: each for name, each in self.fields.items() if fnmatchcase(each.field, pattern)}
        worst = max(fields.values(), key=lambda each: size(each.max_over_bound), default=None)
        return replace(self, fields=fields, verdict=worst.verdict if worst else self.verdict).with_worst()


# --- the taxonomy of changes

# The parts of an outcome, each of which may differ between runs. A history counts the cases of each.
Part = Literal["verdict", "bits", "finding"]
PARTS: tuple[Part, ...] = get_args(Part)
# Kinds of such differences, with side A as the standard for side B.
ChangeKind = Literal[
    "same bits",
    "same outcome",
    "within bounds",
    "changed",
    "judged otherwise",
    "cannot tell",
    "newly refused",
    "newly accepted",
    "newly crashed",
    "no longer crashed",
    "new field",
    "missing field",
    "new case",
    "missing case",
]
CHANGE_KINDS: tuple[ChangeKind, ...] = get_args(ChangeKind)
ABOUT: dict[ChangeKind, str] = {
    "same bits": "every bit of LAMMPS' array at every step compared",
    "same outcome": "a case without numbers, ended the same way",
    "within bounds": "different bits; both within the bound of the reference, or of the same findings",
    "changed": "different numbers, or a case that ended differently",
    "judged otherwise": "the same bits, but a different verdict or finding: the reference or the ledger changed",
    "cannot tell": "one side holds no digests of its arrays, and is outside the bound",
    "newly refused": "LAMMPS refuses what it accepted",
    "newly accepted": "LAMMPS accepts what it refused",
    "newly crashed": "LAMMPS crashes or hangs where it did not",
    "no longer crashed": "LAMMPS crashed or hung, and no longer does",
    "new field": "compared only on side B",
    "missing field": "compared only on side A",
    "new case": "only on side B",
    "missing case": "only on side A",
}
SAME: tuple[ChangeKind, ...] = ("same bits", "same outcome")
NEW: tuple[ChangeKind, ...] = ("new field", "new case")


def differences(was: CaseOutcome, now: CaseOutcome) -> Iterator[tuple[str, Part, str, str]]:
    """Yield what differs: field (empty: the case as a whole), part, before, after; only fields that both have.

    Bits differ only where both digests are recorded.
    """
    both = [("", was.parts, now.parts)]
    both += [(name, was.fields[name].parts, each.parts) for name, each in now.fields.items() if name in was.fields]
    for name, before, after in both:
        for part, text in before.items():
            if text != after[part] and (part != "bits" or (text and after[part])):
                yield name, part, text, after[part]
