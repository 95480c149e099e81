"""The numbers that the texts of findings print, by their names, and what recomputes them and runs their workarounds."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache, wraps
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from lammps_cases.bugs.report import Demonstration
from lammps_cases.findings import LEDGER
from lammps_cases.findings.document import FOLDER, demonstration
from lammps_cases.findings.entry import Finding

ENTRIES: dict[str, Finding] = {entry.id: entry for entry in LEDGER}
RECOMPUTED: set[tuple[str, str]] = set()  # by tests: finding and name of the number
WORKED_AROUND: set[tuple[str, int]] = set()  # by tests: finding and line of its workaround

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


class Printed(float):
    """A number as printed in a text: equal to all numbers that round to it."""

    digits: int  # after the point; negative: before it

    def __new__(cls, text: str) -> Printed:
        """Keep the number of digits."""
        made = super().__new__(cls, text)
        mantissa, _, exponent = text.partition("e")
        made.digits = len(mantissa.partition(".")[2]) - int(exponent or 0)
        return made

    @property
    def half_unit(self) -> float:
        """Half a unit of the last digit."""
        return 0.5 * 10.0**-self.digits

    def is_rounded(self, number: Any) -> bool:
        """Whether a number, rounded to the digits printed, is this one."""
        return round(float(number), self.digits) == float(self)


def printed(finding: str) -> SimpleNamespace:
    """The numbers of a finding, each as an attribute."""
    return SimpleNamespace(**{name: Printed(text) for name, text in ENTRIES[finding].numbers.items()})


@cache
def shown(finding: str) -> Demonstration:
    """The last section of a finding's document."""
    return Demonstration.model_validate(demonstration(finding))


def recomputes(finding: str, names: str = "", given: str = "", some: bool = False) -> Callable[..., Any]:
    """Make a test from a function that returns numbers of a finding by name, from LAMMPS, a variant or by hand.

    Every value returned, alone or in arrays, must round to the number printed. ``given`` are numbers from which the
    function starts, or which it compares itself as bounds; with ``some`` it returns only some of the names each time.
    """

    def register(function: Callable[..., Mapping[str, Any]]) -> Callable[..., None]:
        RECOMPUTED.update((finding, name) for name in (*names.split(), *given.split()))

        @wraps(function)
        def test(*arguments: Any, **fixtures: Any) -> None:
            found, texts = function(*arguments, **fixtures), vars(printed(finding))
            assert (found.keys() <= set(names.split())) if some else (found.keys() == set(names.split()))
            for name, values in found.items():
                assert all(texts[name].is_rounded(value) for value in np.ravel(values)), (name, texts[name], values)

        return test

    return register


def works_around(finding: str, *lines: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Mark a test that runs lines of a finding's workaround, by their numbers."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        WORKED_AROUND.update((finding, line) for line in lines)
        return function

    return register


def quoted(finding: str, part: str) -> list[str]:
    """The commands and messages of a text: the parts in quotation marks."""
    return re.findall(r"(?<!\w)'([^']+)'(?!\w)", getattr(ENTRIES[finding], part))


def text_of(finding: str, folder: Path = FOLDER) -> str:
    """The document of a finding without its numbers and its last section."""
    front, _, body = (folder / f"{finding}.md").read_text(encoding="utf-8").partition("\n---\n")
    front = re.sub(r"^(?:number:|numbers:|  \w+:|id:).*\n", "", front + "\n", flags=re.MULTILINE)
    return front + body.partition("## Demonstration")[0]


def unnamed(text: str, numbers: Iterable[str]) -> list[str]:
    """The lines of a text with digits that are neither of its numbers, each of which it holds, nor literal."""
    rest = text.replace("\\", "")
    for number in sorted(set(numbers), key=len, reverse=True):
        rest, count = re.subn(rf"(?<![\w.]){re.escape(number)}(?![\w.]*\d)", "", rest)
        assert count, number
    for literal in LITERAL.values():
        rest = re.sub(literal, "", rest)
    return re.findall(r".*\d.*", rest)
