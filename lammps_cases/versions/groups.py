"""Hundreds of changed fields as a few lines: by the findings that came or went, then by field."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from lammps_cases.records.outcome import CHANGE_KINDS, SAME, ChangeKind
from lammps_cases.records.wording import INSIDE, counted
from lammps_cases.versions.change import Closer, SideChange

UNEXPLAINED = "unexplained"  # outside the bound, and no finding says why
LISTED = 6  # fields, or cases, named in a line


@dataclass(frozen=True)
class ChangeGroup:
    """Changes of one kind that share what came or went.

    Attributes
    ----------
    trait : a finding, or `UNEXPLAINED`; empty where what is said of both sides is the same
    side : the only one that shows it
    fields : how many cases each field is of, most first; empty for cases as a whole
    agree : how many fields of A, and of B, agree with the reference
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
        """Number of fields (of cases, where they have no fields)."""
        return sum(count for _, count in self.closer)

    @property
    def mostly(self) -> str:
        """The fields with the most cases, or the first of the cases where they have no fields."""
        return _some([f"{name} {count}" for name, count in self.fields] if self.fields else self.cases)

    def sentence(self, a: str = "A", b: str = "B") -> str:
        """Describe the group in one line, with what the sides are called."""
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
        """Say which side agrees with the reference, or is closer to it."""
        tally = dict(self.closer)
        for side, agreeing in zip("AB", self.agree, strict=True):
            if agreeing == self.count and set(tally) == {side}:
                return f"; {named[side]} agrees with the reference"
        counts = [f"{named.get(side, side)} {tally[side]}" for side in ("A", "B", "both", "neither") if tally.get(side)]
        return f"; closer to the reference: {', '.join(counts)}" if set(tally) != {"neither"} else ""


def groups(changes: Iterable[SideChange]) -> list[ChangeGroup]:
    """Group all changes but those that are none; the largest group first within a kind.

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
    """List what only one of the sides shows."""
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
    """Name the first of some things, and how many more there are."""
    rest = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f", {rest} more" if rest > 0 else "")
