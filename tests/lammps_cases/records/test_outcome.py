"""The outcome of a run: taken from records, restricted by a pattern, and compared with another."""

from __future__ import annotations

from typing import Any

import pytest

from lammps_cases.records.case_parts import FieldRecord, Seconds, StepRecord
from lammps_cases.records.outcome import ABOUT, CHANGE_KINDS, NEW, SAME, CaseOutcome, FieldOutcome, differences
from lammps_cases.records.run_record import CaseRecord

PRESSURE: dict[str, Any] = {"field": "pressure", "stage": "eos", "verdict": "pass", "max_over_bound": 0.5}
FORCE: dict[str, Any] = {"field": "f", "stage": "pair", "verdict": "explained", "max_over_bound": 9.0}


def _case(*fields: dict[str, Any], **facts: Any) -> CaseOutcome:
    records = [FieldRecord.model_validate(field) for field in fields]
    return CaseOutcome.of(CaseRecord(case="one", fields=records, **{"verdict": "pass", **facts}))


def test_outcome_of_a_record() -> None:
    steps = [StepRecord(step=step, verdict="pass", max_over_bound=0.5, digest="d", max_abs=0.25) for step in (0, 4)]
    one = FieldRecord.model_validate(PRESSURE | {"atom_type": 2, "digest": "aa", "steps": steps})
    outcome = FieldOutcome.of(one)
    assert (outcome.name, outcome.stage, outcome.digest) == ("pressure (type 2)", "eos", "aa")
    assert [(at.step, at.verdict, at.digest, at.max_abs) for at in outcome.steps] == [
        (0, "pass", "d", 0.25),
        (4, "pass", "d", 0.25),
    ]
    (only,) = FieldOutcome.of(FieldRecord.model_validate(PRESSURE)).steps
    assert (only.step, only.verdict, only.digest) == (None, "pass", "")


def test_worst_field_has_the_largest_ratio_to_its_bound() -> None:
    outcome = _case(PRESSURE, FORCE, verdict="explained", seconds=Seconds(lammps=1.5))
    assert (outcome.worst, outcome.worst_field, outcome.seconds) == (9.0, "f", 1.5)
    infinite = _case(PRESSURE | {"max_over_bound": "Infinity"}, FORCE)
    assert (infinite.worst, infinite.worst_field) == (float("inf"), "pressure")
    same = _case(PRESSURE | {"verdict": "exact", "max_over_bound": 0.0})
    assert (same.worst, same.worst_field) == (0.0, ""), "no difference, no field"
    assert (_case().worst, _case().worst_field) == (None, "")


def test_only_fields_of_a_pattern_count() -> None:
    outcome = _case(PRESSURE, FORCE, verdict="explained")
    law = outcome.restricted("press*")
    assert (list(law.fields), law.verdict, law.worst_field) == (["pressure"], "pass", "pressure")
    assert outcome.restricted("none").verdict == "explained", "no field of it: as the case"


@pytest.mark.parametrize(
    ("facts", "kind", "agrees"),
    [
        ({"verdict": "exact"}, "exact", True),
        ({"verdict": "explained", "explained_by": ["a"]}, "explained", False),
        ({"verdict": "refused", "ended": "refused", "expects": "Illegal"}, "refused as expected", True),
        ({"verdict": "refused", "ended": "refused"}, "refused", False),
        ({"verdict": "crashed", "ended": "crashed"}, "crashed", False),
    ],
)
def test_expected_refusal_is_a_kind_of_its_own(facts: dict[str, Any], kind: str, agrees: bool) -> None:
    outcome = _case(**facts)
    assert (outcome.kind, outcome.agrees) == (kind, agrees)
    assert outcome.parts["verdict"] == kind


def test_differences_are_listed_by_field_and_part() -> None:
    was = _case(PRESSURE | {"digest": "aa"}, FORCE | {"digest": "bb"})
    now = _case(PRESSURE | {"digest": "cc", "verdict": "exact"}, FORCE | {"explained_by": ["x"]}, verdict="explained")
    assert list(differences(was, now)) == [
        ("", "verdict", "pass", "explained"),
        ("pressure", "verdict", "pass", "exact"),
        ("pressure", "bits", "aa", "cc"),
        ("f", "finding", "", "x"),
    ], "bits of f are not recorded now"
    assert list(differences(was, was)) == []
    assert list(differences(was, _case(verdict="pass"))) == [], "a field that one side lacks is no difference of it"


def test_every_kind_of_change_has_words() -> None:
    assert set(ABOUT) == set(CHANGE_KINDS) and {*SAME, *NEW} < set(CHANGE_KINDS)
