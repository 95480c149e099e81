"""The headline: its states, colours and words, and the levels at which a known finding fails."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from lammps_cases.records.headline import LOOKS, headline, how_severe, strictest
from lammps_cases.records.levels import FAIL_ON, SEVERITIES, FailOn, Severity, fails

KNOWN: Mapping[str, Severity] = {"a": "high", "b": "high", "c": "medium", "d": "low"}


@pytest.mark.parametrize(
    ("known", "more", "said"),
    [
        ({}, {}, "PASS: no difference"),
        ({}, {"same": "7 statements hold"}, "PASS: 7 statements hold"),
        ({}, {"compared": False}, "EMPTY: nothing was compared"),
        (KNOWN, {}, "KNOWN BUGS: 4 known bugs seen in this LAMMPS, 2 severe; nothing new"),
        ({"c": "medium"}, {}, "KNOWN BUGS: 1 known bug seen in this LAMMPS (not severe); nothing new"),
        (
            {},
            {"differences": "1 statement does not hold, all known"},
            "KNOWN BUGS: 1 statement does not hold, all known; nothing new",
        ),
        ({}, {"new": ["1 case not as expected"]}, "FAIL: 1 case not as expected"),
        ({}, {"new": ["the engine failed"], "compared": False}, "FAIL: the engine failed"),
        (KNOWN, {"new": ["x"]}, "FAIL: x; 4 known bugs seen in this LAMMPS, 2 severe"),
        (
            KNOWN,
            {"fail_on": "high"},
            "FAIL: 4 known bugs seen in this LAMMPS, 2 severe; 2 rejected by --fail-on high; nothing new",
        ),
        ({"d": "low"}, {"fail_on": "medium"}, "KNOWN BUGS: 1 known bug seen in this LAMMPS (not severe); nothing new"),
        (
            {"d": "low"},
            {"fail_on": "low"},
            "FAIL: 1 known bug seen in this LAMMPS (not severe); 1 rejected by --fail-on low; nothing new",
        ),
    ],
)
def test_state_and_words(known: Mapping[str, Severity], more: dict[str, Any], said: str) -> None:
    assert str(headline(known, **more)) == said


def test_every_state_looks_different() -> None:
    for name in ("css", "terminal", "mark"):
        assert len({getattr(look, name) for look in LOOKS.values()}) == len(LOOKS)
    assert {state: look.level for state, look in LOOKS.items()} == {
        "PASS": "notice",
        "KNOWN BUGS": "warning",
        "FAIL": "error",
        "EMPTY": "warning",
    }


@pytest.mark.parametrize("level", FAIL_ON)
def test_level_fails_findings_at_least_as_severe(level: FailOn) -> None:
    failing = [severity for severity in SEVERITIES if fails(severity, level)]
    assert (
        failing == {"high": ["high"], "medium": ["high", "medium"], "low": ["high", "medium", "low"], "new": []}[level]
    )


def test_levels_and_severities_are_ordered() -> None:
    assert strictest(["high", "low", "medium", "new"]) == "low"
    assert strictest(["new", "high"]) == "high" and strictest([]) == "new"
    assert how_severe(KNOWN) == "2 high, 1 medium, 1 low" and how_severe({}) == ""
