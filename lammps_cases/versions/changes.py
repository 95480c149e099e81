"""What became of every case and field from one side, A, to another, B."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

from lammps_cases.records.case_wording import error_text
from lammps_cases.records.outcome import CHANGE_KINDS, CRASHES, NEW, SAME, CaseOutcome, ChangeKind
from lammps_cases.records.run_record import HASH
from lammps_cases.records.wording import INSIDE
from lammps_cases.versions import decks
from lammps_cases.versions.arrays import field_change
from lammps_cases.versions.change import Policy, SideChange, closest
from lammps_cases.versions.outcomes import Samples, Side


@dataclass(frozen=True)
class Changes:
    """Two sides and everything that can be said of each case and field; ``notes`` concern the whole."""

    a: Side
    b: Side
    fields: tuple[SideChange, ...]
    notes: tuple[str, ...] = ()

    @property
    def faults(self) -> tuple[SideChange, ...]:
        """The changes held against side B."""
        return tuple(change for change in self.fields if change.fault)

    @property
    def counts(self) -> dict[ChangeKind, int]:
        """Number of fields (and of cases without fields) of each kind."""
        counts = Counter(change.kind for change in self.fields)
        return {kind: counts[kind] for kind in CHANGE_KINDS if counts[kind]}

    @property
    def different(self) -> list[SideChange]:
        """All changes but those that are none."""
        return [change for change in self.fields if change.kind not in SAME]


def compare(a: Side, b: Side, policy: Policy) -> Changes:
    """Compare two sides by case and field: everything that differs, and everything that does not.

    Two arrays of LAMMPS are `within bounds` of each other if at every step they have the same bits, or both lie within
    the bound of one and the same prediction: of the reference, or of the reference with the same findings.
    """
    changes: list[SideChange] = []
    policy = replace(policy, drifts=not a.program or a.program != b.program)
    for name in sorted(a.cases.keys() | b.cases.keys()):
        one, other = a.cases.get(name), b.cases.get(name)
        if one is None or other is None:
            verdicts = one.verdict if one else "", other.verdict if other else ""
            closer = closest(bool(one and one.agrees), bool(other and other.agrees))
            changes.append(SideChange(name, "", "new case" if one is None else "missing case", closer, "", verdicts))
        elif one.ended == other.ended == "answered":
            changes += _of_deck(one, other, (a.samples(name), b.samples(name)), policy)
            changes += _fields(one, other, a, b, policy)
        else:
            changes.append(_without_numbers(one, other))
    judged = tuple(replace(change, fault=policy.faults(change)) for change in changes)
    return Changes(a, b, judged, tuple(_notes(a, b, judged)))


def _notes(a: Side, b: Side, changes: tuple[SideChange, ...]) -> Iterator[str]:
    """Name what makes a comparison say less than it seems to."""
    if a.versions != b.versions:
        names = sorted(k for k in a.versions.keys() | b.versions.keys() if a.versions.get(k) != b.versions.get(k))
        versions = ", ".join(f"{k} {a.versions.get(k, 'none')} and {b.versions.get(k, 'none')}" for k in names)
        yield f"the references that judged differ ({versions}): verdicts may differ for that, bits do not"
    environment = [f"{name} {one} and {other}" for name, one, other in _environment(a, b) if one != other]
    if environment:
        yield f"the environment differs: {'; '.join(environment)}"
    moved = any(change.kind not in (*SAME, *NEW, "missing case") for change in changes)
    if moved and a.engine.library_sha256 and a.engine.library_sha256 == b.engine.library_sha256:
        yield "both sides ran the same library: the machine, the scenes or the reference made what changed"


def _environment(a: Side, b: Side) -> Iterator[tuple[str, str, str]]:
    """Yield what both sides say of how LAMMPS was built and where it ran."""
    sides = [
        {
            "library": side.engine.library_sha256[:HASH],
            "compiler": side.engine.compiler,
            "MPI": side.engine.mpi.removeprefix("MPI") and side.engine.mpi,  # of which MPI was not always said
            "machine": side.machine,
        }
        for side in (a, b)
    ]
    for name, one in sides[0].items():
        if one and sides[1][name]:
            yield name, one, sides[1][name]


# --- a case as a whole


def _without_numbers(one: CaseOutcome, other: CaseOutcome) -> SideChange:
    """Return the change of a case that at least one side has no numbers of."""
    kind = _became(one, other)
    note = "" if one.ended == other.ended else f"{one.ended}, then {other.ended}"
    if kind != "same outcome" and other.message:
        note += f"{': ' * bool(note)}{other.message}"
    sides, findings = (one.verdict, other.verdict), (one.explained_by, other.explained_by)
    closer = closest(one.agrees, other.agrees)
    return SideChange(one.case, "", kind, closer, verdicts=sides, findings=findings, note=note)


def _became(one: CaseOutcome, other: CaseOutcome) -> ChangeKind:
    if one.ended == other.ended:
        if one.ended in ("refused", "unusable") and _other_words(one, other):
            return "changed"
        alike = (one.verdict, one.explained_by) == (other.verdict, other.explained_by)
        return "same outcome" if alike else "judged otherwise"
    if one.ended in CRASHES or other.ended in CRASHES:
        if one.ended in CRASHES and other.ended in CRASHES:
            return "changed"
        return "newly crashed" if other.ended in CRASHES else "no longer crashed"
    if "refused" in (one.ended, other.ended):
        return "newly refused" if other.ended == "refused" else "newly accepted"
    return "changed"


def _other_words(one: CaseOutcome, other: CaseOutcome) -> bool:
    """Return whether LAMMPS' words differ where it matters: a refusal may be reworded if it still fits."""
    if "differs" in (one.verdict, other.verdict) and one.verdict != other.verdict:
        return True
    recorded = bool(one.message and other.message)  # a baseline does not hold them
    words, others = error_text(one.message), error_text(other.message)  # the command may name a scratch folder
    return recorded and words != others and not (one.agrees and other.agrees)


