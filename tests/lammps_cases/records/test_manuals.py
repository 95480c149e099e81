"""Statements that differ between versions of the manual."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from eos_ref.syntax.manual import FIRST, MANUALS
from lammps_cases.records.yaml_files import OfManual

NEWEST = MANUALS[-1]


def test_statement_holds_from_its_first_to_its_last_version() -> None:
    assert len(MANUALS) > 1
    made = {
        (since, until): [OfManual(since=since, until=until).made_in(manual) for manual in (FIRST, NEWEST)]
        for since, until in ((FIRST, FIRST), (NEWEST, NEWEST), (FIRST, NEWEST))
    }
    assert [*made.values()] == [[True, False], [False, True], [True, True]]
    assert all(OfManual().made_in(manual) for manual in MANUALS)


def test_bad_ranges_of_versions_are_refused() -> None:
    with pytest.raises(ValidationError, match="since must not be later than until"):
        OfManual(since=NEWEST, until=FIRST)
    with pytest.raises(ValidationError, match="since"):
        OfManual(since="1995.1.1")
