"""Input scripts are read as LAMMPS reads them: logical lines, comments, words."""

from __future__ import annotations

import pytest

from lammps_cases.audit import text


@pytest.mark.parametrize(
    ("script", "lines"),
    [
        ("a b # c", ["a b"]),
        ("# a &\nb\nc", ["", "c"]),
        ("a & # b\nc", ["a &", "c"]),
        ("a &  \n b\nc\r\n", ["a  b", "c", ""]),
        ('a """b\n# c""" # d\ne', ['a """b\n# c"""', "e"]),
        ("a 'b # c' \"# d\" # e", ["a 'b # c' \"# d\""]),
    ],
)
def test_logical_lines(script: str, lines: list[str]) -> None:
    assert [text.without_comment(line.text) for line in text.logical_lines(script)] == lines


def test_words() -> None:
    found = text.words('if "a b" \'c "d"\' """e \'f\' """ g"h')
    assert [word.value for word in found] == ["if", "a b", 'c "d"', "e 'f' ", 'g"h']
    assert [word.raw for word in found][1:3] == ['"a b"', "'c \"d\"'"]
