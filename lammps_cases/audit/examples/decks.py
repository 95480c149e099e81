"""The decks of LAMMPS' examples, and the logs that LAMMPS ships beside them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eos_ref.errors import InputError, nearest
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine

LARGEST = 2**24  # bytes of a log
LOOP = re.compile(r"^Loop time of \S+ on (\d+) procs", re.MULTILINE)
VERSION = re.compile(r"^LAMMPS \((\d+ \w+ \d+)", re.MULTILINE)


@dataclass(frozen=True)
class ExampleDeck:
    """A deck by the name of its folder, with the logs beside it, the newest last."""

    name: str
    path: Path
    logs: tuple[Path, ...] = ()


@dataclass(frozen=True)
class ShippedLog:
    """What a log says: the version of LAMMPS and ranks that wrote it, and its thermo output by column."""

    name: str
    version: str
    ranks: int
    columns: dict[str, list[float]]


def decks(engine: Engine, folder: Path | None, names: Sequence[str] = ()) -> list[ExampleDeck]:
    """Return decks of a folder, by default those that are installed with an engine.

    Raises
    ------
    InputError
        There is no deck, or none of a name.
    """
    folder = folder or installations.examples(engine)
    if folder is None:
        rule = "are not installed with this LAMMPS: give the folder examples/rheo of its sources, --from DIR"
        raise InputError("example decks", rule, engine.name)
    every = [_deck(path, folder) for path in sorted({*folder.glob("*/in.*"), *folder.glob("in.*")}) if path.is_file()]
    if not every:
        raise InputError(
            "example decks", "must lie as in.* in the folder or its subfolders", str(folder), "option --from"
        )
    present = [deck.name for deck in every]
    for name in names:
        if name not in present:
            raise InputError("example", f"must be one of {', '.join(present)}{nearest(name, present)}", name)
    return [deck for deck in every if not names or deck.name in names]


def _deck(path: Path, folder: Path) -> ExampleDeck:
    alone = path.parent == folder or len(list(path.parent.glob("in.*"))) > 1
    logs = sorted(path.parent.glob("log.*.g++.*"), key=lambda log: log.stat().st_mtime)
    return ExampleDeck(path.name.removeprefix("in.") if alone else path.parent.name, path, () if alone else tuple(logs))


def shipped_log(path: Path) -> ShippedLog | None:
    """Return what a log says; None if it is none that can be read."""
    if path.stat().st_size > LARGEST:
        return None
    text = path.read_text(errors="replace")
    version, loop = VERSION.search(text), LOOP.search(text)
    head = re.search(r"^[ \t]*Step[ \t]+.*$", text, re.MULTILINE)
    if version is None or loop is None or head is None:
        return None
    titles = head[0].split()
    rows = []
    for line in text[head.end() : loop.start()].splitlines():
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            continue  # a warning in between
        if len(row) == len(titles):
            rows.append(row)
    columns = {title: [row[k] for row in rows] for k, title in enumerate(titles)}
    return ShippedLog(path.name, version[1], int(loop[1]), columns) if rows else None
