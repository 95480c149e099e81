"""Every reader of untrusted files, with valid content, for fuzzing."""

from __future__ import annotations

import io
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from eos_ref import InputError, parse_fix_rheo, parse_fix_rheo_pressure
from lammps_cases.audit import place, supervise
from lammps_cases.records.files import read_arrays
from lammps_cases.records.run_record import read_run
from lammps_cases.report.history.store import History
from lammps_cases.run.shards import part_of
from lammps_cases.scene import casefile
from lammps_cases.scene.ase_io import _read_with_ase
from lammps_cases.scene.atoms import _column, build
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.lammps_files import arrays, data_file, snapshots
from lammps_cases.scene.particles import ValueTable
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.versions import baseline
from tests.support import made_runs

ROOT = Path(__file__).parents[2]
LONGEST_COMPLAINT = 900  # characters of a line: the three parts and the place, each of which is limited
MOST_LINES = 51
SCENE = b"""name: made
about: small
tags: [quick]
matrix:
  law: {one: {}, two: {"pressure": [{types: 1, style: cubic, A3: 2.5}, {types: 2, style: linear}]}}
scene:
  dimension: 2
  types: [{mass: 1.3, rho0: 1.2, cs: 3.1}, {mass: 1.0, rho0: 1.0, cs: 3.0}]
  positions: {lattice: sq, spacing: 0.8, cells: [4, 4], disorder: 0.2}
  pressure: [{types: "*", style: tait/general, gamma: 2.3}]
  rho: {ratio: [0.8, 1.3]}
  velocity: {random: 0.1}
"""
FIX = b"fix 1 all rheo 3.0 quintic 0 thermal shift rho/sum self/mass density 1.0 1.0 1.0 speed/sound 10.0 10.0 10.0"
PRESSURE = b"fix 2 all rheo/pressure 1 tait/general 2.3 2*3 cubic 2.5"
DECK = b"""variable i loop 3
label a
if "$i > 1" then "include a.inc" else 'print x file y'
run 10 every 5 "print 'x'"
fix 3 all rheo/pressure * linear # comment &
  next
jump SELF a
"""
DATA = b"""LAMMPS data file, timestep = 7

2 atoms
2 atom types

0 4 xlo xhi
0 4 ylo yhi
-0.5 0.5 zlo zhi

Atoms # rheo

2 1 0 1.5 1.0 1.0 0.0 0 0 0
1 2 1 1.25 2.0 2.0 0.0 0 0 0

Velocities

1 0 0 0
2 0.5 0 0
"""
DUMP = b"""ITEM: TIMESTEP
5
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS pp pp pp
0 4
0 4
-0.5 0.5
ITEM: ATOMS id type x y z rho
2 1 1.0 1.0 0.0 1.5
1 2 2.0 2.0 0.0 1.25
"""
BINARY_DUMP = struct.pack(
    "<q10s2i2qi6i6d2i?i14s2i10d", -10, b"DUMPCUSTOM", 1, 2, 5, 2, 0, *[0] * 6, 0, 4, 0, 4, -0.5, 0.5, 5, 0, False,
    14, b"id type x y z ", 1, 10, *(2, 1, 1.0, 1.0, 0.0, 1, 2, 2.0, 2.0, 0.0),
)  # fmt: skip
XYZ = b"""2
Lattice="2 0 0 0 2 0 0 0 2" Properties=species:S:1:pos:R:3:type:I:1:rho:R:1 pbc="T T T"
X 0.1 0.2 0.3 1 1.0
X 0.5 0.6 0.7 1 1.1
"""
LINES = b"\t".join(column.encode() for column in baseline.COLUMNS) + b"\none\t(case)\tanswered\tpass\t-\t-\t-\t-\n"
LINES += b"one\tpressure\teos\tpass\t-\t0.5\t00\t0:pass:00\n"


@dataclass(frozen=True)
class Reader:
    """A function that reads a file, the file's name, and valid contents."""

    read: Callable[[Path], Any]
    name: str
    seeds: tuple[bytes, ...]


