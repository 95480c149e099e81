"""A field of a case on both sides: the bits of LAMMPS' arrays first, then what the bounds say of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from lammps_cases.comparison.compare import excess
from lammps_cases.records.outcome import ChangeKind, FieldOutcome, StepOutcome
from lammps_cases.records.wording import INSIDE
from lammps_cases.versions.change import Closer, Policy, SideChange, closest, judged
from lammps_cases.versions.decks import first_beyond
from lammps_cases.versions.outcomes import Sample, Samples


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
        samples = (mine, theirs) if mine and theirs and _comparable(mine, theirs) else None
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
    # A baseline keeps three digits of them; more would say nothing of which side is better.
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
    """Compare the bits at a step by their digests, or else by the arrays if they are of this step."""
    if one.digest and other.digest:
        return "same" if one.digest == other.digest else "other"
    if samples is not None and samples[0].step == one.step:
        return "same" if samples[0].values_n.tobytes() == samples[1].values_n.tobytes() else "other"
    return "unknown"


def _comparable(one: Sample, other: Sample) -> bool:
    return one.step == other.step and one.values_n.shape == other.values_n.shape


def _difference(one: Sample, other: Sample) -> float:
    """Return the largest difference over the smaller of the two bounds."""
    bound_n = np.minimum(one.bound_n, other.bound_n).astype(float)
    ratio_n = excess(one.values_n.astype(float), other.values_n.astype(float), bound_n)[1]
    return float(ratio_n.max(initial=0.0))
