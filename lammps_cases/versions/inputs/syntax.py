"""The syntax of commands as data (``syntax.yaml``): their arguments, the words allowed for each, and legal forms.

For every kind of argument there are words, each with a name: mistakes, and the edges of its range.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from lammps_cases.claims.probes.probe import Commands, Edits, base, commands, replaced
from lammps_cases.records.files import DATA
from lammps_cases.records.yaml_files import read_yaml

FILE = DATA / "syntax.yaml"
Kind = Literal["number", "integer", "choice", "types", "group", "id", "name"]
NTYPES = 2  # of the decks
# Before the fixes: a group that is not all particles.
PREAMBLE = ("pair_style", "group some type 1\npair_style")
N = NTYPES
HUGE = "9" * 20
FULL_WIDTH = {ord(digit): 0xFF10 + k for k, digit in enumerate("0123456789")}
EMPTY = '""'
Words = Mapping[str, str]
# Of every argument that is read as a number.
_NO_NUMBER = {
    "word": "seven",
    "boolean": "true",
    "null": "NULL",
    "empty": EMPTY,
    "blank": '" "',
    "two-numbers": '"1 2"',
    "decimal-comma": "1,2",
    "underscore": "1_0",
    "two-points": "1.2.3",
    "two-signs": "--1",
    "sign-alone": "-",
    "hexadecimal": "0x1",
    "fortran-exponent": "1d0",
    "open-exponent": "1e",
    "unit-behind": "1.2kg",
    "quoted-minus": "\u22121",
    "no-break-space": "1\u00a02",
    "unknown-variable": "v_nothing",
    "nan": "nan",
    "negative-nan": "-nan",
    "infinity": "inf",
    "negative-infinity": "-inf",
    "infinity-in-words": "infinity",
    "beyond-doubles": "1e309",
    "beyond-doubles-negative": "-1e309",
}


class Argument(BaseModel):
    """An argument of a command.

    Attributes
    ----------
    range : the numbers allowed: ``any``, ``not 0``, ``> 0``, ``>= 0``, ``0 to 1``, or just one
    of : the words allowed of a choice
    only : of types, those of the legal forms that are allowed, if not all are
    why : the reason for the range
    manual : the same, where a page of the manual states it
    names : further words that a clear error may use for it
    word : the attribute of a name
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Kind
    range: str = "any"
    of: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    why: str = ""
    manual: str = ""
    names: tuple[str, ...] = ()
    word: str = ""

    def allows(self, value: float) -> bool:
        """Return whether a number lies in the range."""
        if not math.isfinite(value):
            return False
        match self.range.split():
            case ["any"]:
                return True
            case ["not", bound]:
                return value != float(bound)
            case [">", bound]:
                return value > float(bound)
            case [">=", bound]:
                return value >= float(bound)
            case [low, "to", high]:
                return float(low) <= value <= float(high)
        return value == float(self.range)


@dataclass(frozen=True)
class FormWord:
    """A word of a form: plain, an argument (its name), or a keyword or style that is also tested."""

    text: str
    argument: str = ""
    keyword: bool = False


@dataclass(frozen=True)
class Form:
    """A legal form of a command.

    Attributes
    ----------
    groups : words that are given together; the first holds the command itself
    before, after : commands around it
    """

    command: Command
    name: str
    groups: tuple[tuple[FormWord, ...], ...]
    before: Commands
    after: Commands

    @property
    def id(self) -> str:
        """Return the first part of the ids of its inputs."""
        return f"{re.sub('[ _/]+', '-', self.command.command)}.{self.name}"

    @property
    def line(self) -> str:
        """Return the command."""
        return text(self.groups)

    def deck(self, *lines: str) -> Commands:
        """Return the deck with other lines in place of the form."""
        return (*self.before, *lines, *self.after)

    def names(self, word: FormWord) -> tuple[str, ...]:
        """Return the words that a clear error may use for a word of the form: for an argument, also its keyword's."""
        group = next(group for group in self.groups if word in group)
        place = group.index(word)
        keyword = next((other.text for other in reversed(group[:place]) if not other.argument), "")
        if keyword in self.command.command.split():  # in every error about the command
            keyword = ""
        own = self.command.arguments.get(word.argument)
        names = (word.argument.split("-of-")[0], *own.names) if own else ()
        return tuple(name for name in (*names, word.text if word.keyword else keyword) if re.search("[A-Za-z]", name))


