"""The syntax of commands as data (``syntax.yaml``): their arguments, what is allowed for each, and legal forms."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Mapping
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


class Argument(BaseModel):
    """An argument of a command.

    Attributes
    ----------
    range : the numbers allowed: ``any``, ``not 0``, ``> 0``, ``>= 0``, ``0 to 1``, or just one
    of : the words allowed of a choice
    only : of types, those of the legal forms that are allowed, if not all are
    why : by what the range is limited
    manual : the same, where a page of the manual says it
    names : further words by which a clear error may call it
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
    """A word of a form: plain, an argument (its name), or a keyword or style that is put to the test too."""

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
        """Return the deck with other lines in its place."""
        return (*self.before, *lines, *self.after)

    def names(self, word: FormWord) -> tuple[str, ...]:
        """Return the words by which a clear error may call a word of the form: of an argument, its keyword's too."""
        group = next(group for group in self.groups if word in group)
        place = group.index(word)
        keyword = next((other.text for other in reversed(group[:place]) if not other.argument), "")
        if keyword in self.command.command.split():  # every error about the command has it
            keyword = ""
        own = self.command.arguments.get(word.argument)
        names = (word.argument.split("-of-")[0], *own.names) if own else ()
        return tuple(name for name in (*names, word.text if word.keyword else keyword) if re.search("[A-Za-z]", name))


def text(groups: tuple[tuple[FormWord, ...], ...]) -> str:
    """Return words as a command."""
    return " ".join(word.text for group in groups for word in group if word.text)


class Command(BaseModel):
    """A command: its arguments, and the forms that are put to the test.

    Attributes
    ----------
    line : how it begins in the deck, the command of which it replaces
    base : the deck
    manual : what the manual says of its words
    needed : what it says of a deck without the command, if anything
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
