"""Change of a field, of the ending of a case and of a whole side; groups of changes, and times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lammps_cases.findings import LEDGER
from lammps_cases.records.case_parts import FieldRecord, StepRecord, Verdict
from lammps_cases.records.files import write_arrays
from lammps_cases.records.outcome import ABOUT, CHANGE_KINDS, CaseOutcome, ChangeKind, FieldOutcome
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.versions.change import Policy, SideChange, groups, left_to_chance
from lammps_cases.versions.changes import compare, field_change
from lammps_cases.versions.outcomes import Sample, Samples, Side, comparable
from lammps_cases.versions.timing import TOTAL, Turns, of_saved
from tests.support.made_sides import Kept, case, ended, field, sample, side

LENIENT, STRICT = Policy(), Policy(bits=True, findings=True)
TURNED = {"A": "B", "B": "A"}
INF = math.inf
CHANCE = min(left_to_chance())
OTHER = min(entry.id for entry in LEDGER if entry.id not in left_to_chance())


def of(
    verdict: Verdict = "pass",
    over: float | None = 0.5,
    bits: str = "aa",
    findings: Sequence[str] = (),
    steps: Sequence[tuple[int, Verdict, str]] = (),
) -> FieldOutcome:
    return field("f", verdict, bits, over, findings, steps)


def change(
    one: FieldOutcome,
    other: FieldOutcome,
    mine: Sample | None = None,
    theirs: Sample | None = None,
    policy: Policy = LENIENT,
) -> SideChange:
    """The change of a field; its turn, from B to A, has the same kind and the sides exchanged."""
    kept = [Kept(**({"f": each} if each else {})) for each in (mine, theirs)]
    found = field_change("one", one, other, (kept[0], kept[1]), policy)
    turned = field_change("one", other, one, (kept[1], kept[0]), policy)
    assert (turned.kind, turned.difference, turned.step) == (found.kind, found.difference, found.step)
    assert turned.closer == TURNED.get(found.closer, found.closer)
    return replace(found, fault=policy.faults(found))


# --- a field


@pytest.mark.parametrize(
    ("one", "other", "kind", "closer"),
    [
        (("pass", 0.5), ("exact", 0.0), "within bounds", "both"),
        (("pass", 0.9), ("pass", 0.25), "within bounds", "both"),
        (("pass", 0.5), ("differs", 3.0), "changed", "A"),
        (("pass", 0.9), ("explained", 0.1), "changed", "A"),
        (("differs", 0.1), ("pass", 0.9), "changed", "B"),
        (("differs", 2.0), ("explained", 3.0), "changed", "A"),
        (("differs", 3.0), ("differs", 5.0), "changed", "A"),
        (("differs", INF), ("differs", 5.0), "changed", "B"),
        (("differs", 2.0), ("differs", 2.001), "changed", "neither"),  # a baseline keeps three digits
        (("differs", 2.0), ("differs", 2.01), "changed", "A"),
        (("differs", None), ("differs", 2.0), "changed", "neither"),
        (("differs", INF), ("differs", INF), "changed", "neither"),
    ],
)
def test_other_bits(
    one: tuple[Verdict, float | None], other: tuple[Verdict, float | None], kind: ChangeKind, closer: str
) -> None:
    """Within bounds they are a fault only if strict."""
    for policy in (LENIENT, STRICT):
        found = change(of(*one, findings="x" * (one[0] == "explained")), of(*other, bits="bb"), policy=policy)
        assert (found.kind, found.closer, found.fault) == (kind, closer, kind == "changed" or policy is STRICT)


@pytest.mark.parametrize(
    ("one", "other", "kind", "strictly"),
    [
        *(
            (of(verdict), of(verdict), "same bits", "same bits")
            for verdict in ("exact", "pass", "explained", "differs")
        ),
        (of("explained", findings="x"), of("differs"), "judged otherwise", "judged otherwise"),
        (of("explained", findings="x"), of("explained", findings="xy"), "same bits", "judged otherwise"),
        (of("exact"), of("pass"), "same bits", "judged otherwise"),
        # Arrays within bounds of a variant need the same findings.
        (of("explained", 9, findings="x"), of("explained", 8, "bb", "x"), "within bounds", "within bounds"),
        (of("explained", 9, findings="x"), of("explained", 8, "bb", "xy"), "changed", "changed"),
        (of("explained", 9, findings="x"), of("pass", bits="bb"), "changed", "changed"),
    ],
)
def test_bits_verdicts_and_findings(
    one: FieldOutcome, other: FieldOutcome, kind: ChangeKind, strictly: ChangeKind
) -> None:
    found = change(one, other)
    assert (found.kind, found.step, found.fault) == (kind, None, kind in ("changed", "judged otherwise"))
    assert change(one, other, policy=STRICT).kind == strictly


OUTSIDE, NO_BITS = of("differs", 9), of("differs", 9, "")  # outside the bound; as a run before digests


@pytest.mark.parametrize(
    ("one", "mine", "theirs", "kind", "difference"),
    [
        # Two arrays outside the bound may be within it, the smaller of two, of each other.
        (OUTSIDE, sample(10.0, 3.0), sample(10.5, 2.5), "within bounds", 0.5),
        (OUTSIDE, sample(10.0, 3.0), sample(10.5, 1.0), "changed", 2.0),
        (OUTSIDE, sample(10.0, 3.0, bound=9.0), sample(10.5, 1.0), "changed", 2.0),
        (OUTSIDE, sample(math.nan), sample(math.nan), "changed", INF),
        (OUTSIDE, sample(1.0), sample(1.0, 2.0), "changed", None),  # of other atoms
        # They replace missing digests, if both sides saved the same step.
        (NO_BITS, sample(1.0, 2.0), sample(1.0, 2.0), "same bits", 0.0),
        (NO_BITS, sample(0.0), sample(-0.0), "within bounds", 0.0),  # other bits
        (NO_BITS, sample(1.0, 2.0), sample(1.0, 2.5), "within bounds", 0.5),
        (NO_BITS, sample(1.0, 2.0), sample(1.0, 2.5, bound=0.25), "changed", 2.0),
        (NO_BITS, sample(1.0, step=3), sample(1.0, step=4), "cannot tell", None),
        (NO_BITS, None, sample(1.0), "cannot tell", None),
        (NO_BITS, None, None, "cannot tell", None),
        (NO_BITS, sample(math.nan), sample(1.0), "changed", INF),
    ],
)
def test_arrays_of_both_sides(
    one: FieldOutcome, mine: Sample | None, theirs: Sample | None, kind: ChangeKind, difference: float | None
) -> None:
    found = change(one, replace(one, digest=one.digest and "bb"), mine, theirs)
    assert (found.kind, found.difference) == (kind, difference)
    assert found.fault == (kind in ("changed", "cannot tell"))
    assert ("bits unknown" in found.note) == (kind == "cannot tell")


def test_run_without_digests_is_compared_by_its_verdicts() -> None:
    for other in (of(), of(bits="")):  # no digest is like no other
        found = change(of(bits=""), other)
        assert (found.kind, found.step, found.note) == ("within bounds", None, "bits unknown: the run predates digests")
    assert change(of("differs", 7.5, ""), of("differs", 7.0)).kind == "changed"
    assert change(of("differs", 7.0, ""), of("differs", 7.0)).kind == "cannot tell"


@pytest.mark.parametrize("natoms", [3, 4])
def test_arrays_of_a_sample_of_atoms_are_not_used(tmp_path: Path, natoms: int) -> None:
    write_arrays(tmp_path / "one.npz", {"f.lammps": np.ones(3), "f.bound": np.ones(3)})
    kept = Samples(tmp_path / "one.npz", ".lammps", {"f": 2}, natoms).of("f")
    assert (kept is None) == (natoms > 3)


def test_first_step_with_other_bits_is_named() -> None:
    a = of(steps=[(0, "exact", "p"), (1, "pass", "q"), (5, "pass", "r")])
    kinds: dict[Verdict, ChangeKind] = {"pass": "within bounds", "differs": "changed"}
    for verdict, kind in kinds.items():
        found = change(a, of(verdict, bits="bb", steps=[(0, "exact", "p"), (1, "pass", "Q"), (5, verdict, "R")]))
        assert (found.kind, found.step) == (kind, 1)
    found = change(of(steps=[(0, "pass", "p")]), of(bits="bb", steps=[(1, "pass", "p")]))
    assert (found.kind, found.step, found.note) == ("changed", None, "compared at different steps")


def test_arrays_of_one_step_are_not_conclusive_for_others() -> None:
    a, b, c = (
        of("differs", bits=bits, steps=[(0, "differs", first), (5, "differs", last)])
        for bits, first, last in (("aa", "p", "q"), ("bb", "P", "Q"), ("bb", "p", "Q"))
    )
    assert change(a, b, sample(1.0, step=5), sample(1.0, step=5)).kind == "changed"
    assert change(a, c, sample(1.0, step=5), sample(1.5, step=0)).kind == "changed"
    assert change(a, c, sample(1.0, step=5), sample(1.5, step=5)).kind == "within bounds"


def test_change_has_the_values_of_both_sides() -> None:
    one = replace(of("explained", 2.0, findings=["a"]), atom_type=2, stage="eos")
    found = change(one, replace(one, verdict="pass", explained_by=(), max_over_bound=0.5))
    assert (found.case, found.field, found.stage, found.closer) == ("one", "f (type 2)", "eos", "B")
    assert (found.verdicts, found.findings) == (("explained", "pass"), (("a",), ()))
    assert (found.over_bound, found.kind) == ((2.0, 0.5), "judged otherwise")


@pytest.mark.parametrize("both", [True, False])
def test_nondeterministic_values_are_reported_without_a_bound(both: bool) -> None:
    """This holds if both sides are nondeterministic; if only one is, the finding itself has changed."""
    one, other = (
        of("explained", bits=bits, findings=[finding], steps=[(0, "explained", bits)])
        for bits, finding in (("a", CHANCE), ("b", CHANCE if both else "another"))
    )
    said = f"values without a bound, which depend on what memory held before: {CHANCE}"
    assert (said in change(one, other).note) == both


@pytest.mark.parametrize(
    ("kind", "findings", "counts"),
    [
        ("within bounds", ((), ()), True),
        ("within bounds", ((OTHER,), (OTHER,)), True),
        ("within bounds", ((CHANCE,), ()), True),
        ("within bounds", ((OTHER, CHANCE), (CHANCE,)), False),
        ("changed", ((CHANCE,), (CHANCE,)), True),
        ("judged otherwise", ((CHANCE,), (CHANCE,)), True),
        ("same bits", ((), ()), False),
    ],
)
def test_other_bits_count_except_of_uninitialised_memory(
    kind: ChangeKind, findings: tuple[tuple[str, ...], tuple[str, ...]], counts: bool
) -> None:
    found = SideChange("a.case", "grad/v", kind, findings=findings)
    assert Policy(bits=True).faults(found) == counts
    assert Policy(bits=False).faults(found) == (counts and kind != "within bounds")


# --- the ending of a case, and a whole side

ANSWERED = case("one", of())
REFUSED = ended("refused", "refused", "no")


@pytest.mark.parametrize(
    ("one", "other", "kind", "closer"),
    [
        (REFUSED, REFUSED, "same outcome", "both"),
        (replace(REFUSED, message="a"), replace(REFUSED, message="b"), "same outcome", "both"),
        (ended("refused", "refused", "", "a"), ended("refused", "refused", "", "b"), "changed", "neither"),
        (
            *(ended("refused", "refused", "", f"a Last input line: read_data /tmp/{k}/data") for k in (1, 2)),
            *("same outcome", "neither"),
        ),
        (REFUSED, ended("refused", "differs", "no"), "changed", "A"),
        (ended("refused", "explained", "no", findings="x"), REFUSED, "judged otherwise", "B"),
        (REFUSED, ended("accepted", "differs", "no"), "newly accepted", "A"),
        (ended("accepted", "differs", "no"), REFUSED, "newly refused", "B"),
        (ANSWERED, ended("refused", "refused"), "newly refused", "A"),
        (ANSWERED, ended("crashed", "crashed"), "newly crashed", "A"),
        (ANSWERED, ended("timeout", "timeout"), "newly crashed", "A"),
        (ended("crashed", "explained", "no"), REFUSED, "no longer crashed", "B"),
        (ended("crashed", "crashed", "", "pid 1"), ended("crashed", "crashed", "", "pid 2"), "same outcome", "neither"),
        (ended("crashed", "crashed"), ended("timeout", "timeout"), "changed", "neither"),
        (ANSWERED, ended("unusable", "differs"), "changed", "A"),
    ],
)
def test_changes_of_the_ending_of_a_case(one: CaseOutcome, other: CaseOutcome, kind: ChangeKind, closer: str) -> None:
    (found,) = compare(side(one), side(other), LENIENT).fields
    assert (found.kind, found.closer, found.field) == (kind, closer, "")
    assert found.fault == (kind != "same outcome")


def test_cases_and_fields_of_one_side() -> None:
    a = side(case("both", field("f"), field("gone")), case("gone", field()))
    b = side(case("both", field("f"), field("new")), case("new", field()))
    found = compare(a, b, LENIENT)
    assert {(c.case, c.field): c.kind for c in found.fields} == {
        ("both", "f"): "same bits",
        ("both", "gone"): "missing field",
        ("both", "new"): "new field",
        ("gone", ""): "missing case",
        ("new", ""): "new case",
    }
    assert set(found.counts.values()) == {1} and set(found.counts) < set(CHANGE_KINDS) == set(ABOUT)
    told = {c.kind for c in compare(a, b, Policy(news=False)).fields if not c.fault}
    assert told == {"same bits", "new field", "new case"}


def test_different_references_and_environments_are_reported() -> None:
    engines = (
        EngineRecord(library_sha256="ab" * 32, compiler="GNU C++ 14", mpi="MPICH"),
        EngineRecord(library_sha256="cd" * 32, compiler="GNU C++ 12", mpi="Open MPI"),
        EngineRecord(library_sha256="ab" * 32, mpi="MPI"),
    )
    a, b, c = (replace(side(case("one", field())), engine=engine) for engine in engines)
    parts = "library abababab and cdcdcdcd; compiler GNU C++ 14 and GNU C++ 12; MPI MPICH and Open MPI"
    assert compare(a, b, LENIENT).notes == (f"the environment differs: {parts}",)
    assert compare(a, c, LENIENT).notes == ()
    c.versions["eos-ref"] = "0.2.0"
    assert "eos-ref 0.1.0 and 0.2.0" in compare(a, c, LENIENT).notes[0]


# --- comparable outcomes from the record of a run


def _twin(difference: float) -> CaseRecord:
    step = StepRecord(step=1, verdict="pass", max_abs=difference, max_over_bound=0.1, digest="aa")
    found = FieldRecord(field="f", stage="twin", verdict="pass", max_abs=difference, digest="aa", steps=[step])
    return CaseRecord(case="one", verdict="pass", twin="boost", fields=[found])


def test_digest_of_a_twin_includes_its_second_run() -> None:
    same, other = (compare(side(comparable(_twin(1.0))), side(comparable(_twin(d))), LENIENT) for d in (1.0, 2.0))
    assert same.fields[0].kind == "same bits"
    assert (other.fields[0].kind, other.fields[0].step) == ("within bounds", 1)


def test_case_with_numbers_counts_as_answered_and_fields_of_an_audit_are_distinguished_by_type() -> None:
    one, two = (FieldRecord(field="pressure", stage="eos", verdict="pass", atom_type=t, digest=f"{t}") for t in (1, 2))
    assert comparable(CaseRecord(case="one", verdict="refused", ended="refused")).ended == "refused"
    assert comparable(CaseRecord(case="one", verdict="refused", ended="refused", fields=[one])).ended == "answered"
    audited = comparable(CaseRecord(case="deck", verdict="pass", fields=[one, two]))
    assert list(audited.fields) == ["pressure (type 1)", "pressure (type 2)"]


# --- groups: hundreds of changes in a few lines


def _sides() -> tuple[Side, Side]:
    before = [case(f"c{k:03}", *(field(n) for n in "fvx")) for k in range(100)]
    after = [case(f"c{k:03}", *(field(n, "explained", "bb", 1e9, ["heavy"]) for n in "fvx")) for k in range(100)]
    odd = case("odd", field("f", verdict="differs", over=2.0, bits="cc"))
    shut = ended("refused", "refused", name="shut")
    return side(*before, case("odd", field("f")), case("shut", field())), side(*after, odd, shut)


def test_three_hundred_fields_are_summarised_in_one_line_with_the_names_of_the_sides() -> None:
    assert [group.sentence() for group in groups(compare(*_sides(), LENIENT).fields)] == [
        "newly refused: 1 case (shut); A agrees with the reference",
        "changed: heavy in B only: 300 fields of 100 cases (f 100, v 100, x 100); A agrees with the reference",
        "changed: unexplained in B only: f in 1 case; A agrees with the reference",
    ]
    turned = [group.sentence("old", "new") for group in groups(compare(*_sides()[::-1], LENIENT).fields)]
    said = "changed: heavy in old only: 300 fields of 100 cases (f 100, v 100, x 100); new agrees with the reference"
    assert said in turned


def test_field_that_exchanged_findings_is_in_both_groups_and_an_unchanged_one_in_none() -> None:
    a, b = side(case("one", of("explained", 4.0, "aa", "pq"))), side(case("one", of("explained", 3.0, "bb", "qr")))
    found = groups(compare(a, b, LENIENT).fields)
    assert [(g.trait, g.side, g.count) for g in found] == [("p", "A", 1), ("r", "B", 1)]
    assert found[0].sentence() == "changed: p in A only: f in 1 case; closer to the reference: B 1"
    assert groups(compare(a, a, LENIENT).fields) == []


# --- times


def test_single_calls_give_a_ratio_without_an_answer() -> None:
    """A machine that was busy during one run slows all of its cases, which no interval over cases shows."""
    a, b = ([case(f"c{k}", field(), seconds=s * (k + 1)) for k in range(20)] for s in (0.01, 0.02))
    refused = ended("refused", "refused")
    found = of_saved(side(*a), side(*b, refused))
    assert found is not None
    assert (found.count, found.ratio.median, found.answer) == (20, 2.0, "cannot tell")
    assert "single calls" in found.sentence()
    assert of_saved(side(*a), side(refused)) is None


def test_alternating_times_are_compared_round_by_round() -> None:
    drift = tuple(1.5**k for k in range(9))
    turns = Turns({(TOTAL, "A"): drift, (TOTAL, "B"): tuple(1.01 * t for t in drift)})
    (slower,), (faster,) = turns.against("A", "B"), turns.against("B", "A")
    assert (slower.answer, faster.answer) == ("slower", "faster")
    assert slower.sentence("old", "new").endswith("(9 rounds in turns): new is slower")


def test_single_scene_is_slower_only_if_every_round_is() -> None:
    """One of several 95 % intervals may exclude 1 by chance; the same ratios of all scenes together are conclusive."""
    once = (0.99, *(1.01 + 0.001 * k for k in range(8)))
    times = {(name, side): once if side == "B" else (1.0,) * 9 for name in (TOTAL, "shift") for side in "AB"}
    together, shift = Turns(times).against("A", "B")
    assert (together.answer, shift.answer) == ("slower", "cannot tell")
    times["shift", "B"] = tuple(1.01 + 0.001 * k for k in range(9))
    assert Turns(times).against("A", "B")[1].answer == "slower"
