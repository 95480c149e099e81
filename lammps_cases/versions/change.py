"""A change from one side to the other, and what counts as one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

from lammps_cases.records.outcome import NEW, SAME, ChangeKind, FieldOutcome
from lammps_cases.records.wording import INSIDE

Closer = Literal["A", "B", "both", "neither"]


def closest(a: bool, b: bool) -> Closer:
    """Return the side that agrees with the reference, given whether A does and whether B does."""
    return ("both" if b else "A") if a else "B" if b else "neither"


def judged(field: FieldOutcome) -> tuple[str, tuple[str, ...]]:
    """Reduce a verdict to what it says of LAMMPS: inside the bound, explained by some findings, or neither."""
    return ("inside", ()) if field.verdict in INSIDE else (field.verdict, field.explained_by)


@cache
def left_to_chance() -> frozenset[str]:
    """Return the findings that leave values without a bound, as they depend on what memory held before."""
    from lammps_cases.findings import LEDGER

    return frozenset(entry.id for entry in LEDGER if entry.model_variant and entry.model_variant.undefined)


@dataclass(frozen=True)
class Policy:
    """What is held against side B.

    Attributes
    ----------
    bits : other bits within bounds, and an exact field that is only within its bound
    findings : the same bits explained by other findings (those of the case, which other fields may have brought in)
    news : cases and fields that side A does not hold
    drifts : audits of decks by two programs, which drift apart by rounding: only where they begin do both have one
        prediction; by the same program all samples count
    """

    bits: bool = False
    findings: bool = False
    news: bool = True
    drifts: bool = True

    def alike(self, one: FieldOutcome, other: FieldOutcome) -> bool:
        """Return whether the same bits were judged the same."""
        if self.bits and one.verdict != other.verdict:
            return False
        if self.findings and one.explained_by != other.explained_by:
            return False
        return judged(one)[0] == judged(other)[0]

    def faults(self, change: SideChange) -> bool:
        """Return whether a change counts.

        Other bits within bounds do not where both sides show a finding by which LAMMPS leaves values to chance: they
        depend on what the same process ran before.
        """
        if change.kind in SAME:
            return False
        if change.kind == "within bounds":
            return self.bits and not change.by_chance
        return self.news or change.kind not in NEW


@dataclass(frozen=True)
class SideChange:
    """One field of a case, or the case as a whole (``field`` empty), on both sides.

    Attributes
    ----------
    closer : the side that agrees with the reference, or is closer to it; of a twin: whose two runs agree
    verdicts, findings, over_bound : of A and of B; a verdict is empty where a side has none
    step : the first at which the bits part
    fault : whether it is held against B
    by_deck : the same program gives other numbers of an audited deck: the deck is another one
    difference : largest difference of the two LAMMPS arrays, over the bound, at the worst step if both kept that
    """

    case: str
    field: str
    kind: ChangeKind
    closer: Closer = "neither"
    stage: str = ""
    verdicts: tuple[str, str] = ("", "")
    findings: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    over_bound: tuple[float | None, float | None] = (None, None)
    step: int | None = None
    difference: float | None = None
    note: str = ""
    fault: bool = False
    by_deck: bool = False

    @property
    def known(self) -> bool:
        """Whether findings account for it: each side agrees with the reference or is explained, and not both agree."""
        agrees = {"A": (True, False), "B": (False, True), "both": (True, True), "neither": (False, False)}[self.closer]
        accounted = (
            verdict in INSIDE or bool(findings) or (not self.field and agreeing)
            for verdict, findings, agreeing in zip(self.verdicts, self.findings, agrees, strict=True)
        )
        return all(accounted) and any(self.findings) and not self.by_deck

    @property
    def by_chance(self) -> list[str]:
        """The findings of both sides by which LAMMPS leaves values to chance: such values have no bound."""
        return sorted(left_to_chance() & set(self.findings[0]) & set(self.findings[1]))

    @property
    def moved(self) -> set[str]:
        """The findings that one side alone shows; where both show the same, these."""
        one, other = map(set, self.findings)
        return one ^ other or one
