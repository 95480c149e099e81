"""Where a deck runs: the folder that is copied, the folder in which LAMMPS runs, and the files read and written there.

``lmp -in path/in.x`` runs in the current folder, and its file names are relative to it. So does an audit if the files
that the deck reads by plain names lie there, or in the folder of ``--root``; otherwise it runs in the deck's own one.

Commands that reach outside LAMMPS and that copy are refused before anything runs. It is containment that keeps a deck
from what it may not do (`lammps_cases.engine.containment`); this gives the better message, with the line of the deck.
Checked are the text of the deck and its includes, and every command after substitution.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import os.path
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
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
RULE = "not allowed in an audit; use --trust if you trust the deck"
# Each of them runs programs, loads libraries, or fetches from the network.
OUTSIDE = frozenset({"shell", "python", "plugin", "mdi", "kim", "geturl", "message", "server"})
EMPTY: Mapping[str, Sequence[str]] = MappingProxyType({})
NESTED = "must not nest commands without end"
_COMPRESSED = (".gz", ".bz2", ".zst", ".xz", ".lzma", ".lz4")  # LAMMPS hands these names to a shell
_BY_ITSELF = ("/gz", "/zstd")  # styles that compress without one
LARGEST = 2 * 2**30  # bytes; for a deck in a home folder not all of it must be copied


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
        """Return whether a word is a path out of what is copied."""
        if any(c.isspace() for c in word) or not word.strip("/"):
            return False
        up = os.path.normpath(word).split("/").count("..")
        return word.startswith("/") or up > len(self.within.parts)

    def refusal(self, words: Sequence[str], command: str, found: str, where: str) -> InputError:
        """Return the error about such paths, with the command to type."""
        targets = [Path(os.path.normpath(self.working / word)).parent for word in words if word[0] != "/"]
        common = os.path.commonpath([self.root, self.own or self.root, *targets])
        root = f"--root {os.path.relpath(common, self.current)}, to copy that folder, or "
        some = root if targets and common != "/" else ""
        rule = (
            f"must not leave the folder that is copied: type {some}--trust, to run the deck with all your permissions"
        )
        return InputError(f"path in command {command}", rule, found, where)


class DeckLine(NamedTuple):
    """A line of a deck, its place, and the words of its command and of nested commands, as far as known."""

    where: str
    text: str
    commands: list[list[str]]


def find(deck: Path, root: Path | None, var: Mapping[str, Sequence[str]]) -> DeckPlace:
    """Return where a deck runs.

    Raises
    ------
    InputError
        The root is not a folder, or does not hold the deck; the deck cannot be read.
    """
    own, current = deck.resolve().parent, Path.cwd()
    top = None if root is None else root.resolve()
    if top is not None and not (top.is_dir() and own.is_relative_to(top)):
        raise InputError("root", "must be a folder that holds the deck", str(root), "option --root")
    own_files = _read(deck, own, var)
    others = [current] if top is None else [each for each in (current, top) if each.is_relative_to(top)]
    fitting = (each for each in others if (here := _read(deck, each, var)) and here >= own_files)
    working = next(fitting, own)
    return DeckPlace(top or working, working, own=own)


def _read(deck: Path, working: Path, var: Mapping[str, Sequence[str]]) -> set[str]:
    """Return the existing files that a deck reads by plain names."""
    commands = [values for line in lines(deck, DeckPlace(working, working), var) for values in line.commands]
    names = {name for values in commands if values[0] in READERS for name in files(values)}
    return {name for name in names if _file(working / name) is not None}


def lines(deck: Path, place: DeckPlace, var: Mapping[str, Sequence[str]]) -> Iterator[DeckLine]:
    """Yield the lines of a deck and of the files in its place that it includes or jumps to, each file once.

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
    """Return the file that a path of a deck names; None if it does not exist."""
    try:
        file = path.resolve()
        return file if file.is_file() else None
    except (OSError, ValueError):  # not a file name
        return None


def is_open(values: list[str]) -> bool:
    """Return whether a command may, after substitution by LAMMPS, be one that `fault` refuses."""
    name, arguments = values[0], values[1:]
    if name.startswith(("write_", "dump", "restart", "log", "fix", "pair_style")):
        return any("$" in word for word in arguments)
    return "$" in name or (name == "print" and any("$" in word for word in arguments[1:]))


