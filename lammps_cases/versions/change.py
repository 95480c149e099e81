"""A change from one side to the other, what counts as one, and groups of them: by finding, then by field."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

from lammps_cases.findings import LEDGER
from lammps_cases.records.outcome import CHANGE_KINDS, NEW, SAME, ChangeKind, FieldOutcome
from lammps_cases.records.wording import INSIDE, counted

Closer = Literal["A", "B", "both", "neither"]
UNEXPLAINED = "unexplained"  # outside the bound, without an explaining finding
LISTED = 6  # fields, or cases, named in a line


def closest(a: bool, b: bool) -> Closer:
    """Return the side that agrees with the reference, given whether A does and whether B does."""
    return ("both" if b else "A") if a else "B" if b else "neither"


def judged(field: FieldOutcome) -> tuple[str, tuple[str, ...]]:
    """Reduce a verdict to its meaning for LAMMPS: inside the bound, explained by some findings, or neither."""
    return ("inside", ()) if field.verdict in INSIDE else (field.verdict, field.explained_by)


@cache
def left_to_chance() -> frozenset[str]:
    """Return the findings that leave values without a bound, as they depend on earlier content of memory."""
    return frozenset(entry.id for entry in LEDGER if entry.model_variant and entry.model_variant.undefined)


@dataclass(frozen=True)
class Policy:
    """Which changes count as faults of side B.

    Attributes
    ----------
    bits : other bits within bounds, and an exact field that is only within its bound
    findings : the same bits explained by other findings (those of the case, which other fields may have brought in)
    news : cases and fields that side A does not hold
    drifts : audits of decks by two programs, which drift apart by rounding: both have the same prediction only where
        they begin; with the same program all samples count
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

        Other bits within bounds do not if both sides show a finding that makes values nondeterministic: they
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
    closer : the side that agrees with the reference, or is closer to it; of a twin: the side whose two runs agree
    verdicts, findings, over_bound : of A and of B; a verdict is empty where a side has none
    step : the first at which the bits part
    fault : whether it counts as a fault of B
    by_deck : the same program gives other numbers for an audited deck, so that the deck has changed
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
        """Whether findings explain it: each side agrees with the reference or is explained, and not both agree."""
        agrees = {"A": (True, False), "B": (False, True), "both": (True, True), "neither": (False, False)}[self.closer]
        accounted = (
            verdict in INSIDE or bool(findings) or (not self.field and agreeing)
            for verdict, findings, agreeing in zip(self.verdicts, self.findings, agrees, strict=True)
        )
        return all(accounted) and any(self.findings) and not self.by_deck

    @property
    def by_chance(self) -> list[str]:
        """The findings of both sides that make values nondeterministic: such values have no bound."""
        return sorted(left_to_chance() & set(self.findings[0]) & set(self.findings[1]))

    @property
    def moved(self) -> set[str]:
        """The findings that only one side shows; if both show the same, these."""
        one, other = map(set, self.findings)
        return one ^ other or one


@dataclass(frozen=True)
class ChangeGroup:
    """Changes of one kind with the same finding gained or lost.

    Attributes
    ----------
    trait : a finding, or `UNEXPLAINED`; empty where both sides have the same
    side : the only side that shows it
    fields : number of cases of each field, most first; empty for cases as a whole
    agree : number of fields of A, and of B, that agree with the reference
    """

    kind: ChangeKind
    trait: str
    side: Literal["A", "B", ""]
    cases: tuple[str, ...]
    fields: tuple[tuple[str, int], ...]
    closer: tuple[tuple[Closer, int], ...]
    agree: tuple[int, int]
    fault: bool

    @property
    def count(self) -> int:
        """Number of fields (of cases without fields)."""
        return sum(count for _, count in self.closer)

    @property
    def mostly(self) -> str:
        """The fields with the most cases, or the first of the cases without fields."""
        return _some([f"{name} {count}" for name, count in self.fields] if self.fields else self.cases)

    def sentence(self, a: str = "A", b: str = "B") -> str:
        """Describe the group in one line, with the names of the sides."""
        named = {"A": a, "B": b}
        shown = f"{self.trait} in {named[self.side]} only: " if self.side else ""
        return f"{self.kind}: {shown}{self._extent}{self._against(named)}"

    @property
    def _extent(self) -> str:
        cases = counted(len(self.cases), "case")
        if not self.fields:
            return f"{cases} ({self.mostly})"
        if len(self.fields) == 1:
            return f"{self.fields[0][0]} in {cases}"
        return f"{self.count} fields of {cases} ({self.mostly})"

    def _against(self, named: Mapping[str, str]) -> str:
        """Name the side that agrees with the reference, or is closer to it."""
        tally = dict(self.closer)
        for side, agreeing in zip("AB", self.agree, strict=True):
            if agreeing == self.count and set(tally) == {side}:
                return f"; {named[side]} agrees with the reference"
        counts = [f"{named.get(side, side)} {tally[side]}" for side in ("A", "B", "both", "neither") if tally.get(side)]
        return f"; closer to the reference: {', '.join(counts)}" if set(tally) != {"neither"} else ""


def groups(changes: Iterable[SideChange]) -> list[ChangeGroup]:
    """Group all real changes; the largest group first within a kind.

    A field that gained one finding and lost another is in the groups of both.
    """
    members: dict[tuple[ChangeKind, str, Literal["A", "B", ""], bool], list[SideChange]] = {}
    for change in changes:
        if change.kind in SAME:
            continue
        for trait, side in _moved(change):
            members.setdefault((change.kind, trait, side, bool(change.field)), []).append(change)
    collected = [_group(kind, trait, side, same) for (kind, trait, side, _), same in members.items()]
    return sorted(collected, key=lambda g: (-CHANGE_KINDS.index(g.kind), -g.count, g.trait, g.side))


def _moved(change: SideChange) -> list[tuple[str, Literal["A", "B", ""]]]:
    """List the findings that only one of the sides shows."""
    traits: list[tuple[str, Literal["A", "B", ""]]] = []
    if change.kind not in ("within bounds", "new case", "missing case", "new field", "missing field"):
        one, other = (
            {UNEXPLAINED} if change.field and verdict == "differs" else set(findings)
            for verdict, findings in zip(change.verdicts, change.findings, strict=True)
        )
        traits += [(trait, "A") for trait in sorted(one - other)]
        traits += [(trait, "B") for trait in sorted(other - one)]
    return traits or [("", "")]


def _group(kind: ChangeKind, trait: str, side: Literal["A", "B", ""], members: Sequence[SideChange]) -> ChangeGroup:
    fields = Counter(change.field for change in members if change.field)
    closer = Counter(change.closer for change in members)
    one, other = (sum(change.verdicts[at] in INSIDE for change in members) for at in (0, 1))
    return ChangeGroup(
        kind,
        trait,
        side,
        tuple(sorted({change.case for change in members})),
        tuple(sorted(fields.items(), key=lambda item: (-item[1], item[0]))),
        tuple(sorted(closer.items())),
        (one, other),
        any(change.fault for change in members),
    )


def _some(names: Sequence[str]) -> str:
    """Name the first of some things, and the number of the others."""
    rest = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f", {rest} more" if rest > 0 else "")
