"""Commands that reach outside LAMMPS and the copy of the deck's folder, said before anything runs.

It is containment that keeps a deck from what it may not do (`lammps_cases.engine.containment`); this gives the better
message, with the line of the deck. Checked are the text of the deck and its includes, and every command after
substitution.
"""

from __future__ import annotations

import os.path
from collections.abc import Iterator
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit import text

RULE = "not allowed in an audit; use --trust if you trust the deck"
# Each of them runs programs, loads libraries, or fetches from the network.
OUTSIDE = frozenset({"shell", "python", "plugin", "mdi", "kim", "geturl", "message", "server"})
# Commands whose file names are read, and those whose words may begin with a slash for other reasons.
READERS = {
    *("include", "jump", "label", "if", "partition", "variable"),
    *("molecule", "read_data", "read_dump", "read_restart", "rerun"),
    *("pair_style", "pair_coeff", "bond_style", "bond_coeff", "angle_coeff", "dihedral_coeff", "improper_coeff"),
}
DEEPEST = 20  # commands within commands
NESTED = "must not nest commands without end"
_COMPRESSED = (".gz", ".bz2", ".zst", ".xz", ".lzma", ".lz4")  # LAMMPS hands these names to a shell
_BY_ITSELF = ("/gz", "/zstd")  # styles that compress without one


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
        if word.endswith(_COMPRESSED) and not any(style.endswith(_BY_ITSELF) for style in arguments):
            return f"compressed file in command {name}, for which LAMMPS runs a program"
        if name not in READERS and _leaves(word):
            return f"path out of the deck's folder in command {name}"
    return ""


def check(command: list[text.Word], where: str, depth: int = 0) -> None:
    """Check one command by its words, and those held by it.

    Raises
    ------
    InputError
        The command is refused; the message holds it.
    """
    if not command:
        return
    if depth > DEEPEST:
        raise InputError("command", NESTED, where=where)
    wrong = fault([word.value for word in command])
    if wrong:
        raise InputError(wrong, RULE, " ".join(" ".join(word.raw for word in command).split()), where)
    for inner in nested(command):
        check(text.words(text.without_comment(inner)), where, depth + 1)


def check_script(path: Path) -> None:
    """Check the text of a deck and of the files of its folder that it includes or jumps to by plain names.

    Raises
    ------
    InputError
        A command is refused, or the deck cannot be read.
    """
    folder = path.resolve().parent
    done: set[Path] = set()
    waiting = [path.resolve()]
    while waiting:
        script = waiting.pop()
        if script in done:
            continue
        done.add(script)
        for number, line in text.read_lines(script):
            check(text.words(text.without_comment(line)), f"{script.name}:{number}")
            waiting += [file for name in _files(line, folder) if (file := _within(name, folder)) is not None]


def _within(path: Path, folder: Path) -> Path | None:
    """Return the file that a path of a deck is, unless it is none or lies outside the folder."""
    try:
        file = path.resolve()
        return file if file.is_file() and file.is_relative_to(folder) else None
    except (OSError, ValueError):  # no name of a file
        return None


def _files(command: str, folder: Path) -> Iterator[Path]:
    words = text.words(text.without_comment(command))
    if not words:
        return
    values = [word.value for word in words]
    if values[0] in ("include", "jump") and len(values) > 1 and values[1] != "SELF" and "$" not in values[1]:
        yield folder / values[1]
    for inner in nested(words):
        yield from _files(inner, folder)
