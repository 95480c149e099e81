"""The changes of every case and field from one side, A, to another, B.

Of a field the bits of LAMMPS' arrays are compared first, then its bounds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lammps_cases.comparison.compare import excess
from lammps_cases.records.case_wording import error_text
from lammps_cases.records.outcome import (
    CHANGE_KINDS,
    CRASHES,
    NEW,
    SAME,
    CaseOutcome,
    ChangeKind,
    FieldOutcome,
    StepOutcome,
)
from lammps_cases.records.run_record import HASH
from lammps_cases.records.wording import INSIDE
from lammps_cases.versions import outcomes
from lammps_cases.versions.change import Closer, Policy, SideChange, closest, judged
from lammps_cases.versions.outcomes import Sample, Samples, Side, first_beyond


@dataclass(frozen=True)
class Changes:
    """Two sides with the change of each case and field; ``notes`` concern the comparison as a whole."""

    a: Side
    b: Side
    fields: tuple[SideChange, ...]
    notes: tuple[str, ...] = ()

    @property
    def faults(self) -> tuple[SideChange, ...]:
        """The changes that count as faults of side B."""
        return tuple(change for change in self.fields if change.fault)

    @property
    def counts(self) -> dict[ChangeKind, int]:
        """Number of fields (and of cases without fields) of each kind."""
        counts = Counter(change.kind for change in self.fields)
        return {kind: counts[kind] for kind in CHANGE_KINDS if counts[kind]}

    @property
    def different(self) -> list[SideChange]:
        """All changes but those of kind `SAME`."""
        return [change for change in self.fields if change.kind not in SAME]


def compare(a: Side, b: Side, policy: Policy) -> Changes:
    """Compare two sides by case and field, equal ones included.

    Two arrays of LAMMPS are `within bounds` of each other if at every step they have the same bits, or both lie within
    the bound of the same prediction: of the reference, or of the reference with the same findings.
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
    """Describe the limits of a comparison."""
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
    """Yield how LAMMPS was built and where it ran, as far as both sides record it."""
    sides = [
        {
            "library": side.engine.library_sha256[:HASH],
            "compiler": side.engine.compiler,
            "MPI": side.engine.mpi.removeprefix("MPI") and side.engine.mpi,  # older runs lack its name
            "machine": side.machine,
        }
        for side in (a, b)
    ]
    for name, one in sides[0].items():
        if one and sides[1][name]:
            yield name, one, sides[1][name]


def _without_numbers(one: CaseOutcome, other: CaseOutcome) -> SideChange:
    """Return the change of a case for which at least one side has no numbers."""
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
    """Return whether LAMMPS' words differ where it matters: a refusal may be reworded if it still matches."""
    if "differs" in (one.verdict, other.verdict) and one.verdict != other.verdict:
        return True
    recorded = bool(one.message and other.message)  # a baseline does not hold them
    words, others = error_text(one.message), error_text(other.message)  # the command may contain a scratch folder
    return recorded and words != others and not (one.agrees and other.agrees)


def _of_deck(
    one: CaseOutcome, other: CaseOutcome, kept: tuple[Samples, Samples], policy: Policy
) -> Iterator[SideChange]:
    """Yield the changes of a deck other than its fields: its state, its thermo output, the findings that act on it."""
    whole = SideChange(
        one.case,
        "",
        "judged otherwise",
        closest(one.agrees, other.agrees),
        verdicts=(one.verdict, other.verdict),
        findings=(one.explained_by, other.explained_by),
        by_deck=not policy.drifts,
    )
    for name in () if policy.drifts else outcomes.STATE:
        if far := outcomes.first_beyond(*kept, name, every=True):
            yield replace(whole, field=name, kind="changed", step=far.step, note=str(far))
    if one.thermo and other.thermo:
        kind: ChangeKind = "same bits"
        step, note, shown = outcomes.thermo_parts(one, other) or (None, "", False)
        if note:
            kind = "changed" if shown else "within bounds"
        yield replace(whole, field=outcomes.OUTPUT, kind=kind, step=step, note=note)
    if one.explained_by != other.explained_by:
        yield whole


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


