"""Commands that reach outside LAMMPS and the copy of the deck's folder: refused unless allowed.

Checked twice: on the text of the deck and its includes before anything runs, and on every command after substitution,
just before LAMMPS gets it, so that a command made of variables does not slip past.
"""

from __future__ import annotations

import os.path
import re
from collections.abc import Iterator
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit import text

RULE = "may not be run by an audit (allow it with --allow-shell)"
# Each of them runs programs, loads libraries, or fetches from the network.
OUTSIDE = frozenset({"shell", "python", "plugin", "mdi", "kim", "geturl", "message", "server"})
# Commands whose file names are read, and those whose words may begin with a slash for other reasons.
READERS = {
    *("include", "jump", "label", "if", "partition", "variable"),
    *("molecule", "read_data", "read_dump", "read_restart", "rerun"),
    *("pair_style", "pair_coeff", "bond_style", "bond_coeff", "angle_coeff", "dihedral_coeff", "improper_coeff"),
}
_COMPRESSED = (".gz", ".bz2", ".zst", ".xz", ".lzma", ".lz4")  # LAMMPS hands these names to a shell
_PLAIN_NAME = re.compile(r"[\w./*%+,=@~-]*")


def nested(command: list[text.Word]) -> list[str]:
    """Return the commands held by the words of another one: ``if``, ``run ... every``, ``partition``."""
    values = [word.value for word in command]
    match values[0]:
        case "if":
            try:
                return [inner for branch in text.branches(command)[1] for inner in branch]
            except ValueError:
                return []
        case "run" if "every" in values[2:]:
            return [inner for inner in values[values.index("every") + 2 :] if inner != "NULL"]
        case "partition":
            return [" ".join(word.raw for word in command[3:])]
        case _:
            return []


def is_open(values: list[str]) -> bool:
    """Return whether a command that LAMMPS substitutes later may still become one that `fault` refuses."""
    name, arguments = values[0], values[1:]
    if name.startswith(("write_", "dump", "restart", "log", "fix", "pair_style")):
        return any("$" in word for word in arguments)
    return "$" in name or (name == "print" and any("$" in word for word in arguments[1:]))


def _leaves(word: str) -> bool:
    """Return whether a word is a path out of the current folder."""
    if any(c.isspace() for c in word) or not word.strip("/"):
        return False
    return word.startswith("/") or os.path.normpath(word).split("/")[0] == ".."


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
    for word in arguments[1:] if name == "print" else arguments:
        if word.endswith(_COMPRESSED) and not _PLAIN_NAME.fullmatch(word):
            return "name of a compressed file with characters that a shell reads"
        if name not in READERS and _leaves(word):
            return f"path out of the deck's folder in command {name}"
    return ""


def check(command: list[text.Word], where: str) -> None:
    """Check one command by its words, and those held by it.

    Raises
    ------
    InputError
        The command is refused; the message holds it.
    """
    if not command:
        return
    wrong = fault([word.value for word in command])
    if wrong:
        raise InputError(wrong, RULE, " ".join(" ".join(word.raw for word in command).split()), where)
    for inner in nested(command):
        check(text.words(text.without_comment(inner)), where)


def check_script(path: Path) -> None:
    """Check the text of a deck and of the files it includes or jumps to, as far as their names are plain.

    Raises
    ------
    InputError
        A command is refused, or the deck cannot be read.
    """
    done: set[Path] = set()
    waiting = [path]
    while waiting:
        script = waiting.pop()
        if script in done:
            continue
        done.add(script)
        for number, line in text.read_lines(script):
            check(text.words(text.without_comment(line)), f"{script.name}:{number}")
            waiting += [file for file in _files(line, path.parent) if file.is_file()]


def _files(command: str, folder: Path) -> Iterator[Path]:
    words = text.words(text.without_comment(command))
    if not words:
        return
    values = [word.value for word in words]
    if values[0] in ("include", "jump") and len(values) > 1 and values[1] != "SELF" and "$" not in values[1]:
        yield folder / values[1]
    for inner in nested(words):
        yield from _files(inner, folder)
