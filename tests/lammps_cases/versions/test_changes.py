"""Classification of the change of a field and of a case from the records of two sides."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lammps_cases.records.case_parts import FieldRecord, StepRecord, Verdict
from lammps_cases.records.files import write_arrays
from lammps_cases.records.outcome import CHANGE_KINDS, CaseOutcome, ChangeKind
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.versions.change import Policy
from lammps_cases.versions.changes import compare
from lammps_cases.versions.outcomes import Samples, comparable
from tests.support.made_sides import case, ended, field, one_field, sample, side

LENIENT, STRICT = Policy(), Policy(bits=True, findings=True)


@pytest.mark.parametrize("verdict", ["exact", "pass", "explained", "differs"])
def test_equal_digests_are_the_same_bits_for_any_verdict(verdict: Verdict) -> None:
    change = one_field(field(verdict=verdict), field(verdict=verdict))
    assert (change.kind, change.step, change.fault) == ("same bits", None, False)


@pytest.mark.parametrize(
    ("one", "other", "kind", "closer"),
    [
        (("pass", 0.5), ("exact", 0.0), "within bounds", "both"),
        (("pass", 0.5), ("pass", 0.25), "within bounds", "both"),
        (("pass", 0.5), ("differs", 3.0), "changed", "A"),
        (("differs", 3.0), ("exact", 0.0), "changed", "B"),
        (("differs", 3.0), ("differs", 5.0), "changed", "A"),
        (("differs", math.inf), ("differs", 5.0), "changed", "B"),
        (("differs", 5.0), ("differs", 5.0001), "changed", "neither"),
        (("differs", math.inf), ("differs", math.inf), "changed", "neither"),
    ],
)
def test_different_bits(
    one: tuple[Verdict, float], other: tuple[Verdict, float], kind: ChangeKind, closer: str
) -> None:
    change = one_field(field(verdict=one[0], over=one[1]), field(verdict=other[0], over=other[1], bits="bb"))
    assert (change.kind, change.closer, change.fault) == (kind, closer, kind == "changed")


def test_arrays_within_bounds_need_the_same_findings() -> None:
    a = field(verdict="explained", findings=["x"], over=9.0)
    assert one_field(a, field(verdict="explained", findings=["x"], over=8.0, bits="bb")).kind == "within bounds"
    assert one_field(a, field(verdict="explained", findings=["x", "y"], over=8.0, bits="bb")).kind == "changed"
    assert one_field(a, field(verdict="pass", bits="bb")).kind == "changed"


def test_arrays_outside_the_bound_may_be_within_it_of_each_other() -> None:
    a, b = (field(verdict="differs", over=9.0, bits=bits) for bits in ("aa", "bb"))
    near = one_field(a, b, f=(sample(10.0, 3.0), sample(10.5, 2.5)))
    assert (near.kind, near.difference) == ("within bounds", 0.5)
    far = one_field(a, b, f=(sample(10.0, 3.0), sample(10.5, 1.0)))
    assert (far.kind, far.difference) == ("changed", 2.0)
    assert one_field(a, b, f=(sample(10.0, 3.0, bound=9.0), sample(10.5, 1.0))).kind == "changed", "the smaller bound"
    assert one_field(a, b, f=(sample(math.nan), sample(math.nan))).kind == "changed"
    assert one_field(a, b, f=(sample(1.0), sample(1.0, 2.0))).kind == "changed", "arrays of other atoms"


@pytest.mark.parametrize("natoms", [3, 4])
def test_arrays_of_a_sample_of_atoms_are_not_used(tmp_path: Path, natoms: int) -> None:
    write_arrays(tmp_path / "one.npz", {"f.lammps": np.ones(3), "f.bound": np.ones(3)})
    kept = Samples(tmp_path / "one.npz", ".lammps", {"f": 2}, natoms).of("f")
    assert (kept is None) == (natoms > 3)


def test_first_step_with_different_bits_is_named() -> None:
    a = field(bits="aa", steps=[(0, "exact", "p"), (1, "pass", "q"), (5, "pass", "r")])
    b = field(bits="bb", steps=[(0, "exact", "p"), (1, "pass", "Q"), (5, "pass", "R")])
    assert (one_field(a, b).kind, one_field(a, b).step) == ("within bounds", 1)
    worse = field(bits="bb", verdict="differs", steps=[(0, "exact", "p"), (1, "pass", "Q"), (5, "differs", "R")])
    assert (one_field(a, worse).kind, one_field(a, worse).step) == ("changed", 1)


def test_arrays_of_one_step_are_not_conclusive_for_others() -> None:
    a = field(verdict="differs", bits="aa", steps=[(0, "differs", "p"), (5, "differs", "q")])
    b = field(verdict="differs", bits="bb", steps=[(0, "differs", "P"), (5, "differs", "Q")])
    assert one_field(a, b, f=(sample(1.0, step=5), sample(1.0, step=5))).kind == "changed"
    c = field(verdict="differs", bits="bb", steps=[(0, "differs", "p"), (5, "differs", "Q")])
    assert one_field(a, c, f=(sample(1.0, step=5), sample(1.5, step=0))).kind == "changed"
    assert one_field(a, c, f=(sample(1.0, step=5), sample(1.5, step=5))).kind == "within bounds"


def test_different_steps_are_a_different_scene() -> None:
    change = one_field(field(steps=[(0, "pass", "p")]), field(bits="bb", steps=[(1, "pass", "p")]))
    assert (change.kind, change.note) == ("changed", "compared at different steps")


def test_run_without_digests() -> None:
    """The bits are known for a single evaluation if both arrays are saved; otherwise only the verdicts count."""
    old = field(bits="")
    assert one_field(old, field(), f=(sample(1.0, 2.0), sample(1.0, 2.0))).kind == "same bits"
    assert one_field(old, field(), f=(sample(1.0, 0.0), sample(1.0, -0.0))).kind == "within bounds"
    unknown = one_field(old, field())
    assert (unknown.kind, unknown.step) == ("within bounds", None)
    assert "bits unknown" in unknown.note
    bad = field(verdict="differs", over=7.0)
    blind = one_field(field(verdict="differs", over=7.0, bits=""), bad)
    assert (blind.kind, blind.fault) == ("cannot tell", True)
    assert one_field(field(verdict="differs", over=7.5, bits=""), bad).kind == "changed"
    assert one_field(old, old).note == unknown.note, "no digest is like no other"
    assert one_field(field(verdict="differs", bits=""), field(verdict="differs", bits="")).kind == "cannot tell"


def test_same_bits_judged_differently() -> None:
    listed = field(verdict="explained", findings=["x"])
    assert one_field(listed, field(verdict="differs")).kind == "judged otherwise"
    assert one_field(listed, field(verdict="explained", findings=["x", "y"])).kind == "same bits"
    assert one_field(listed, field(verdict="explained", findings=["x", "y"]), STRICT).kind == "judged otherwise"
    assert one_field(field(verdict="exact"), field(verdict="pass")).kind == "same bits"
    assert one_field(field(verdict="exact"), field(verdict="pass"), STRICT).kind == "judged otherwise"


def test_other_bits_are_a_fault_if_strict() -> None:
    a, b = field(bits="aa"), field(bits="bb")
    assert not one_field(a, b, LENIENT).fault
    assert one_field(a, b, STRICT).fault


@pytest.mark.parametrize(
    ("one", "other", "kind", "closer"),
    [
        (ended("refused", "refused", "no"), ended("refused", "refused", "no"), "same outcome", "both"),
        (ended("refused", "refused", "no", "a"), ended("refused", "refused", "no", "b"), "same outcome", "both"),
        (ended("refused", "refused", "", "a"), ended("refused", "refused", "", "b"), "changed", "neither"),
        (
            ended("refused", "refused", "", "a Last input line: read_data /tmp/1/data"),
            ended("refused", "refused", "", "a Last input line: read_data /tmp/2/data"),
            "same outcome",
            "neither",
        ),
        (ended("refused", "refused", "no"), ended("refused", "differs", "no"), "changed", "A"),
        (ended("refused", "explained", "no", findings="x"), ended("refused", "refused", "no"), "judged otherwise", "B"),
        (ended("refused", "refused", "no"), ended("accepted", "differs", "no"), "newly accepted", "A"),
        (ended("accepted", "differs", "no"), ended("refused", "refused", "no"), "newly refused", "B"),
        (case("one", field()), ended("refused", "refused"), "newly refused", "A"),
        (case("one", field()), ended("crashed", "crashed"), "newly crashed", "A"),
        (case("one", field()), ended("timeout", "timeout"), "newly crashed", "A"),
        (ended("crashed", "explained", "no"), ended("refused", "refused", "no"), "no longer crashed", "B"),
        (ended("crashed", "crashed", "", "pid 1"), ended("crashed", "crashed", "", "pid 2"), "same outcome", "neither"),
        (ended("crashed", "crashed"), ended("timeout", "timeout"), "changed", "neither"),
        (case("one", field()), ended("unusable", "differs"), "changed", "A"),
    ],
)
def test_changes_of_the_ending_of_a_case(one: CaseOutcome, other: CaseOutcome, kind: ChangeKind, closer: str) -> None:
    (change,) = compare(side(one), side(other), LENIENT).fields
    assert (change.kind, change.closer, change.field) == (kind, closer, "")
    assert change.fault == (kind != "same outcome")


def test_cases_and_fields_of_one_side() -> None:
    a = side(case("both", field("f"), field("gone")), case("gone", field()))
    b = side(case("both", field("f"), field("new")), case("new", field()))
    kinds = {(c.case, c.field): c.kind for c in compare(a, b, LENIENT).fields}
    assert kinds == {
        ("both", "f"): "same bits",
        ("both", "gone"): "missing field",
        ("both", "new"): "new field",
        ("gone", ""): "missing case",
        ("new", ""): "new case",
    }
    told = {c.kind for c in compare(a, b, Policy(news=False)).fields if not c.fault}
    assert told == {"same bits", "new field", "new case"}


def test_every_kind_is_explained_and_counted() -> None:
    from lammps_cases.records.outcome import ABOUT

    assert set(ABOUT) == set(CHANGE_KINDS)
    found = compare(side(case("one", field()), case("two", field())), side(case("one", field())), LENIENT)
    assert found.counts == {"same bits": 1, "missing case": 1}


def test_different_references_are_reported() -> None:
    a, b = side(case("one", field())), side(case("one", field()))
    assert compare(a, b, LENIENT).notes == ()
    b.versions["eos-ref"] = "0.2.0"
    assert "eos-ref 0.1.0 and 0.2.0" in compare(a, b, LENIENT).notes[0]


# --- comparable outcomes from the record of a run


def _twin(difference: float) -> CaseRecord:
    step = StepRecord(step=1, verdict="pass", max_abs=difference, max_over_bound=0.1, digest="aa")
    found = FieldRecord(field="f", stage="twin", verdict="pass", max_abs=difference, digest="aa", steps=[step])
    return CaseRecord(case="one", verdict="pass", twin="boost", fields=[found])


def test_digest_of_a_twin_includes_its_second_run() -> None:
    same, other = (compare(side(comparable(_twin(1.0))), side(comparable(_twin(d))), LENIENT) for d in (1.0, 2.0))
    assert same.fields[0].kind == "same bits"
    assert (other.fields[0].kind, other.fields[0].step) == ("within bounds", 1)


def test_case_with_numbers_counts_as_answered() -> None:
    pressure = FieldRecord(field="pressure", stage="eos", verdict="pass")
    assert comparable(CaseRecord(case="one", verdict="refused", ended="refused")).ended == "refused"
    assert comparable(CaseRecord(case="one", verdict="refused", ended="refused", fields=[pressure])).ended == "answered"


def test_fields_of_an_audit_are_distinguished_by_type() -> None:
    one, two = (FieldRecord(field="pressure", stage="eos", verdict="pass", atom_type=t, digest=f"{t}") for t in (1, 2))
    assert list(comparable(CaseRecord(case="deck", verdict="pass", fields=[one, two])).fields) == [
        "pressure (type 1)",
        "pressure (type 2)",
    ]


def test_differences_of_the_environment_are_reported() -> None:
    engines = (
        EngineRecord(library_sha256="ab" * 32, compiler="GNU C++ 14", mpi="MPICH"),
        EngineRecord(library_sha256="cd" * 32, compiler="GNU C++ 12", mpi="Open MPI"),
        EngineRecord(library_sha256="ab" * 32, mpi="MPI"),
    )
    a, b, c = (replace(side(case("one", field())), engine=engine) for engine in engines)
    (note,) = compare(a, b, Policy(news=False)).notes
    parts = "library abababab and cdcdcdcd; compiler GNU C++ 14 and GNU C++ 12; MPI MPICH and Open MPI"
    assert note == f"the environment differs: {parts}"
    assert compare(a, c, Policy(news=False)).notes == ()
