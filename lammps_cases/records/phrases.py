"""What every command, page and document says in the same way: verdicts, findings, numbers, names."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable
from typing import Any

INSIDE = ("exact", "pass")  # the verdicts of what lies within its bound
EXPECTED_REFUSAL = "refused as expected"


def kind(verdict: str, expected: bool) -> str:
    """The verdict, with an expected refusal kept apart from one that nobody expected."""
    return EXPECTED_REFUSAL if verdict == "refused" and expected else verdict


def finding_ids(explained_by: str | None) -> list[str]:
    """The findings that an ``explained_by`` names."""
    return explained_by.split(", ") if explained_by else []


def field_name(field: str, atom_type: int | None) -> str:
    """What a field is called; an audit has one per type of atoms."""
    return field if atom_type is None else f"{field} (type {atom_type})"


# --- numbers


def size(ratio: float | None) -> float:
    """A ratio for ordering: not a number is the worst there is, none the best."""
    return -1.0 if ratio is None else math.inf if math.isnan(ratio) else ratio


def number(value: float | None, digits: int = 3) -> str:
    """A number for reading; empty for None."""
    if value is None:
        return ""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{value:.{digits}g}"


def brief(value: float | None) -> str:
    """A number of two digits for a narrow cell: 3.6e9, 0.12."""
    text = number(value, 2)
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if e else text


def counted(count: int, noun: str) -> str:
    """A number of things: 1 case, 2 cases."""
    return f"{count} {noun}{'s' * (count != 1)}"


def plain(item: Any) -> Any:
    """An item as JSON has it: tuples as lists, and as text, as in run.json, the numbers for which JSON has none."""
    if isinstance(item, dict):
        return {name: plain(value) for name, value in item.items()}
    if isinstance(item, list | tuple):
        return [plain(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        return "NaN" if math.isnan(item) else "Infinity" if item > 0 else "-Infinity"
    return item


# --- names


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name that was probably meant, for the end of a rule; empty if none is near."""
    close = difflib.get_close_matches(name, list(known), 1, 0.4)
    return f" (did you mean {close[0]}?)" if close else ""


def folder_name(text: str) -> str:
    """Text as the name of a folder on any system."""
    return re.sub(r"[^A-Za-z0-9.+]+", "-", text).strip("-.")[:100]