def text(groups: tuple[tuple[FormWord, ...], ...]) -> str:
    """Return words as a command."""
    return " ".join(word.text for group in groups for word in group if word.text)


class Command(BaseModel):
    """A command: its arguments and the tested forms.

    Attributes
    ----------
    line : the beginning of the deck's command that it replaces
    base : the deck
    manual : the manual's rule for its words
    needed : its rule for a deck without the command, if any
    edits : of forms (empty: all), edits of the deck
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    command: str
    line: str
    base: str = "deck"
    manual: str
    needed: str = ""
    arguments: Mapping[str, Argument] = Field(default_factory=dict)
    forms: Mapping[str, str]
    edits: Mapping[str, Edits] = Field(default_factory=dict)

    def form(self, name: str) -> Form:
        """Return a form by its name."""
        groups = tuple(tuple(map(_word, group.split())) for group in self.forms[name].split("|"))
        edits = (PREAMBLE, *self.edits.get("", ()), *self.edits.get(name, ()))
        lines = replaced(commands(base(self.base)), tuple(edits))
        at = next(k for k, line in enumerate(lines) if line.startswith(self.line))
        return Form(self, name, groups, lines[:at], lines[at + 1 :])


def _word(written: str) -> FormWord:
    if written.startswith("!"):
        return FormWord(written[1:], keyword=True)
    argument, equals, word = written.partition("=")
    return FormWord(word, argument) if equals else FormWord(written)


@functools.cache
def syntax() -> tuple[Command, ...]:
    """Return the commands, in the order of the file."""
    return TypeAdapter(tuple[Command, ...]).validate_python(read_yaml(FILE, "syntax"))


def forms() -> tuple[Form, ...]:
    """Return the legal forms of all commands."""
    return tuple(command.form(name) for command in syntax() for name in command.forms)


def number(argument: Argument, legal: str) -> Words:
    """Return words for a number, given one that is legal."""
    return _NO_NUMBER | {
        "zero": "0",
        "minus-zero": "-0.0",
        "negative": f"-{legal}",
        "minus-one": "-1",
        "subnormal": "1e-310",
        "largest": "1e308",
        "negative-largest": "-1e308",
        "two-to-the-31": "2147483648",
        "two-to-the-32-and-1": "4294967297",
        "plus-sign": f"+{legal}",
        "point-first": f"0{legal}" if not legal.startswith("0") else legal[1:],
        "exponent": f"{legal}e0",
        "full-width": legal.translate(FULL_WIDTH),
    }


def integer(argument: Argument, legal: str) -> Words:
    """Return words for a whole number, given one that is legal."""
    return _NO_NUMBER | {
        "zero": "0",
        "minus-zero": "-0",
        "negative": f"-{legal}",
        "minus-one": "-1",
        "fraction": "1.5",
        "point-zero": f"{legal}.0",
        "exponent": f"{legal}e0",
        "two-to-the-31-less-1": "2147483647",
        "two-to-the-31": "2147483648",
        "two-to-the-32-and-1": "4294967297",
        "twenty-digits": HUGE,
        "plus-sign": f"+{legal}",
        "leading-zero": f"0{legal}",
        "full-width": legal.translate(FULL_WIDTH),
    }


def choice(argument: Argument, legal: str) -> Words:
    """Return words for a choice of several words, given one of them."""
    return {
        "upper-case": legal.upper(),
        "lower-case": legal.lower(),
        "capital": legal.capitalize(),
        "misspelt": legal[:-1] + "x",
        "cut-short": legal[:-1],
        "prolonged": legal + "s",
        "other-script": legal.replace("a", "\u0430").replace("R", "\u211b").replace("o", "\u043e"),
        "number": "1",
        "empty": EMPTY,
        "nan": "nan",
        "blank-behind": f'"{legal} "',
        "no-break-space": f"{legal}\u00a0",
    } | {f"the-word-{word.replace('/', '-')}": word for word in argument.of if word != legal}


# Legal ranges of types in a deck of two types, which reveal how other ones are read.
LEGAL_TYPES = {
    "one": "1",
    "last": f"{N}",
    "all": "*",
    "up-to": "*1",
    "up-to-last": f"*{N}",
    "from": f"{N}*",
    "from-one": "1*",
    "both": f"1*{N}",
    "single-range": "1*1",
    "leading-zero": "01",
}


def types(argument: Argument, legal: str) -> Words:
    """Return words for a range of types."""
    return LEGAL_TYPES | {
        "zero": "0",
        "beyond": f"{N + 1}",
        "up-to-zero": "*0",
        "from-zero": "0*",
        "from-beyond": f"{N + 1}*",
        "up-to-beyond": f"*{N + 1}",
        "to-beyond": f"1*{N + 1}",
        "reversed": f"{N}*1",
        "two-stars": "**",
        "three-stars": "***",
        "two-stars-between": f"1**{N}",
        "star-first-and-last": "*1*",
        "two-ranges": "1*2*3",
        "hyphen": f"1-{N}",
        "hyphen-alone": "-",
        "comma": f"1,{N}",
        "semicolon": f"1;{N}",
        "colon": f"1:{N}",
        "slash": f"1/{N}",
        "points": f"1..{N}",
        "blank": '" "',
        "empty": EMPTY,
        "quoted-list": f'"1 {N}"',
        "negative": "-1",
        "negative-bound": "*-1",
        "from-negative": "-1*",
        "plus-sign": "+1",
        "fraction": "1.5",
        "exponent": "1e0",
        "hexadecimal": "0x1",
        "two-to-the-31": "2147483648",
        "two-to-the-32-and-1": "4294967297",
        "up-to-two-to-the-32-and-2": "*4294967298",
        "from-two-to-the-32-and-1": "4294967297*",
        "twenty-digits": HUGE,
        "up-to-twenty-digits": f"*{HUGE}",
        "word": "water",
        "nan": "nan",
        "letter-behind": "1x",
        "star-in-letters": "a*b",
        "brackets": f"[1-{N}]",
        "full-width": "\uff11",
        "full-width-star": "\uff0a",
        "operator-star": "\u2217",
        "no-break-space": f"1\u00a0{N}",
        "quoted-minus": f"1\u2212{N}",
    }


def group(argument: Argument, legal: str) -> Words:
    """Return words for a group, where only all is allowed."""
    return {
        "another": "some",
        "unknown": "nobody",
        "upper-case": "ALL",
        "number": "1",
        "star": "*",
        "empty": EMPTY,
        "full-width": "\uff41\uff4c\uff4c",
    }


def id(argument: Argument, legal: str) -> Words:
    """Return words for the ID of a fix."""
    return {
        "hyphen": "a-b",
        "fraction": "1.5",
        "blank": '"a b"',
        "empty": EMPTY,
        "star": "*",
        "accent": "\u00fc",
        "no-break-space": "a\u00a0b",
        "word": "a_1",
    }


def name(argument: Argument, legal: str) -> Words:
    """Return words for an attribute of particles, given one; with components, if it has them."""
    stem, _, last = legal.rpartition("/")
    words = {
        "upper-case": legal.upper(),
        "misspelt": legal[:-1] + "q",
        "cut-short": legal[:-1],
        "prolonged": legal + "s",
        "number": "1",
        "empty": EMPTY,
        "temperature": "temperature",
        "nbond-shell": "nbond/shell",
        "surface": "surface",
        "chi": "chi",
        "star": "*",
        "full-width": legal.replace("/", "\uff0f"),
        "twice": f"{legal} {legal}",
    }
    if stem and len(last) < 3:
        words |= {
            "third-axis": f"{stem}/{'z' * len(last)}",
            "fourth-axis": f"{stem}/{'w' * len(last)}",
            "one-component-more": f"{stem}/{last}x",
            "no-component": stem,
            "empty-component": f"{stem}/",
            "star-twice": f"{stem}/**",
            "all-components": f"{stem}/*",
            "upper-case-component": f"{stem}/{last.upper()}",
            "number-of-component": f"{stem}/1",
        }
    return words


WORDS: Mapping[str, Callable[[Argument, str], Words]] = {
    of.__name__: of for of in (number, integer, choice, types, group, id, name)
}


def words_for(argument: Argument, legal: str) -> Words:
    """Return words for an argument by their names, given a legal one, which is not among them."""
    return {name: word for name, word in WORDS[argument.kind](argument, legal).items() if word != legal}


def words_for_keyword(word: str) -> Words:
    """Return words in place of a keyword or style."""
    return {
        "upper-case": word.upper(),
        "capital": word.capitalize(),
        "misspelt": word[:-1] + "x",
        "prolonged": word + "s",
        "no-slash": word.replace("/", ""),
        "hyphen-for-slash": word.replace("/", "-"),
        "underscore-for-slash": word.replace("/", "_"),
        "full-width-slash": word.replace("/", "\uff0f"),
        "number": "1",
        "empty": EMPTY,
    }
