"""Syntax of LAMMPS input scripts: logical lines, comments, words.

As the manual's page on parsing rules says; what it leaves open was determined by experiment (LAMMPS 22Jul2025).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

QUOTES = ('"""', '"', "'")


class LogicalLine(NamedTuple):
    """A logical line and the number of its last physical one."""

    number: int
    text: str


class Word(NamedTuple):
    """A word as written, and without its quotes."""

    raw: str
    value: str


def logical_lines(text: str) -> list[LogicalLine]:
    """Join lines that end with ``&`` and those inside triple quotes.

    A comment ending with ``&`` goes on as well, and triple quotes count in comments too: LAMMPS joins before it looks
    for comments.
    """
    lines: list[LogicalLine] = []
    joined = ""
    physical = text.split("\n")
    for number, line in enumerate(physical, 1):
        joined += line.rstrip()
        last = number == len(physical)
        if joined.endswith("&") and not last:
            joined = joined[:-1]
        elif joined.count('"""') % 2 and not last:
            joined += "\n"
        else:
            lines.append(LogicalLine(number, joined))
            joined = ""
    return lines


def read_lines(path: Path) -> list[LogicalLine]:
    """Logical lines of a file."""
    return logical_lines(path.read_text(encoding="utf-8", errors="replace"))


def _quote_at(text: str, position: int) -> str:
    return next((quote for quote in QUOTES if text.startswith(quote, position)), "")


def without_comment(text: str) -> str:
    """Cut from the first ``#`` outside quotes; a text with an unmatched quote is left as it is."""
    position = 0
    while position < len(text):
        if text[position] == "#":
            return text[:position].strip()
        quote = _quote_at(text, position)
        if quote:
            end = text.find(quote, position + len(quote))
            if end < 0:
                return text.strip()
            position = end
        position += len(quote) or 1
    return text.strip()


def words(text: str) -> list[Word]:
    """Split at blanks; a word that begins with a quote goes on to the next quote of its kind."""
    split: list[Word] = []
    position = 0
    while position < len(text):
        if text[position].isspace():
            position += 1
            continue
        begin, quote = position, _quote_at(text, position)
        if quote:
            end = text.find(quote, begin + len(quote))
            end = len(text) if end < 0 else end
            position = end + len(quote)
            split.append(Word(text[begin:position], text[begin + len(quote) : end]))
        else:
            while position < len(text) and not text[position].isspace():
                position += 1
            split.append(Word(text[begin:position], text[begin:position]))
    return split


def branches(command: list[Word]) -> tuple[list[str], list[list[str]]]:
    """Conditions (as written) and commands of an ``if`` command; the last branch has no condition if it is ``else``.

    Raises
    ------
    ValueError
        Not ``if CONDITION then COMMAND ... [elif CONDITION COMMAND ...] [else COMMAND ...]``.
    """
    if len(command) < 4 or command[2].value != "then":
        raise ValueError("if needs a condition, then, and a command")
    conditions = [command[1].raw]
    commands: list[list[str]] = [[]]
    rest = iter(command[3:])
    for word in rest:
        if word.raw == "elif":
            conditions.append(next(rest, Word('""', "")).raw)
            commands.append([])
        elif word.raw == "else":
            commands.append([])
        else:
            commands[-1].append(word.value)
    return conditions, commands
