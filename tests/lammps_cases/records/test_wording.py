"""Words shared by commands, pages and documents."""

from __future__ import annotations

import json
import math

import pytest

from lammps_cases.records import wording
from lammps_cases.records.case_parts import StepRecord
from lammps_cases.scene.fields import FIELDS


@pytest.mark.parametrize(
    ("value", "text", "short"),
    [
        (None, "", ""),
        (0.0, "0", "0"),
        (0.12345, "0.123", "0.12"),
        (3.6e9, "3.6e+09", "3.6e9"),
        (-math.inf, "−∞", "−∞"),
        (math.inf, "∞", "∞"),
        (math.nan, "nan", "nan"),
    ],
)
def test_a_number_for_reading(value: float | None, text: str, short: str) -> None:
    assert (wording.number(value), wording.brief(value)) == (text, short)


def test_non_finite_numbers_are_written_as_in_run_json() -> None:
    values = [math.inf, -math.inf, math.nan, 1.5]
    assert json.dumps(wording.plain({"a": (values, None)}), allow_nan=False)
    written = [
        json.loads(StepRecord(step=0, verdict="pass", max_abs=value, max_over_bound=0.0).model_dump_json())["max_abs"]
        for value in values
    ]
    assert wording.plain(values) == written == ["Infinity", "-Infinity", "NaN", 1.5]


def test_many_cases_are_counted_by_file_largest_first() -> None:
    assert wording.by_file(["a.1", "b.1"]) == "a.1, b.1"
    files = [f"{file}.{k}" for file, count in zip("abcdefgh", range(9, 1, -1), strict=True) for k in range(count)]
    assert wording.by_file(files) == "44 cases (9 a.*, 8 b.*, 7 c.*, 6 d.*, 5 e.*, 4 f.*, 2 more files)"


def test_things_and_times_are_counted() -> None:
    assert [wording.counted(count, "case") for count in (0, 1, 2)] == ["0 cases", "1 case", "2 cases"]
    assert [wording.times(of) for of in (1.25, 101.0, 1000.0, 34_987.0, 999_999.0, 1.2e13, math.inf)] == [
        *("1.25", "101", "1 000", "35 000", "1 000 000", "1.2e13", "∞")
    ]


def test_ratios_are_ordered_with_none_first_and_nan_last() -> None:
    assert sorted([math.nan, 2.0, None, 0.0], key=wording.size)[:3] == [None, 0.0, 2.0]


def test_findings_and_fields_are_named_and_names_parted() -> None:
    assert (wording.listed([]), wording.listed(["a", "b-c"])) == ("", "a, b-c")
    assert [wording.field_name("p", of) for of in (None, 2)] == ["p", "p (type 2)"]
    assert [wording.verdict_kind("refused", expected) for expected in (True, False)] == [
        "refused as expected",
        "refused",
    ]
    assert [wording.parted(name) for name in FIELDS] == [(name, "") for name in FIELDS]
    assert wording.parted(wording.given("rho")) == ("rho", wording.GIVEN)
    assert wording.parted(wording.after_stop("grad/v", "data nofix", 12)) == ("grad/v", "data nofix at 12")
