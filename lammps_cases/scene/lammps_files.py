"""LAMMPS' own files: data files, as ``write_data`` writes them, and dumps."""

from __future__ import annotations

import gzip
import io
import itertools
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.errors import InputError, nearest
from lammps_cases.records.files import MIB, read_bytes, read_text
from lammps_cases.scene import Scene, binary_dumps

Array = npt.NDArray[Any]
LARGEST = 2048 * MIB
GZIP, HEAD = b"\x1f\x8b", 100  # magic number of gzip, and the number of bytes that identify a binary file
SOLID = 1  # bit of the status of a particle
STYLES = {
    "rheo": ("id", "type", "status", "rho", "x", "y", "z"),
    "rheo/thermal": ("id", "type", "status", "rho", "energy", "x", "y", "z"),
}
OTHERS = {b"CDF": "dump netcdf", b"\x89HDF": "dump h5md or netcdf"}
WHOLE = "must end with a whole snapshot"
_EDGES = {f"{axis}lo {axis}hi": c for c, axis in enumerate("xyz")}
_TILT, _COUNT = "xy xz yz", "atoms"
_SECTION = re.compile(r"([A-Z][A-Za-z ]*?)\s*(?:#\s*(\S+))?\s*$")


class CutOff(InputError):
    """A file ends within a snapshot; ``found`` says how much of it there is."""


@dataclass(frozen=True)
class FileSnapshot:
    """Particles of a file, in its own order.

    Attributes
    ----------
    step : time step
    low_c, high_c : (3,) corners of the box
    periodic : one flag per axis; all true where the file does not say
    tilt : xy, xz and yz, or nothing
    columns : values by the names of the file, (n,), as text, or numbers of a binary file
    exact : whether these are LAMMPS' own numbers, not printed digits
    """

    step: int
    low_c: Array
    high_c: Array
    periodic: tuple[bool, ...]
    tilt: tuple[float, ...]
    columns: Mapping[str, Array]
    exact: bool = False

    def numbers(self, name: str, kind: type = float) -> Array:
        """Return a column as numbers, whole ones for kind int; NaN and infinity are allowed for kind float.

        Raises
        ------
        InputError
            No such column, or not all of its values are numbers.
        """
        if name not in self.columns:
            raise InputError("column", f"must be one of {', '.join(self.columns)}{nearest(name, self.columns)}", name)
        values_n = self.columns[name]
        if kind is int and self.exact:
            for wrong in np.flatnonzero(~((np.abs(values_n) < 2**63) & (values_n == np.rint(values_n)))).tolist():
                raise self._refused(name, "must hold whole numbers", wrong)
        try:
            return values_n.astype(kind)
        except (ValueError, OverflowError):
            wrong = next(k for k in range(len(values_n)) if not _is_number(values_n[k], kind))
            raise self._refused(name, f"must hold {'whole ' * (kind is int)}numbers", wrong) from None

    def finite(self, name: str) -> Array:
        """Return a column as finite numbers; raises as `numbers`, also for NaN and infinity."""
        values_n = self.numbers(name)
        for wrong in np.flatnonzero(~np.isfinite(values_n)).tolist():
            raise self._refused(name, "must hold finite numbers", wrong)
        return values_n

    def _refused(self, name: str, rule: str, row: int) -> InputError:
        place = f"row {row + 1}" if name == "id" else f"row {row + 1}, atom {self._word('id', row)}"
        return InputError(f"column {name}", rule, self._word(name, row), place)

    def _word(self, name: str, row: int) -> str:
        """Return a number as the file has it."""
        value = self.columns[name][row]
        return f"{value:.17g}" if self.exact else str(value.decode())