def _of_deck(
    one: CaseOutcome, other: CaseOutcome, kept: tuple[Samples, Samples], policy: Policy
) -> Iterator[SideChange]:
    """Yield what changed of a deck beside its fields: its state, its thermo output, the findings that act on it."""
    whole = SideChange(
        one.case,
        "",
        "judged otherwise",
        closest(one.agrees, other.agrees),
        verdicts=(one.verdict, other.verdict),
        findings=(one.explained_by, other.explained_by),
        by_deck=not policy.drifts,
    )
    for name in () if policy.drifts else decks.STATE:
        if far := decks.first_beyond(*kept, name, every=True):
            yield replace(whole, field=name, kind="changed", step=far.step, note=str(far))
    if one.thermo and other.thermo:
        kind: ChangeKind = "same bits"
        step, note, shown = decks.thermo_parts(one, other) or (None, "", False)
        if note:
            kind = "changed" if shown else "within bounds"
        yield replace(whole, field=decks.OUTPUT, kind=kind, step=step, note=note)
    if one.explained_by != other.explained_by:
        yield whole


# --- a field


def _fields(one: CaseOutcome, other: CaseOutcome, a: Side, b: Side, policy: Policy) -> Iterator[SideChange]:
    ours, others = a.samples(one.case), b.samples(one.case)
    for name in [*one.fields, *(new for new in other.fields if new not in one.fields)]:
        mine, theirs = one.fields.get(name), other.fields.get(name)
        if mine is not None and theirs is not None:
            yield field_change(one.case, mine, theirs, (ours, others), policy)
        elif only := mine or theirs:
            kind: ChangeKind = "new field" if mine is None else "missing field"
            verdicts = mine.verdict if mine else "", theirs.verdict if theirs else ""
            closer = closest(verdicts[0] in INSIDE, verdicts[1] in INSIDE)
            yield SideChange(one.case, name, kind, closer, only.stage, verdicts)
