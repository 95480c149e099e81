"""A field of a case on both sides: the bits of LAMMPS' arrays first, then what the bounds say of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lammps_cases.comparison.compare import excess
from lammps_cases.records.outcome import ChangeKind, FieldOutcome, StepOutcome
from lammps_cases.records.run_record import Verdict
from lammps_cases.records.wording import INSIDE
from lammps_cases.regression.change import Closer, Policy, SideChange, closest, judged
from lammps_cases.regression.outcomes import Sample, Samples


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
        samples = _samples(kept[0].of(one.name), kept[1].of(other.name))
        difference = None if samples is None else _difference(*samples)
        kind, step, note = _parted(one, other, samples, difference)
        change = replace(change, kind=kind, step=step, difference=difference, note=note)
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
    """The kind of change of a field, the first step at which its bits part, and a remark."""
    ours, theirs = ({at.step: at for at in field.steps} for field in (one, other))
    if ours.keys() != theirs.keys():
        return "changed", None, "compared at other steps"
    parted: list[tuple[StepOutcome, StepOutcome, bool]] = []  # with whether the bits are recorded
    for step, mine in ours.items():
        at = theirs[step]
        recorded = bool(mine.digest and at.digest)
        same = mine.digest == at.digest
        if not recorded and samples is not None and samples[0].step == step:
            recorded, same = True, samples[0].values_n.tobytes() == samples[1].values_n.tobytes()
        if not (recorded and same):
            parted.append((mine, at, recorded))
    if not parted:
        return "same bits", None, ""
    first = next((mine.step for mine, _, recorded in parted if recorded), None)
    note = "" if any(recorded for *_, recorded in parted) else "bits not known: a run of before there were digests"
    alike = judged(one) == judged(other)
    # Two arrays that the same findings explain lie within the bound of the same variant at every step.
    explained = one.verdict == "explained"
    at_sample = samples is not None and difference is not None and difference <= 1
    outside = [
        recorded
        for mine, at, recorded in parted
        if not (
            _inside(mine.verdict, at.verdict, explained) or (at_sample and samples and samples[0].step == mine.step)
        )
    ]
    if alike and not outside:
        return "within bounds", first, note
    unknown = alike and not any(outside) and one.max_over_bound == other.max_over_bound
    return "cannot tell" if unknown else "changed", first, note


def _inside(one: Verdict, other: Verdict, explained: bool) -> bool:
    good = (*INSIDE, "explained") if explained else INSIDE
    return one in good and other in good


def _samples(one: Sample | None, other: Sample | None) -> tuple[Sample, Sample] | None:
    """Two arrays that can be held against each other."""
    if one is None or other is None or one.step != other.step or one.values_n.shape != other.values_n.shape:
        return None
    return one, other


def _difference(one: Sample, other: Sample) -> float:
    """Largest difference over the smaller of the two bounds."""
    bound_n = np.minimum(one.bound_n, other.bound_n).astype(float)
    ratio_n = excess(one.values_n.astype(float), other.values_n.astype(float), bound_n)[1]
    return float(ratio_n.max(initial=0.0))
