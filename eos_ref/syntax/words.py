"""The words of a command, read one after another, with complaints that name the command."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NoReturn

from eos_ref.errors import InputError, nearest

BLANK = "[ \t\r\f]+"  # str.split() also splits at the blanks of every script


@dataclass
class Words:
    """The words of a command; every complaint names the command."""

    words: list[str]
    command: str
    position: int = field(default=0)

    def fail(self, what: str, rule: str, found: object = None) -> NoReturn:
        """Refuse a word.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(what, rule, found, self.command)

    @property
    def left(self) -> bool:
        """Return whether words are left."""
        return self.position < len(self.words)

    def peek(self) -> str:
        """Return the next word without reading it; empty at the end."""
        return self.words[self.position] if self.left else ""

    def word(self, what: str) -> str:
        """Read a word.

        Raises
        ------
        InputError
            None is left.
        """
        if not self.left:
            self.fail(what, "is missing at the end of the command")
        self.position += 1
        return self.words[self.position - 1]

    def number(self, what: str) -> float:
        """Read a finite number.

        Raises
        ------
        InputError
        """
        text = self.word(what)
        value = number(text)
        if value is None or not math.isfinite(value):
            self.fail(what, "must be a finite number", text)
        return value

    def integer(self, what: str) -> int:
        """Read a whole number of at most 18 digits.

        Raises
        ------
        InputError
        """
        text = self.word(what)
        if not re.fullmatch("[+-]?[0-9]{1,18}", text):
            self.fail(what, "must be a whole number of at most 18 digits", text)
        return int(text)

    def choice(self, what: str, choices: Sequence[str]) -> str:
        """Read one of some words.

        Raises
        ------
        InputError
            Another word; the nearest is suggested.
        """
        word = self.word(what)
        if word not in choices:
            self.fail(what, f"must be one of {', '.join(choices)}{nearest(word, choices)}", word)
        return word

    def numbers(self, what: str, ntypes: int | None) -> tuple[float, ...]:
        """Read positive numbers, one per atom type.

        Raises
        ------
        InputError
        """
        values: list[float] = []
        while self.left and number(self.peek()) is not None:
            values.append(self.number(what))
        if not values or (ntypes is not None and len(values) != ntypes):
            found = " ".join(map(str, values)) or self.peek()
            self.fail(what, f"needs one value per atom type ({'N' if ntypes is None else ntypes})", found)
        for value in values:
            if value <= 0:
                self.fail(what, "must be positive", value)
        return tuple(values)

    @contextmanager
    def complaints(self) -> Iterator[None]:
        """Put the command at the end of the complaints of what is made of its words.

        Raises
        ------
        InputError
        """
        try:
            yield
        except InputError as error:
            raise error if error.where else error.at(self.command) from None

    def end(self, what: str) -> None:
        """Check that nothing is left.

        Raises
        ------
        InputError
        """
        if self.left:
            self.fail(what, "takes nothing more", self.peek())


def number(text: str) -> float | None:
    """Return the number that a text is, infinity and NaN among them; None for another text."""
    if "_" in text or not text.isascii():  # Python's float takes 1_000 and the digits of every script
        return None
    try:
        return float(text)
    except ValueError:
        return None


def split(text: str) -> Words:
    """Split a command; ``&`` continues a line, ``#`` begins a comment.

    Raises
    ------
    InputError
        Several commands.
    """
    # As in LAMMPS, & is the last printable character of its line, and a comment ends at its (joined) line.
    lines = [line.split("#", 1)[0] for line in re.sub(r"&[ \t\r]*\n", "", text).split("\n")]
    lines = [re.sub(BLANK, " ", line).strip(" ") for line in lines]
    lines = [line for line in lines if line]
    if len(lines) > 1:
        raise InputError("command", "must be a single one (& at the end of a line continues it)", lines[1], lines[0])
    command = lines[0] if lines else ""
    return Words(command.split(" ") if command else [], command)


def fix(text: str, style: str) -> Words:
    """Split a fix command and check ``fix ID all STYLE``.

    Raises
    ------
    InputError
    """
    words = split(text)
    if words.word("command") != "fix":
        words.fail("command", "must begin with fix", words.words[0])
    name = words.word("fix ID")
    if not re.fullmatch("[A-Za-z0-9_]+", name):
        words.fail("fix ID", "must consist of letters, digits and underscores", name)
    group = words.word("group-ID")
    if group != "all":
        words.fail(f"group of fix {style}", "must be all", group)
    given = words.word("fix style")
    if given != style:
        words.fail("fix style", f"must be {style}", given)
    return words