def _scenes(path: Path) -> None:
    """Read a case file, and make the inputs of either side from its scenes, if small."""
    for case in casefile.load_file(path)[:2]:
        made(case)


def made(case: Case) -> Any:
    """The job of a scene."""
    scene = case.scene
    eos = scene.eos(case.where) if scene.expect is None else None
    if np.prod(getattr(scene.positions, "cells", (1,))) < 1000:
        return job(scene, build(case, eos), plan(scene))
    return None


def _history(path: Path) -> None:
    with History(path) as history:
        history.runs()
        history.cases()


def _fix(path: Path) -> None:
    parse_fix_rheo(path.read_bytes().decode("latin-1"), 3)


def _pressure(path: Path) -> None:
    parse_fix_rheo_pressure(path.read_bytes().decode("latin-1"))


def _shard(path: Path) -> None:
    part_of([], path.read_bytes().decode("latin-1"))


def _dump(path: Path) -> None:
    for snapshot in snapshots(path):
        arrays(snapshot, {})


def _csv(path: Path) -> None:
    _column(path.parent, ValueTable(csv=path.name, column="b"), "rho")


def _xyz(path: Path) -> None:
    _read_with_ase(path.read_bytes(), path)


def _message(path: Path) -> None:
    class Connection:
        def recv_bytes(self, most: int) -> bytes:
            return path.read_bytes()

    try:
        supervise.received(Connection())
    except (supervise.Foreign, EOFError) as error:
        raise InputError("message", str(error)) from None


def _arrays(compressed: bool) -> bytes:
    content = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(content, a=np.arange(6.0).reshape(2, 3), b=np.array(3))
    return content.getvalue()


def _database() -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "h.sqlite"
        with History(path) as history:
            history.add(made_runs.run())
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("VACUUM")
        return path.read_bytes()


def readers() -> dict[str, Reader]:
    """Return all of them by name."""
    run = made_runs.run().to_json().encode()
    alone = (path for path in casefile.SHIPPED.glob("*.yaml") if b"extxyz" not in path.read_bytes())
    shipped = tuple(path.read_bytes() for path in sorted(alone, key=_size)[:8])
    return {
        "case file": Reader(_scenes, "case.yaml", (SCENE, *shipped)),
        "fix rheo": Reader(_fix, "line", (FIX,)),
        "fix rheo/pressure": Reader(_pressure, "line", (PRESSURE,)),
        "shard": Reader(_shard, "shard", (b"1/2",)),
        "deck": Reader(place.check_script, "in.deck", (DECK,)),
        "run.json": Reader(lambda path: read_run(path.parent), "run.json", (run,)),
        "npz": Reader(read_arrays, "a.npz", (_arrays(False), _arrays(True))),
        "baseline": Reader(baseline._cases, "verdicts.tsv", (LINES,)),
        "history": Reader(_history, "h.sqlite", (_database(),)),
        "data file": Reader(lambda path: arrays(data_file(path), {}), "a.data", (DATA,)),
        "dump": Reader(_dump, "a.dump", (DUMP, BINARY_DUMP)),
        "extxyz": Reader(_xyz, "a.extxyz", (XYZ,)),
        "csv": Reader(_csv, "a.csv", (b"a,b\n1,2\n3,4\n",)),
        "message": Reader(_message, "message", (b"\x80\x04]\x94.",)),
    }


def _size(path: Path) -> tuple[int, str]:
    return path.stat().st_size, path.name


def outcome(reader: Reader, content: bytes, folder: Path) -> str:
    """Read content as a file; return the complaint, or "". Any exception but `InputError` is raised.

    Raises
    ------
    AssertionError
        The complaint has several lines or is too long.
    """
    path = folder / reader.name
    path.write_bytes(content)
    try:
        reader.read(path)
    except InputError as error:
        told = str(error)
        lines = told.split("\n")
        assert told.strip() and len(lines) <= MOST_LINES, f"{len(lines)} lines"
        assert max(map(len, lines)) <= LONGEST_COMPLAINT, max(lines, key=len)
        return told
    return ""


def leaves(content: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the places of all nested values, from the outside in."""
    yield at
    inner = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in inner:
        yield from leaves(value, (*at, key))