def fault(values: list[str]) -> str:
    """Return what is wrong with a command given by its words, or nothing."""
    name, arguments = values[0], values[1:]
    if name in OUTSIDE:
        return f"command {name}"
    if name == "variable" and arguments[1:2] == ["python"]:
        return "variable of style python"
    if name == "fix" and arguments[2:3] and arguments[2].startswith(("python", "mdi", "imd", "ipi")):
        return f"fix {arguments[2]}"
    if name in ("pair_style", "pair_coeff") and {"python", "kim", "mliappy"} & set(arguments):
        return f"{name} with Python or KIM"
    if name in ("dump", "write_dump") and "movie" in arguments:
        return f"{name} movie (runs a program)"
    if any(word.endswith(_COMPRESSED) for word in files(values)) and not any(
        style.endswith(_BY_ITSELF) for style in arguments
    ):
        return f"compressed file in command {name}, for which LAMMPS runs a program"
    return ""


def check_command(command: list[text.Word], where: str, within: DeckPlace | None, depth: int = 0) -> None:
    """Check one command by its words, and its nested commands.

    Parameters
    ----------
    within : DeckPlace, optional
        What has been copied: paths may not leave it. Without it paths are not checked.

    Raises
    ------
    InputError
        The command is refused; the message holds it.
    """
    if not command:
        return
    if depth > DEEPEST:
        raise InputError("command", NESTED, where=where)
    values, written = [word.value for word in command], " ".join(" ".join(word.raw for word in command).split())
    if wrong := fault(values):
        raise InputError(wrong, RULE, written, where)
    if within is not None and (away := within.left(values)):
        raise within.refusal(away, values[0], written, where)
    for inner in text.nested(command):
        check_command(text.words(text.without_comment(inner)), where, within, depth + 1)


def check_script(path: Path, within: DeckPlace | None = None, var: Mapping[str, Sequence[str]] = EMPTY) -> None:
    """Check the text of a deck and of the files that it includes or jumps to, as far as the text gives their names.

    Parameters
    ----------
    path : Path
    within : DeckPlace, optional
        What is copied, and where the deck runs; by default its folder.
    var : mapping
        Variables that are defined before the deck.

    Raises
    ------
    InputError
        A command is refused, or the deck cannot be read.
    """
    within = within or DeckPlace(folder := path.resolve().parent, folder)
    leaving = []
    for line in lines(path, within, var):
        check_command(text.words(line.text), line.where, None)
        leaving += [(line, values, away) for values in line.commands if (away := within.left(values))]
    if leaving:
        line, values, _ = leaving[0]
        raise within.refusal([word for *_, away in leaving for word in away], values[0], line.text, line.where)


def copy_folder(source: Path, target: Path, largest: int = LARGEST, links_out: bool = False) -> None:
    """Copy the files below a folder; sockets and the like are left out, and links that lead out of it.

    With ``links_out``, all links are followed.

    The copies belong to the user and can be written to, whatever the modes of the originals.

    Raises
    ------
    InputError
        More than ``largest`` bytes, or a file that cannot be read.
    """
    copied = 0
    done: set[Path] = set()
    for directory, folders, files in os.walk(source, followlinks=True):
        here = Path(directory)
        folders[:] = [name for name in folders if links_out or _is_within(source, here / name)]
        if here.resolve() in done or (target.resolve().is_relative_to(here.resolve()) and here != source):
            folders.clear()  # a link to a folder above, or the copy itself
            continue
        done.add(here.resolve())
        to = target / here.relative_to(source)
        to.mkdir(parents=True, exist_ok=True)
        for file in sorted(files):
            if not (here / file).is_file() or not (links_out or _is_within(source, here / file)):
                continue
            copied += (here / file).stat().st_size
            if copied > largest:
                rule = (
                    f"must hold at most {largest / 2**20:.0f} MiB, as it is copied (give the deck a folder of its own)"
                )
                raise InputError("folder of the deck", rule, where=str(source))
            try:
                shutil.copyfile(here / file, to / file)
            except OSError as error:
                raise InputError(file, f"cannot be copied: {error.strerror}", where=str(here)) from None


def nested_folder(source: Path, target: Path) -> Path:
    """Make and return the folder ``target/a/b`` for the copy of a source ``/a/b``.

    Other content of the folders above the source is linked, so that relative paths remain valid.
    """
    here = target
    for folder, name in zip(reversed(source.parents), source.parts[1:], strict=True):
        with contextlib.suppress(OSError):  # a folder that may be entered, but not listed
            for other in folder.iterdir():
                if other.name != name:
                    (here / other.name).symlink_to(other)
        here = here / name
        here.mkdir()
    return here


def _is_within(folder: Path, path: Path) -> bool:
    return not path.is_symlink() or path.resolve().is_relative_to(folder)
