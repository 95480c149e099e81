"""That every finding's text is tested, and what it says of versions, against the engines on which it was seen."""

from __future__ import annotations

import re
from pathlib import Path

from packaging.version import Version

from lammps_cases.findings import KNOWN, LEDGER, SEEN_ON

VERSION = r"(\d{4}(?:\.\d+){2,})"


def test_every_text_is_tested() -> None:
    tests = "".join(path.read_text() for path in Path(__file__).parent.glob("test_texts_*.py"))
    assert [entry.id for entry in LEDGER if f'"{entry.id}"' not in tests] == []


def test_versions_are_those_on_which_a_finding_was_seen() -> None:
    """*Since X*: first seen on X. *From X on* something else, *X or newer* as a way out: last seen before X."""
    found = set()
    for entry in LEDGER:
        text = " ".join([entry.title, entry.observed, entry.argument, entry.workaround])
        began = re.findall(rf"Since {VERSION}", text)
        ended = re.findall(rf"[Ff]rom {VERSION} on", text) + re.findall(rf"{VERSION} or newer", text)
        seen = [Version(engine) for engine in SEEN_ON[entry.id]]
        known = [Version(engine) for engine in KNOWN]
        assert sorted(began + ended) == sorted(re.findall(VERSION, text)), f"{entry.id}: a version in other words"
        for version in map(Version, began):
            assert version == min(seen) > min(known), entry.id
        for version in map(Version, ended):
            assert version == min(engine for engine in known if engine > max(seen)), entry.id
        if began or ended:
            found.add(entry.id)
    gone = {entry.id for entry in LEDGER if KNOWN[-1] not in SEEN_ON[entry.id]}
    new = {entry.id for entry in LEDGER if KNOWN[0] not in SEEN_ON[entry.id]}
    assert found <= gone | new
    assert {name for name in new if KNOWN[-1] in SEEN_ON[name]} <= found, "a finding that is new says since when"
