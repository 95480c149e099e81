"""The words that every command, page and document shares."""

from __future__ import annotations

import json
import math

import pytest

from lammps_cases.records import phrases
from lammps_cases.records.run_record import StepRecord


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
    assert (phrases.number(value), phrases.brief(value)) == (text, short)


def test_numbers_that_json_has_not_are_those_of_run_json() -> None:
    values = [math.inf, -math.inf, math.nan, 1.5]
    assert json.dumps(phrases.plain({"a": (values, None)}), allow_nan=False)
    written = [
        json.loads(StepRecord(step=0, verdict="pass", max_abs=value, max_over_bound=0.0).model_dump_json())["max_abs"]
        for value in values
    ]
    assert phrases.plain(values) == written == ["Infinity", "-Infinity", "NaN", 1.5]


def test_things_are_counted() -> None:
    assert [phrases.counted(count, "case") for count in (0, 1, 2)] == ["0 cases", "1 case", "2 cases"]


def test_the_nearest_name_is_suggested_if_any_is_near() -> None:
    assert phrases.nearest("near-rho", ["far", "near-rho0"]) == " (did you mean near-rho0?)"
    assert phrases.nearest("zzz", ["far", "near-rho0"]) == ""


@pytest.mark.parametrize(
    ("text", "name"),
    [("pypi:2025.7.22.1.0", "pypi-2025.7.22.1.0"), ("path:../../etc", "path-..-..-etc"), ("../..", ""), ("ü/é", "")],
)
def test_a_folder_is_named_below_its_parent(text: str, name: str) -> None:
    assert phrases.folder_name(text) == name


def test_ratios_are_ordered_with_none_first_and_nan_last() -> None:
    assert sorted([math.nan, 2.0, None, 0.0], key=phrases.size)[:3] == [None, 0.0, 2.0]


def test_findings_and_fields_are_named() -> None:
    assert phrases.finding_ids(None) == phrases.finding_ids("") == []
    assert phrases.finding_ids("a, b-c") == ["a", "b-c"]
    assert [phrases.field_name("p", of) for of in (None, 2)] == ["p", "p (type 2)"]
    assert [phrases.kind("refused", expected) for expected in (True, False)] == ["refused as expected", "refused"]
