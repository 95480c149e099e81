"""Every finding's text is tested: its numbers, and its versions against the engines on which it was seen."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

from packaging.version import Version

from lammps_cases.findings import KNOWN, LEDGER, SEEN_ON
from lammps_cases.findings.document import FOLDER
from tests.support.printed import RECOMPUTED

VERSION = r"(\d{4}(?:\.\d+){2,})"
LITERAL = {  # quantities in texts that are not results: what they are, and how they are recognised
    "commands and messages in quotation marks, which tests give to LAMMPS": r"(?<!\w)'[^']+'(?!\w)",
    "versions, compared with the engines below": VERSION,
    "years of publications and dates of pages": r"(?:al\.|Monaghan|Jul) \d{4}|\d (?=Jul)",
    "dimensions": r"\b[23]D\b",
    "names: kernels, arguments, positions": r"\b(?:RK|rho|gd|cs|A|C|c|r|F)[0-9]\b|\([345], [45]\)",
    "exponents and moduli": r"\^\d+",
    "small whole numbers: types, counts, steps, limits, coefficients of formulas": r"(?<![\d.])[0-3](?![\d.]*\d)",
    "names of other codes that were tried, of which no record is kept": r"some 2000",
}
TESTS = sorted(Path(__file__).parent.glob("test_texts_*.py"))


def test_every_text_is_tested() -> None:
    tests = "".join(path.read_text() for path in TESTS)
    assert [entry.id for entry in LEDGER if not re.search(rf"\b{entry.id}\b", tests)] == []


def test_every_number_is_recomputed() -> None:
    for path in TESTS:
        importlib.import_module(f"tests.lammps_cases.findings.{path.stem}")
    assert RECOMPUTED.keys() == {(entry.id, name) for entry in LEDGER for name in entry.numbers}


def test_every_digit_is_of_a_number_or_literal() -> None:
    """And every number occurs in the text."""
    for entry in LEDGER:
        front, _, body = (FOLDER / f"{entry.id}.md").read_text(encoding="utf-8").partition("\n---\n")
        text = re.sub(r"^(?:number:|numbers:|  \w+:|id:).*\n", "", front + "\n", flags=re.MULTILINE) + body
        assert entry.numbers.keys() == set(re.findall(r"\{(\w+)\}", text)), entry.id
        rest = re.sub(r"\{\w+\}", "", text.replace("\\", ""))
        for literal in LITERAL.values():
            rest = re.sub(literal, "", rest)
        assert re.findall(r".*\d.*", rest) == [], entry.id


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
