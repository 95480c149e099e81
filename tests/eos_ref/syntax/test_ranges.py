"""Ranges of atom types: every form of the manual, and every invalid form."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref import InputError, type_range


@pytest.mark.parametrize(
    ("text", "ntypes", "types"),
    [
        ("*", 4, [1, 2, 3, 4]),
        ("*", 1, [1]),
        ("2", 4, [2]),
        ("4", 4, [4]),
        ("*3", 4, [1, 2, 3]),
        ("*1", 4, [1]),
        ("3*", 4, [3, 4]),
        ("4*", 4, [4]),
        ("2*3", 4, [2, 3]),
        ("2*2", 4, [2]),
        ("1*4", 4, [1, 2, 3, 4]),
        ("02", 4, [2]),
        ("999999999999999999", 10**18, [999999999999999999]),
    ],
)
def test_forms_of_the_manual(text: str, ntypes: int, types: list[int]) -> None:
    assert list(type_range(text, ntypes)) == types


FORM = "must be *, n, *n, m* or m*n with whole numbers"
WITHIN = "must lie within the atom types 1 to 2"
REVERSED = "must not be reversed"


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("2*1", REVERSED),
        ("9*8", REVERSED),
        ("**", FORM),
        ("1*2*", FORM),
        ("1-2", FORM),
        ("1:2", FORM),
        ("1,2", FORM),
        ("", FORM),
        (" 1", FORM),
        ("1 ", FORM),
        ("1\n", FORM),
        ("1 * 2", FORM),
        ("-1", FORM),
        ("+1", FORM),
        ("1.5", FORM),
        ("1e0", FORM),
        ("0x1", FORM),
        ("1_0", FORM),
        ("a", FORM),
        ("١", FORM),
        ("¹", FORM),
        ("１*２", FORM),
        ("9" * 5000, FORM),  # Python refuses to convert so many digits
        ("*" + "9" * 5000, FORM),
        ("0", WITHIN),
        ("0*", WITHIN),
        ("*0", WITHIN),
        ("0*1", WITHIN),
        ("3", WITHIN),
        ("3*", WITHIN),
        ("*3", WITHIN),
        ("1*3", WITHIN),
        ("3*4", WITHIN),
        ("999999999999999999", WITHIN),
    ],
)
def test_invalid_ranges_of_two_types(text: str, rule: str) -> None:
    with pytest.raises(InputError, match=re.escape(rule)) as caught:
        type_range(text, 2, "in.deck")
    message = str(caught.value)
    assert message.startswith("type range: ")
    assert message.endswith("(in.deck)")
    assert "found" in message
    assert repr(text)[:100] in message or " " in text  # spaces are closed up
    assert "\n" not in message


@settings(deadline=None, derandomize=True)
@given(st.integers(1, 50), st.integers(1, 50), st.integers(1, 50))
def test_range_selects_the_types_between_its_ends(low: int, high: int, ntypes: int) -> None:
    def value(text: str) -> list[int] | None:
        try:
            return list(type_range(text, ntypes))
        except InputError:
            return None

    fits = 1 <= low <= high <= ntypes
    assert value(f"{low}*{high}") == (list(range(low, high + 1)) if fits else None)
    assert value(f"*{high}") == (list(range(1, high + 1)) if high <= ntypes else None)
    assert value(f"{low}*") == (list(range(low, ntypes + 1)) if low <= ntypes else None)
    assert value(f"{low}") == ([low] if low <= ntypes else None)
