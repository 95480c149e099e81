"""Commands that reach outside LAMMPS and the copy of the deck's folder, said before anything runs.

It is containment that keeps a deck from what it may not do (`lammps_cases.engine.containment`); this gives the better
message, with the line of the deck. Checked are the text of the deck and its includes, and every command after
substitution.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from eos_ref.errors import InputError
from lammps_cases.audit import place, text
from lammps_cases.audit.place import DeckPlace

RULE = "not allowed in an audit; use --trust if you trust the deck"
# Each of them runs programs, loads libraries, or fetches from the network.
OUTSIDE = frozenset({"shell", "python", "plugin", "mdi", "kim", "geturl", "message", "server"})
EMPTY: Mapping[str, Sequence[str]] = MappingProxyType({})
NESTED = "must not nest commands without end"
_COMPRESSED = (".gz", ".bz2", ".zst", ".xz", ".lzma", ".lz4")  # LAMMPS hands these names to a shell
_BY_ITSELF = ("/gz", "/zstd")  # styles that compress without one


def is_open(values: list[str]) -> bool:
    """Return whether a command that LAMMPS substitutes later may still become one that `fault` refuses."""
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
    if any(word.endswith(_COMPRESSED) for word in place.files(values)) and not any(
        style.endswith(_BY_ITSELF) for style in arguments
    ):
        return f"compressed file in command {name}, for which LAMMPS runs a program"
    return ""


def check(command: list[text.Word], where: str, within: DeckPlace | None, depth: int = 0) -> None:
    """Check one command by its words, and those held by it.

    Parameters
    ----------
    within : DeckPlace, optional
        What has been copied: paths may not leave it. Paths are not checked without.

    Raises
    ------
    InputError
        The command is refused; the message holds it.
    """
    if not command:
        return
    if depth > place.DEEPEST:
        raise InputError("command", NESTED, where=where)
    values, written = [word.value for word in command], " ".join(" ".join(word.raw for word in command).split())
    if wrong := fault(values):
        raise InputError(wrong, RULE, written, where)
    if within is not None and (away := within.left(values)):
        raise within.refusal(away, values[0], written, where)
    for inner in text.nested(command):
        check(text.words(text.without_comment(inner)), where, within, depth + 1)


def check_script(path: Path, within: DeckPlace | None = None, var: Mapping[str, Sequence[str]] = EMPTY) -> None:
    """Check the text of a deck and of the files that it includes or jumps to, by names that follow from the text.

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
    for line in place.lines(path, within, var):
        check(text.words(line.text), line.where, None)
        leaving += [(line, values, away) for values in line.commands if (away := within.left(values))]
    if leaving:
        line, values, _ = leaving[0]
        raise within.refusal([word for *_, away in leaving for word in away], values[0], line.text, line.where)