def read_data(path: Path, scene: Scene, periodic: tuple[bool, ...] | None) -> dict[str, Any]:
    """Return the particles of a data file, by id: the arrays that a scene takes.

    Returns
    -------
    dict
        x (n, 3), type, low, high, periodic, spacing, tilt and, if present, rho, energy (of a particle), v, solid.

    Raises
    ------
    InputError
        Not readable, not such a file, or its box does not suit the scene.
    """
    with _at(path.name):
        snapshot = data_file(path)
        if periodic is not None and len(periodic) != scene.dimension:
            raise InputError("positions.periodic", f"needs {scene.dimension} flags", list(periodic))
        flags = (*(periodic or (True,) * scene.dimension), *(True,) * (3 - scene.dimension))
        return arrays(replace(snapshot, periodic=flags), {}) | _box(replace(snapshot, periodic=flags), scene)


def read_dump(path: Path, scene: Scene, step: int | None, named: Mapping[str, str]) -> dict[str, Any]:
    """Return the particles of a snapshot of a dump, by id, as `read_data` does.

    Parameters
    ----------
    step : int or None
        Of the snapshot; the last one unless given.
    named : mapping
        Columns that hold rho and energy under other names.

    Raises
    ------
    InputError
        As `read_data`; or no such snapshot or column.
    """
    with _at(path.name):
        every = list(snapshots(path))
        if not every:
            raise InputError("dump", "must hold a snapshot")
        of_step = every if step is None else [one for one in every if one.step == step]
        if not of_step:
            raise InputError("positions.step", f"must be one of {', '.join(str(one.step) for one in every)}", step)
        with _at(f"step {of_step[-1].step}"):
            return arrays(of_step[-1], named) | _box(of_step[-1], scene)


@contextmanager
def _at(place: str) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise error.at(place) from None


