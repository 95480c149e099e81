"""Plain technical English: no docstring, comment, message or test name uses what CONTRIBUTING.md lists as to avoid."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
FILES = [path for package in ("eos_ref", "lammps_cases", "tests") for path in sorted((ROOT / package).rglob("*.py"))]


@cache
def avoided() -> re.Pattern[str]:
    """The phrases of the first column of the table "English" in CONTRIBUTING.md."""
    section = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## English")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \|", section, flags=re.MULTILINE)[1:]
    phrases = (f"[{phrase[0]}{phrase[0].upper()}]{phrase[1:]}" for row in rows for phrase in row.split(", "))
    return re.compile(rf"\b(?:{'|'.join(phrases)})\b")  # "is None" is code


def prose(text: str) -> Iterator[tuple[int, str]]:
    """Yield lines with docstrings, messages of several words, names of tests and comments; no code in backticks."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.count(" ") > 1:
            yield node.lineno, re.sub(r"`[^`]*`", "", node.value)
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield node.lineno, node.name.replace("_", " ")
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def test_prose_is_plain_english() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {match[0]}"
        for path in FILES
        for line, text in prose(path.read_text(encoding="utf-8"))
        for match in avoided().finditer(text)
    ]
    assert found == []