def field_change(
    case: str, one: FieldOutcome, other: FieldOutcome, kept: tuple[Samples, Samples], policy: Policy
) -> SideChange:
    """Return the change of a field that both sides have; ``kept`` are their arrays."""
    change = SideChange(
        case,
        one.name,
        "same bits",
        closer(one, other),
        other.stage,
        (one.verdict, other.verdict),
        (one.explained_by, other.explained_by),
        (one.max_over_bound, other.max_over_bound),
    )
    if not one.digest or one.digest != other.digest:
        mine, theirs = kept[0].of(one.name), kept[1].of(other.name)
        same = mine and theirs and (mine.step, mine.values_n.shape) == (theirs.step, theirs.values_n.shape)
        samples = (mine, theirs) if mine and theirs and same else None
        difference = _difference(*samples) if samples else None
        kind, step, note = _parted(one, other, samples, difference)
        far = first_beyond(*kept, one.name, every=not policy.drifts)
        if far is not None and (not policy.drifts or {one.verdict, other.verdict} <= {*INSIDE}):
            kind = "changed"
        note = "; ".join(filter(None, [note, str(far or "")]))
        by_deck = far is not None and not policy.drifts
        change = replace(change, kind=kind, step=step, difference=difference, note=note, by_deck=by_deck)
        if kind == "within bounds" and change.by_chance:
            note = f"values without a bound, which depend on what memory held before: {', '.join(change.by_chance)}"
            change = replace(change, note=note)
    alike = change.kind != "same bits" or policy.alike(one, other)
    return change if alike else replace(change, kind="judged otherwise")


def closer(one: FieldOutcome, other: FieldOutcome) -> Closer:
    """Return the side that agrees with the reference; if none does, the one whose worst atom is fewer bounds away."""
    agreeing = closest(one.verdict in INSIDE, other.verdict in INSIDE)
    ours, theirs = one.max_over_bound, other.max_over_bound
    # A baseline keeps three digits; more would not decide which side is better.
    if agreeing != "neither" or ours is None or theirs is None or f"{ours:.2e}" == f"{theirs:.2e}":
        return agreeing
    return "A" if ours < theirs else "B"


def _parted(
    one: FieldOutcome, other: FieldOutcome, samples: tuple[Sample, Sample] | None, difference: float | None
) -> tuple[ChangeKind, int | None, str]:
    """Return the kind of change of a field, the first step at which its bits part, and a remark."""
    ours, theirs = ({at.step: at for at in field.steps} for field in (one, other))
    if ours.keys() != theirs.keys():
        return "changed", None, "compared at different steps"
    bits = {step: _bits(at, theirs[step], samples) for step, at in ours.items()}
    parted = [step for step in bits if bits[step] != "same"]
    if not parted:
        return "same bits", None, ""
    recorded = [step for step in parted if bits[step] == "other"]
    first = recorded[0] if recorded else None
    note = "" if recorded else "bits unknown: the run predates digests"
    # Two arrays that the same findings explain lie within the bound of the same variant at every step.
    good = (*INSIDE, "explained") if one.verdict == "explained" else INSIDE
    inside = {step for step in parted if ours[step].verdict in good and theirs[step].verdict in good}
    if samples is not None and difference is not None and difference <= 1:
        inside.add(samples[0].step)
    outside = [step for step in parted if step not in inside]
    alike = judged(one) == judged(other)
    if alike and not outside:
        return "within bounds", first, note
    unknown = alike and not set(outside) & set(recorded) and one.max_over_bound == other.max_over_bound
    return "cannot tell" if unknown else "changed", first, note


def _bits(
    one: StepOutcome, other: StepOutcome, samples: tuple[Sample, Sample] | None
) -> Literal["same", "other", "unknown"]:
    """Compare the bits at a step by their digests, else by the arrays if they are of this step."""
    if one.digest and other.digest:
        return "same" if one.digest == other.digest else "other"
    if samples is not None and samples[0].step == one.step:
        return "same" if samples[0].values_n.tobytes() == samples[1].values_n.tobytes() else "other"
    return "unknown"


def _difference(one: Sample, other: Sample) -> float:
    bound_n = np.minimum(one.bound_n, other.bound_n).astype(float)
    ratio_n = excess(one.values_n.astype(float), other.values_n.astype(float), bound_n)[1]
    return float(ratio_n.max(initial=0.0))
