"""What became of every case and field from one side, A, to another, B."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from lammps_cases.records.wording import INSIDE
from lammps_cases.regression.arrays import field_change
from lammps_cases.regression.kinds import KINDS, NEWS, Change, Closer, Kind, Policy
from lammps_cases.regression.seen import CRASHES, CaseSeen, Side


@dataclass(frozen=True)
class Changes:
    """Two sides and everything that can be said of each case and field; ``notes`` concern the whole."""

    a: Side
    b: Side
    fields: tuple[Change, ...]
    notes: tuple[str, ...] = ()

    @property
    def faults(self) -> tuple[Change, ...]:
        """What is held against side B."""
        return tuple(change for change in self.fields if change.fault)

    @property
    def counts(self) -> dict[Kind, int]:
        """How many fields (and cases without fields) are of each kind."""
        found: dict[Kind, int] = dict.fromkeys(KINDS, 0)
        for change in self.fields:
            found[change.kind] += 1
        return {kind: count for kind, count in found.items() if count}


def compare(a: Side, b: Side, policy: Policy) -> Changes:
    """Everything that differs, and everything that does not, by case and field.

    Two arrays of LAMMPS are `within bounds` of each other if at every step they have the same bits, or both lie within
    the bound of one and the same prediction: of the reference, or of the reference with the same findings.
    """
    found: list[Change] = []
    for case in sorted(a.cases.keys() | b.cases.keys()):
        one, other = a.cases.get(case), b.cases.get(case)
        if one is None or other is None:
            found.append(_alone(one, other))
        elif one.ended == other.ended == "answered":
            found += _fields(one, other, a, b, policy)
        else:
            found.append(_outcomes(one, other))
    weighed = tuple(replace(change, fault=policy.faults(change.kind)) for change in found)
    return Changes(a, b, weighed, tuple(_notes(a, b, weighed)))


def _notes(a: Side, b: Side, found: tuple[Change, ...]) -> Iterator[str]:
    """What makes a comparison say less than it seems to."""
    if a.versions != b.versions:
        names = sorted(k for k in a.versions.keys() | b.versions.keys() if a.versions.get(k) != b.versions.get(k))
        said = ", ".join(f"{k} {a.versions.get(k, 'none')} and {b.versions.get(k, 'none')}" for k in names)
        yield f"the references that judged differ ({said}): verdicts may differ for that, bits do not"
    moved = any(change.kind not in ("same bits", "same outcome", *NEWS, "missing case") for change in found)
    if moved and a.engine.library_sha256 and a.engine.library_sha256 == b.engine.library_sha256:
        yield "both sides ran the same library: the machine, the scenes or the reference made what changed"


# --- a case as a whole


def _alone(one: CaseSeen | None, other: CaseSeen | None) -> Change:
    case = one or other
    assert case is not None
    kind: Kind = "missing case" if other is None else "new case"
    sides = (one.verdict if one else "", other.verdict if other else "")
    closer: Closer = "neither" if not case.agrees else "A" if other is None else "B"
    return Change(case.case, "", kind, closer, verdicts=sides)


def _outcomes(one: CaseSeen, other: CaseSeen) -> Change:
    """A case that at least one side has no numbers of."""
    kind = _became(one, other)
    note = "" if one.ended == other.ended else f"{one.ended}, then {other.ended}"
    if kind != "same outcome" and other.message:
        note += f"{': ' * bool(note)}{other.message}"
    closer: Closer = "neither"
    if one.agrees or other.agrees:
        closer = "both" if one.agrees and other.agrees else "A" if one.agrees else "B"
    sides, known = (one.verdict, other.verdict), (one.findings, other.findings)
    return Change(one.case, "", kind, closer, verdicts=sides, findings=known, note=note)


def _became(one: CaseSeen, other: CaseSeen) -> Kind:
    if one.ended == other.ended:
        if one.ended in ("refused", "unusable") and _other_words(one, other):
            return "changed"
        return "same outcome" if (one.verdict, one.findings) == (other.verdict, other.findings) else "judged otherwise"
    if one.ended in CRASHES or other.ended in CRASHES:
        if one.ended in CRASHES and other.ended in CRASHES:
            return "changed"
        return "newly crashed" if other.ended in CRASHES else "no longer crashed"
    if "refused" in (one.ended, other.ended):
        return "newly refused" if other.ended == "refused" else "newly accepted"
    return "changed"


def _other_words(one: CaseSeen, other: CaseSeen) -> bool:
    """Whether LAMMPS said something else that matters: a refusal may be worded anew if it says what is expected."""
    if "differs" in (one.verdict, other.verdict) and one.verdict != other.verdict:
        return True
    told = bool(one.message and other.message)  # a baseline does not hold them
    return told and one.message != other.message and not (one.agrees and other.agrees)


# --- a field


def _fields(one: CaseSeen, other: CaseSeen, a: Side, b: Side, policy: Policy) -> Iterator[Change]:
    ours, others = a.samples(one.case), b.samples(one.case)
    for name in [*one.fields, *(new for new in other.fields if new not in one.fields)]:
        mine, theirs = one.fields.get(name), other.fields.get(name)
        if mine is None or theirs is None:
            kind: Kind = "new field" if mine is None else "missing field"
            sides = (mine.verdict if mine else "", theirs.verdict if theirs else "")
            stage = mine.stage if mine else theirs.stage if theirs else ""
            inside = (mine.verdict if mine else theirs.verdict if theirs else "") in INSIDE
            closer: Closer = "neither" if not inside else "A" if theirs is None else "B"
            yield Change(one.case, name, kind, closer, stage, sides)
        else:
            yield field_change(one.case, mine, theirs, (ours, others), policy)
