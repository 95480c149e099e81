"""Syntax of LAMMPS input scripts: logical lines, comments, words.

By the manual's page on parsing rules; what it leaves open was determined by experiment (LAMMPS 22Jul2025).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from eos_ref.errors import InputError
from lammps_cases.records.files import MIB, read_bytes

LARGEST_SCRIPT = 4 * MIB
LONGEST_LINE = 2**15

# Three quotes are never read as one quote and two more, hence the atomic group; nor is a quoted text re-scanned.
_QUOTE = r"""(?>(?P<quote>\"{3}|\"|'))"""
_BEFORE_COMMENT = re.compile(rf"""((?:[^#"']|{_QUOTE}.*?(?P=quote))*+)#""", re.DOTALL)
_WORD = re.compile(rf"{_QUOTE}(?P<inner>.*?)(?:(?P=quote)|\Z)|\S+", re.DOTALL)


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

    A comment ending with ``&`` continues as well, and triple quotes count in comments too: LAMMPS joins before it looks
    for comments.
    """
    lines: list[LogicalLine] = []
    joined = ""
    physical = text.split("\n")
    for number, line in enumerate(physical, 1):
        joined += line.rstrip()
        last = number == len(physical) or len(joined) > LONGEST_LINE
        if joined.endswith("&") and not last:
            joined = joined[:-1]
        elif joined.count('"""') % 2 and not last:
            joined += "\n"
        else:
            lines.append(LogicalLine(number, joined))
            joined = ""
    return lines


def read_lines(path: Path) -> list[LogicalLine]:
    """Return the logical lines of a file.

    Raises
    ------
    InputError
        It cannot be read, or is too large for a script.
    """
    content = read_bytes(path, "input script", LARGEST_SCRIPT)
    lines = logical_lines(content.decode("utf-8", errors="replace"))
    for number, line in lines:
        if len(line) > LONGEST_LINE:
            raise InputError("line", f"must be at most {LONGEST_LINE} characters", len(line), f"{path.name}:{number}")
    return lines


def without_comment(text: str) -> str:
    """Cut from the first ``#`` outside quotes; a text with an unmatched quote is not changed."""
    before = _BEFORE_COMMENT.match(text)
    return (before[1] if before else text).strip()


def words(text: str) -> list[Word]:
    """Split at blanks; a word that begins with a quote extends to the next quote of its kind, or to the end."""
    return [Word(word[0], word["inner"] if word["quote"] else word[0]) for word in _WORD.finditer(text)]


def branches(command: list[Word]) -> tuple[list[str], list[list[str]]]:
    """Split an ``if`` command into conditions (as written) and commands; an ``else`` branch has no condition.

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


def nested(command: list[Word]) -> list[str]:
    """Return the commands held by the words of another one: ``if``, ``run ... every``, ``partition``."""
    values = [word.value for word in command]
    match values[0]:
        case "if":
            try:
                return [inner for branch in branches(command)[1] for inner in branch]
            except ValueError:
                return []
        case "run" if "every" in values[2:]:
            return [inner for inner in values[values.index("every") + 2 :] if inner != "NULL"]
        case "partition":
            return [" ".join(word.raw for word in command[3:])]
        case _:
            return []


def quoted(word: str) -> str:
    """Return a word as a script has it."""
    if word and not any(c.isspace() or c in "\"'#&$" for c in word):
        return word
    return f'"""{word}"""'
