"""Binary dumps of LAMMPS (``dump custom`` into a file ``*.bin``): every number as LAMMPS has it.

The layout was determined by experiment (LAMMPS 22Jul2025): per snapshot a header with the length of the word that
begins it as a negative number, the word, byte order, revision, step, particles, box, columns, then pieces of particles.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from eos_ref.errors import InputError

WORD = b"DUMP"  # first bytes of the word
LONGEST = 64  # characters of that word
ORDER, REVISION = 1, 2


class Short(Exception):
    """The file ends within a snapshot; the text says how much of it there is."""


class BinarySnapshot(NamedTuple):
    """A snapshot: bounds (3, 2) of the box around, or of the upright box; xy xz yz if it is tilted; rows of numbers."""

    step: int
    bounds_c: npt.NDArray[Any]
    tilt: tuple[float, ...]
    periodic: tuple[bool, ...]
    names: list[str]
    table: npt.NDArray[Any]


def is_binary(content: bytes) -> bool:
    """Return whether a file begins like a binary dump."""
    return len(content) >= 12 and -LONGEST <= struct.unpack_from("<q", content)[0] < 0 and content[8:12] == WORD


def snapshots(content: bytes) -> Iterator[BinarySnapshot]:
    """Read the snapshots of a binary dump.

    Raises
    ------
    InputError
        Another byte order, or a LAMMPS before 2021, whose dumps do not name their columns.
    Short
    """
    reader = _Reader(content)
    while reader.at < len(content):
        yield _snapshot(reader)


def _snapshot(reader: _Reader) -> BinarySnapshot:
    (length,) = reader.take("q")
    if not -LONGEST <= length < 0:
        raise InputError("dump", "must name its columns, as binary dumps do since LAMMPS of 2021")
    reader.take(f"{-length}s")
    order, revision = reader.take("ii")
    if (order, revision) != (ORDER, REVISION):
        raise InputError("dump", f"must be of byte order {ORDER} and revision {REVISION}", [order, revision])
    step, count, tilted = reader.take("qqi")
    sides = reader.take("6i")
    bounds_c = np.array(reader.take("6d")).reshape(3, 2)
    tilt = reader.take("3d") if tilted else ()
    (width,) = reader.take("i")
    reader.text()  # units
    if reader.take("?")[0]:
        reader.take("d")
    names = reader.text().split()
    if width != len(names) or not names or count < 0:
        raise InputError("columns", f"must be the {width} that the header says", " ".join(names))
    rows: list[npt.NDArray[Any]] = []
    for _ in range(reader.take("i")[0]):
        try:
            rows.append(reader.numbers(reader.take("i")[0]))
        except Short:
            some = sum(map(len, rows)) // width
            raise Short(f"{some} of {count} atoms of step {step}") from None
    table = np.concatenate(rows) if rows else np.zeros(0)
    if len(table) != count * width:
        raise InputError("atoms", f"must be the {count} that the header says", len(table) // width)
    periodic = tuple(side == 0 for side in sides[::2])
    return BinarySnapshot(step, bounds_c, tilt, periodic, names, table.reshape(count, width))


class _Reader:
    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def take(self, form: str) -> tuple[Any, ...]:
        end = self.at + struct.calcsize(f"<{form}")
        if end > len(self.content):
            raise Short("a part of a header")
        values = struct.unpack_from(f"<{form}", self.content, self.at)
        self.at = end
        return values

    def text(self) -> str:
        (length,) = self.take("i")
        return str(self.take(f"{max(length, 0)}s")[0], "ascii", "replace")

    def numbers(self, count: int) -> npt.NDArray[Any]:
        if not 0 <= 8 * count <= len(self.content) - self.at:
            raise Short("a part of the atoms")
        values = np.frombuffer(self.content, "<f8", count, self.at)
        self.at += 8 * count
        return values
