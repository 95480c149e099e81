"""The numbers that the texts of findings print, by their names, and the tests that recompute them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import wraps
from types import SimpleNamespace
from typing import Any

import numpy as np

from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import Finding

ENTRIES: dict[str, Finding] = {entry.id: entry for entry in LEDGER}
RECOMPUTED: dict[tuple[str, str], Callable[..., Any]] = {}  # by finding and name of the number


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


def recomputes(finding: str, names: str = "", given: str = "", some: bool = False) -> Callable[..., Any]:
    """Make a test from a function that returns numbers of a finding by name, from LAMMPS, a variant or by hand.

    Every value returned, alone or in arrays, must round to the number printed. ``given`` are numbers from which the
    function starts, or which it compares itself as bounds; with ``some`` it returns only some of the names each time.
    """

    def register(function: Callable[..., Mapping[str, Any]]) -> Callable[..., None]:
        RECOMPUTED.update({(finding, name): function for name in (*names.split(), *given.split())})

        @wraps(function)
        def test(*arguments: Any, **fixtures: Any) -> None:
            found, texts = function(*arguments, **fixtures), vars(printed(finding))
            assert (found.keys() <= set(names.split())) if some else (found.keys() == set(names.split()))
            for name, values in found.items():
                assert all(texts[name].is_rounded(value) for value in np.ravel(values)), (name, texts[name], values)

        return test

    return register


def quoted(finding: str, part: str) -> list[str]:
    """The commands and messages of a text: the parts in quotation marks."""
    return re.findall(r"(?<!\w)'([^']+)'(?!\w)", getattr(ENTRIES[finding], part))
