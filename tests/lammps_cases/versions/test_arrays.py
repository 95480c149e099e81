"""A field on both sides: which side is closer to the reference, and conclusions from its arrays without digests."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lammps_cases.records.case_parts import Verdict
from lammps_cases.records.outcome import ChangeKind, FieldOutcome
from lammps_cases.versions.change import Policy, left_to_chance
from lammps_cases.versions.changes import closer, field_change
from lammps_cases.versions.outcomes import Sample
from tests.support.made_sides import Kept, field, sample

NONE = (Kept(), Kept())


@pytest.mark.parametrize(
    ("one", "other", "side"),
    [
        (("pass", 0.9), ("exact", 0.0), "both"),
        (("pass", 0.9), ("explained", 0.1), "A"),
        (("differs", 0.1), ("pass", 0.9), "B"),
        (("differs", 2.0), ("explained", 3.0), "A"),
        (("differs", 3.0), ("differs", 2.0), "B"),
        (("differs", 2.0), ("differs", 2.001), "neither"),  # a baseline keeps three digits
        (("differs", 2.0), ("differs", 2.01), "A"),
        (("differs", None), ("differs", 2.0), "neither"),
        (("differs", math.inf), ("differs", math.inf), "neither"),
    ],
)
def test_closer_side(one: tuple[Verdict, float | None], other: tuple[Verdict, float | None], side: str) -> None:
    ours, theirs = (field(verdict=verdict, over=over) for verdict, over in (one, other))
    assert closer(ours, theirs) == side
    assert closer(theirs, ours) == {"A": "B", "B": "A"}.get(side, side)


@pytest.mark.parametrize(
    ("mine", "theirs", "kind", "difference"),
    [
        (sample(1.0, 2.0), sample(1.0, 2.0), "same bits", 0.0),
        (sample(0.0), sample(-0.0), "within bounds", 0.0),  # different bits
        (sample(1.0, 2.0), sample(1.0, 2.5), "within bounds", 0.5),
        (sample(1.0, 2.0), sample(1.0, 2.5, bound=0.25), "changed", 2.0),
        (sample(1.0, step=3), sample(1.0, step=4), "cannot tell", None),
        (None, sample(1.0), "cannot tell", None),
    ],
)
def test_arrays_replace_missing_digests(
    mine: Sample | None, theirs: Sample | None, kind: ChangeKind, difference: float | None
) -> None:
    """Both runs leave the bound equally; only arrays that both saved for the same step are conclusive."""
    old = field(verdict="differs", bits="", over=9.0)
    kept = [Kept(**({"f": each} if each else {})) for each in (mine, theirs)]
    change = field_change("one", old, old, (kept[0], kept[1]), Policy())
    assert (change.kind, change.difference) == (kind, difference)
    assert ("bits unknown" in change.note) == (kind == "cannot tell")


def test_nan_is_never_within_a_bound() -> None:
    old = field(verdict="differs", bits="", over=9.0)
    change = field_change("one", old, old, (Kept(f=sample(np.nan)), Kept(f=sample(1.0))), Policy())
    assert (change.kind, change.difference) == ("changed", math.inf)


def test_change_has_the_values_of_both_sides() -> None:
    one = replace(field(verdict="explained", findings=["a"], over=2.0), atom_type=2)
    other: FieldOutcome = replace(one, verdict="pass", explained_by=(), max_over_bound=0.5, stage="eos")
    change = field_change("case", one, other, NONE, Policy())
    assert (change.case, change.field, change.stage, change.closer) == ("case", "f (type 2)", "eos", "B")
    assert (change.verdicts, change.findings) == (("explained", "pass"), (("a",), ()))
    assert (change.over_bound, change.kind) == ((2.0, 0.5), "judged otherwise")
    assert field_change("case", one, replace(other, digest="bb"), NONE, Policy()).kind == "changed"


def test_different_steps_are_a_different_comparison() -> None:
    one, other = (field(bits=bits, steps=[(step, "pass", "d")]) for bits, step in (("aa", 1), ("bb", 2)))
    change = field_change("one", one, other, NONE, Policy())
    assert (change.kind, change.step, change.note) == ("changed", None, "compared at different steps")


@pytest.mark.parametrize("both", [True, False])
def test_nondeterministic_values_are_reported_without_a_bound(both: bool) -> None:
    """This holds if both sides are nondeterministic; if only one is, the finding itself has changed."""
    chance = min(left_to_chance())
    one = field(verdict="explained", bits="a", findings=[chance], steps=[(0, "explained", "a")])
    other = field(
        verdict="explained", bits="b", findings=[chance if both else "another"], steps=[(0, "explained", "b")]
    )
    change = field_change("one", one, other, NONE, Policy())
    assert (f"values without a bound, which depend on what memory held before: {chance}" in change.note) == both