def _box(snapshot: FileSnapshot, scene: Scene) -> dict[str, Any]:
    d = scene.dimension
    edges_c = (snapshot.high_c - snapshot.low_c)[:d]
    ends = [snapshot.low_c.tolist(), snapshot.high_c.tolist(), list(snapshot.tilt)]
    if not np.isfinite(np.concatenate(ends)).all():
        raise InputError("box", "must hold finite numbers", ends)
    if not np.all(edges_c > 0):
        raise InputError("box", "needs low < high", ends[:2])
    count = len(next(iter(snapshot.columns.values())))
    if not count:
        raise InputError("atoms", "must be at least one")
    periodic = tuple(flag or c >= d for c, flag in enumerate(snapshot.periodic))
    tilt = snapshot.tilt[: d * (d - 1) // 2] if any(snapshot.tilt) else None
    spacing = float(np.prod(edges_c) / count) ** (1 / d)
    box = {"low": snapshot.low_c, "high": snapshot.high_c, "periodic": periodic}
    return box | {"spacing": spacing, "tilt": tilt}


def data_file(path: Path) -> FileSnapshot:
    """Read a data file of an atom style of RHEO; its columns are those of `STYLES`, and vx, vy, vz if present.

    Raises
    ------
    InputError
        Not readable, or not such a file.
    """
    first, *lines = _text(path).splitlines() or [""]
    step = re.search(r"timestep = ([0-9]{1,18})\b", first)
    header, sections = _sections(lines)
    low_c, high_c, count = np.zeros(3), np.zeros(3), -1
    tilt: tuple[float, ...] = ()
    for line in header:
        name = next((name for name in (*_EDGES, _TILT, _COUNT) if line.endswith(f" {name}")), "")
        words = line.removesuffix(name).split()
        if name in _EDGES:
            low_c[_EDGES[name]], high_c[_EDGES[name]] = _floats(words, 2, name)
        elif name == _TILT:
            tilt = tuple(_floats(words, 3, name))
        elif name == _COUNT:
            count = int(words[0]) if len(words) == 1 and re.fullmatch("[0-9]{1,12}", words[0]) else -1
    style, rows = sections.get("Atoms", ("", []))
    if style not in STYLES:
        raise InputError("Atoms", f"must be of one of the styles {', '.join(STYLES)} (Atoms # STYLE)", style or "none")
    names = STYLES[style]
    table = _table(rows, "Atoms", len(names), len(names) + 3)
    if len(table) != count:
        raise InputError("Atoms", f"must hold the {count} atoms that the header says", len(table))
    columns = {name: table[:, k] for k, name in enumerate(names)}
    if "Velocities" in sections:
        moving = _table(sections["Velocities"][1], "Velocities", 4, 4)
        rank = {number: k for k, number in enumerate(moving[:, 0].tolist())}
        if len(rank) != count or any(number not in rank for number in columns["id"].tolist()):
            raise InputError("Velocities", "must hold those of the particles of Atoms, each once", len(rank))
        order_n = [rank[number] for number in columns["id"].tolist()]
        columns |= {name: moving[order_n, k] for k, name in enumerate(("vx", "vy", "vz"), 1)}
    return FileSnapshot(int(step[1]) if step else 0, low_c, high_c, (True, True, True), tilt, columns)


def snapshots(path: Path) -> Iterator[FileSnapshot]:
    """Read the snapshots of a dump (``dump custom``, text or binary, or packed by gzip), in the order of the file.

    Raises
    ------
    InputError
        Not readable, or not such a file.
    CutOff
        The file ends within a snapshot; raised after those before it.
    """
    content = _unpacked(path)
    if binary_dumps.is_binary(content):
        try:
            for shot in binary_dumps.snapshots(content):
                yield _made(*shot, exact=True)
        except binary_dumps.Short as short:
            raise CutOff("dump", WHOLE, str(short)) from None
        return
    text = _plain(content)
    *whole, rest = text.split("\n")  # LAMMPS ends every line: part of a line without an end may be missing
    lines = iter(line.removesuffix("\r") for line in whole)
    for line in lines:
        if line.split() != ["ITEM:", "TIMESTEP"]:
            if line.startswith(("ITEM: UNITS", "ITEM: TIME")):
                next(lines, "")
                continue
            raise InputError("dump", "must be one of text (ITEM: TIMESTEP ...)", line[:40])
        try:
            yield _snapshot(lines)
        except StopIteration:
            raise CutOff("dump", WHOLE, "a part of a header") from None
        except InputError:
            raise
        except (ValueError, IndexError, OverflowError) as error:
            raise InputError("dump", f"cannot be read ({error})") from None
    if rest:
        raise CutOff("dump", WHOLE, f"a line without an end: {rest[:40]}")


def _snapshot(lines: Iterator[str]) -> FileSnapshot:
    step = int(next(lines))
    while not (item := next(lines)).startswith("ITEM: NUMBER OF ATOMS"):
        next(lines)
    count = int(next(lines))
    item = next(lines)
    if not item.startswith("ITEM: BOX BOUNDS"):
        raise ValueError(f"{item[:40]} where BOX BOUNDS should be")
    words = item.split()[3:]
    bounds_c = np.array([[float(word) for word in next(lines).split()] for _ in range(3)])
    tilt = tuple(bounds_c[:, 2].tolist()) if words[:3] == ["xy", "xz", "yz"] else ()
    periodic = tuple(flags == "pp" for flags in words[-3:]) if len(words) >= 3 else (True,) * 3
    names = next(lines).split()[2:]
    rows = list(itertools.islice(lines, count))
    if len(rows) < count:
        raise CutOff("dump", WHOLE, f"{len(rows)} of {count} atoms of step {step}")
    return _made(step, bounds_c, tilt, periodic, names, _table(rows, "ATOMS", len(names), len(names)))


def _made(
    step: int,
    bounds_c: Array,
    tilt: tuple[float, ...],
    periodic: tuple[bool, ...],
    names: Sequence[str],
    table: Array,
    exact: bool = False,
) -> FileSnapshot:
    low_c, high_c = bounds_c[:, 0].copy(), bounds_c[:, 1].copy()
    if tilt:  # then the bounds are those of the upright box around the tilted one
        xy, xz, yz = tilt
        low_c[:2] -= min(0.0, xy, xz, xy + xz), min(0.0, yz)
        high_c[:2] -= max(0.0, xy, xz, xy + xz), max(0.0, yz)
    return FileSnapshot(step, low_c, high_c, periodic, tilt, {name: table[:, k] for k, name in enumerate(names)}, exact)


def arrays(snapshot: FileSnapshot, named: Mapping[str, str]) -> dict[str, Array]:
    """Return the arrays of a snapshot that a scene takes, by id: x, type and, if present, rho, energy, v, solid.

    Parameters
    ----------
    named : mapping
        Columns that hold rho and energy (of the whole particle) under other names.
    """
    number = snapshot.finite
    id_n = snapshot.numbers("id", int)
    order_n = np.argsort(id_n, kind="stable")
    if len(np.unique(id_n)) != len(id_n):
        raise InputError("id", "must differ from particle to particle")
    values = {"x": np.stack([number(axis) for axis in "xyz"], axis=1), "type": snapshot.numbers("type", int)}
    for name in ("rho", "energy"):
        if name in named or name in snapshot.columns:
            values[name] = number(named.get(name, name))
    if all(f"v{axis}" in snapshot.columns for axis in "xyz"):
        values["v"] = np.stack([number(f"v{axis}") for axis in "xyz"], axis=1)
    if "status" in snapshot.columns:
        values["solid"] = snapshot.numbers("status", int) & SOLID != 0
    return {name: values_n[order_n] for name, values_n in values.items()}


def _unpacked(path: Path) -> bytes:
    """Return the content of a dump, decompressed if needed."""
    content = _bytes(path)
    if content.startswith(GZIP):
        try:
            with gzip.open(io.BytesIO(content)) as unpacked:
                content = unpacked.read(LARGEST + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise InputError("dump", f"cannot be unpacked by gzip ({error})") from None
        if len(content) > LARGEST:
            raise InputError("dump", f"must have at most {LARGEST} bytes when it is unpacked")
    return content


def _plain(content: bytes) -> str:
    if other := next((name for start, name in OTHERS.items() if content.startswith(start)), ""):
        rule = f"must be of dump custom, not of {other}: OVITO converts it, or let the deck write dump custom as well"
        raise InputError("dump", rule)
    if b"\0" in content[:HEAD]:
        raise InputError("dump", "must be text, or a binary file of dump custom")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError("dump", "must be UTF-8 text") from None


def _bytes(path: Path) -> bytes:
    try:
        return read_bytes(path, "file", LARGEST)
    except InputError as error:
        raise InputError("file", error.rule, path.name) from None


def _text(path: Path) -> str:
    try:
        return read_text(path, "file", LARGEST)
    except InputError as error:
        raise InputError("file", error.rule, path.name) from None


def _sections(lines: Sequence[str]) -> tuple[list[str], dict[str, tuple[str, list[str]]]]:
    """Return the lines of the header, and style and lines of each section by its name."""
    header: list[str] = []
    sections: dict[str, tuple[str, list[str]]] = {}
    rows = header
    for line in lines:
        if title := _SECTION.fullmatch(line):
            rows = []
            sections[title[1]] = title[2] or "", rows
        elif line.partition("#")[0].strip():
            rows.append(line.partition("#")[0].strip())
    return header, sections


def _table(rows: Sequence[str], section: str, *widths: int) -> Array:
    """Return rows as text, all with one of the given numbers of columns."""
    cells = [row.split() for row in rows]
    width = len(cells[0]) if cells else widths[0]
    for row in cells:
        if len(row) != width or width not in widths:
            words = " or ".join(map(str, sorted(set(widths))))
            raise InputError(section, f"must hold {words} columns on every line", " ".join(row)[:60])
    for line in rows:
        if not line.isascii():
            raise InputError(section, "must be ASCII except in comments", line[:60])
    return np.array(cells, dtype=bytes).reshape(len(cells), width)


def _is_number(word: Any, kind: type) -> bool:
    try:
        np.array(word).astype(kind)
    except (ValueError, OverflowError):
        return False
    return True


def _floats(words: Sequence[str], count: int, name: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count:
        raise InputError(name, f"must follow {count} number{'s' * (count > 1)}", " ".join(words))
    return values
