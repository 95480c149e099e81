"""Where a deck runs: the folder that is copied, the one in which LAMMPS runs, and what the deck reads and writes there.

``lmp -in path/in.x`` runs in the current folder, and its file names are relative to it. So does an audit if the files
that the deck reads by plain names lie there, or in the folder of ``--root``; otherwise it runs in the deck's own one.
"""

from __future__ import annotations

import itertools
import os.path
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from eos_ref.errors import InputError
from lammps_cases.audit import text

READERS = {
    *("include", "jump", "variable", "molecule", "read_data", "read_dump", "read_restart", "rerun"),
    *("pair_style", "pair_coeff", "bond_style", "bond_coeff", "angle_coeff", "dihedral_coeff", "improper_coeff"),
}
# Where the file that a command writes stands among its words.
WRITERS = {"dump": 5, "write_dump": 3, "write_data": 1, "write_restart": 1, "restart": 2, "log": 1}
DEEPEST = 20  # commands within commands
_VARIABLE = re.compile(r"\$\{(\w+)\}|\$(\w)")


def files(values: Sequence[str]) -> list[str]:
    """Return the words of a command that may be names of files; a slash in others has other meanings."""
    match values:
        case ["label" | "if" | "partition", *_]:
            return []
        case ["jump", "SELF", *_]:
            return []
        case ["jump", file, *_]:
            return [file]
        case ["variable", _, "file" | "atomfile", *names]:
            return names
        case ["variable", *_]:
            return []
        case ["print", _, *words]:
            return words
        case _:
            return list(values[1:])


def written(values: Sequence[str]) -> list[str]:
    """Return the names of the files that a command writes."""
    at = WRITERS.get(values[0], len(values))
    pairs = itertools.pairwise(values) if values[0] not in READERS else ()
    behind = [name for word, name in pairs if word in ("file", "append")]
    return [*values[at : at + (2 if values[0] == "restart" else 1)], *behind]


@dataclass(frozen=True)
class DeckPlace:
    """Where a deck runs.

    Attributes
    ----------
    root : the folder that is copied, and may be read
    working : that in which LAMMPS runs, within it
    current : the user's
    own : that of the deck
    """

    root: Path = Path("/")
    working: Path = Path("/")
    current: Path = field(default_factory=Path.cwd)
    own: Path | None = None

    @property
    def within(self) -> Path:
        """Return the path from the one to the other."""
        return self.working.relative_to(self.root)

    def left(self, values: Sequence[str]) -> list[str]:
        """Return the words of a command that are paths out of what is copied."""
        return [word for word in files(values) if self.leaves(word)]

    def leaves(self, word: str) -> bool:
        """Return whether a word is such a path."""
        if any(c.isspace() for c in word) or not word.strip("/"):
            return False
        up = os.path.normpath(word).split("/").count("..")
        return word.startswith("/") or up > len(self.within.parts)

    def refusal(self, words: Sequence[str], command: str, found: str, where: str) -> InputError:
        """Return the complaint about such paths, with what to type."""
        targets = [Path(os.path.normpath(self.working / word)).parent for word in words if word[0] != "/"]
        common = os.path.commonpath([self.root, self.own or self.root, *targets])
        root = f"--root {os.path.relpath(common, self.current)}, to copy that folder, or "
        some = root if targets and common != "/" else ""
        rule = (
            f"must not leave the folder that is copied: type {some}--trust, to run the deck with all your permissions"
        )
        return InputError(f"path in command {command}", rule, found, where)


class DeckLine(NamedTuple):
    """A line of a deck, its place, and the words of its commands: its own and those held by it, as far as known."""

    where: str
    text: str
    commands: list[list[str]]


def find(deck: Path, root: Path | None, var: Mapping[str, Sequence[str]]) -> DeckPlace:
    """Return where a deck runs.

    Raises
    ------
    InputError
        The root is no folder, or does not hold the deck; the deck cannot be read.
    """
    own, current = deck.resolve().parent, Path.cwd()
    top = None if root is None else root.resolve()
    if top is not None and not (top.is_dir() and own.is_relative_to(top)):
        raise InputError("root", "must be a folder that holds the deck", str(root), "option --root")
    beside = _read(deck, own, var)
    others = [current] if top is None else [each for each in (current, top) if each.is_relative_to(top)]
    fitting = (each for each in others if (here := _read(deck, each, var)) and here >= beside)
    working = next(fitting, own)
    return DeckPlace(top or working, working, own=own)


def _read(deck: Path, working: Path, var: Mapping[str, Sequence[str]]) -> set[str]:
    """Return the files that a deck reads by plain names and that are there."""
    commands = [values for line in lines(deck, DeckPlace(working, working), var) for values in line.commands]
    names = {name for values in commands if values[0] in READERS for name in files(values)}
    return {name for name in names if _file(working / name) is not None}


def lines(deck: Path, place: DeckPlace, var: Mapping[str, Sequence[str]]) -> Iterator[DeckLine]:
    """Yield the lines of a deck and of the files within a place that it includes or jumps to, each file once.

    Variables of style index and string that the lines before define are replaced by their first value.

    Raises
    ------
    InputError
        The deck cannot be read.
    """
    known = {name: values[0] for name, values in var.items()}
    done = {deck.resolve()}
    reading = [_numbered(deck.resolve())]
    while reading:
        if (at := next(reading[-1], None)) is None:
            reading.pop()
            continue
        command = text.without_comment(at[1])
        commands = list(_commands(command, known))
        yield DeckLine(at[0], command, commands)
        for values in commands:
            match values:
                case ["variable", name, "index", value, *_] if "$" not in value:
                    known.setdefault(name, value)
                case ["variable", name, "string", value] if "$" not in value:
                    known[name] = value
                case ["include" | "jump", name, *_] if name != "SELF":
                    file = _file(place.working / name)
                    if file is not None and file.is_relative_to(place.root) and file not in done:
                        done.add(file)
                        reading.append(_numbered(file))


def _numbered(script: Path) -> Iterator[tuple[str, str]]:
    return ((f"{script.name}:{number}", line) for number, line in text.read_lines(script))


def _commands(command: str, known: Mapping[str, str], depth: int = 0) -> Iterator[list[str]]:
    words = text.words(_VARIABLE.sub(lambda match: known.get(match[1] or match[2], match[0]), command))
    if words and depth <= DEEPEST:
        yield [word.value for word in words]
        for inner in text.nested(words):
            yield from _commands(text.without_comment(inner), known, depth + 1)


def _file(path: Path) -> Path | None:
    """Return the file that a path of a deck is, unless it is none."""
    try:
        file = path.resolve()
        return file if file.is_file() else None
    except (OSError, ValueError):  # no name of a file
        return None
