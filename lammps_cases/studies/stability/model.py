"""Parts of a stability map: cells, how they end, the boundaries between different endings; an atlas on disk.

Its files are ``atlas.json``, ``cells.csv``, ``cells.jsonl``, and the particles before each failure in ``states``.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self, get_args

from eos_ref import InputError
from lammps_cases.records.documents import SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text, read_arrays, write_arrays, write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.studies.flows.flow import Start

Engine = Literal["reference", "lammps"]
ENGINES: tuple[Engine, ...] = get_args(Engine)
# How a run ends, from sound to worst; `stable` is not a failure.
Kind = Literal[
    "stable",
    "lost digits",  # fewer correct digits of the pressure than a map requires
    "misclassified surface",  # a surface particle classified as bulk, or bulk as surface
    "ill-conditioned matrix",  # moment matrix with a condition number that leaves fewer than four digits
    "failed matrix",  # no Cholesky factor
    "loss of hyperbolicity",  # dP/drho <= 0
    "negative pressure",  # a tension that the law should not give (only where a map watches for it)
    "clumping",  # particles much closer than at the start: tensile or pairing instability
    "overlap",  # particles on top of each other
    "energy growth",  # kinetic energy beyond what the scene can supply
    "wall penetration",  # fluid behind the face of a wall
    "vanishing density",  # at most a hundredth of rho0
    "negative density",
    "overflow",  # an infinite pressure or density
    "non-finite",  # NaN
    "lost particles",
    "error",  # LAMMPS' own error, or the reference's refusal, with its text
    "crash",
    "hang",
]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Axis:
    """A parameter from ``low`` to ``high``, resolved to ``width`` (of its logarithm to base 10 if ``log``)."""

    name: str
    low: float
    high: float
    width: float
    log: bool = False

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value, in the units of the width."""
        return math.log10(value) if self.log else value

    def middle(self, low: float, high: float) -> float:
        """Return the value halfway between two others."""
        return math.sqrt(low) * math.sqrt(high) if self.log else (low + high) / 2


@dataclass(frozen=True)
class MapCell:
    """A place on a map: the values of its axes, and which layer (a variant of the scene, as ``with shift``)."""

    map: str
    x: float
    y: float
    layer: str = ""

    @classmethod
    def parse(cls, name: str) -> Self:
        """Return the cell of a name.

        Raises
        ------
        InputError
        """
        # A layer may hold colons; the others may not.
        of, _, rest = name.partition(":")
        layer, *numbers = rest.rsplit(":", 2)
        try:
            x, y = (float(number) for number in numbers)
        except ValueError:
            raise InputError("cell", "must be MAP:LAYER:X:Y with two numbers", name) from None
        return cls(of, x, y, layer)

    @property
    def name(self) -> str:
        """``MAP:LAYER:X:Y``, with numbers that read back as the same doubles."""
        return f"{self.map}:{self.layer}:{float(self.x)!r}:{float(self.y)!r}"

    @property
    def command(self) -> str:
        """Command that runs the cell again."""
        return f"eos-ref stability --cell {shlex.quote(self.name)}"

    @property
    def anchor(self) -> str:
        """Unique name of the cell for addresses and files."""
        return re.sub(r"[^A-Za-z0-9.+-]", lambda m: "__" if m[0] == ":" else f"_{ord(m[0]):x}_", self.name)


@dataclass(frozen=True)
class FailureCriteria:
    """Failures that a run is watched for, in addition to NaN, lost particles, errors, crashes and hangs.

    Attributes
    ----------
    every : steps between two observations; a failure is then located to the step by running the stretch again
    growth : kinetic energy over ``energy`` beyond which it has grown; None: not watched
    energy : kinetic energy that the scene can supply (energy); None: the largest of the first observation and the start
    closest : distance over the spacing below which two particles clump; None: not watched
    hyperbolic : whether a density at which dP/drho <= 0 is a failure
    pressure : whether a negative pressure is a failure
    behind : types of solids and the outward coordinate: ``(axis, value)`` that no fluid particle may pass below
    surface : expected class of ids (0 bulk, 1 surface, 2 splash)
    condition : condition number of a moment matrix beyond which it is ill-conditioned; None: not watched
    digits : decimal digits of the pressure that must be right, by a rigorous value of the law; None: not watched
    """

    every: int = 10
    growth: float | None = None
    energy: float | None = None
    closest: float | None = None
    hyperbolic: bool = False
    pressure: bool = False
    behind: tuple[int, float] | None = None
    surface: Mapping[int, int] = field(default_factory=dict)
    condition: float | None = None
    digits: float | None = None


@dataclass(frozen=True)
class CellOutcome:
    """The outcome of one engine in a cell.

    Attributes
    ----------
    step, atom, value : where the failure was first seen (step, id), and the number that shows it
    message : text of the engine
    seconds : wall time
    steps : number of steps requested
    """

    kind: Kind
    step: int | None = None
    atom: int | None = None
    value: float | None = None
    message: str = ""
    seconds: float = 0.0
    steps: int = 0


@dataclass(frozen=True)
class CellRun:
    """A cell that was run on an engine."""

    cell: MapCell
    engine: Engine
    outcome: CellOutcome


@dataclass(frozen=True)
class MapLine:
    """A line of a map on an engine: all x at one y."""

    map: str
    layer: str
    y: float
    engine: Engine

    def cell(self, x: float) -> MapCell:
        """Return a cell of the line."""
        return MapCell(self.map, x, self.y, self.layer)


@dataclass(frozen=True)
class Boundary(MapLine):
    """A change of kind along a line, between ``low`` and ``high``."""

    low: float
    high: float
    below: Kind
    above: Kind


@dataclass(frozen=True)
class Agreement:
    """Verdict on a line that both engines ran: ``same`` kinds in the same order, within the boundaries' uncertainty.

    ``reference`` and ``lammps`` are the kinds along x, ``boundaries`` the changes between them, reference first.
    """

    map: str
    layer: str
    y: float
    verdict: Literal["same", "differs"]
    reference: tuple[Kind, ...]
    lammps: tuple[Kind, ...]
    boundaries: tuple[tuple[Boundary, ...], tuple[Boundary, ...]]


@dataclass(frozen=True)
class Theory:
    """A theoretical limit: x as a function of y, drawn over one layer of a map (None: over all)."""

    name: str
    x_of_y: Callable[[float], float]
    layer: str | None = None


@dataclass(frozen=True)
class StabilityMap:
    """A map of how runs end.

    Attributes
    ----------
    lines : values of y on which boundaries are bisected along x
    start, watch : initial state of a cell, and the failures to watch for
    coarse : number of places along x that are run first; bisection follows between neighbours of different kind
    tags : ``quick`` maps make the one-minute atlas, ``long`` ones run only by name or tag
    quick_lines : lines of the quick atlas; none: the first and the last
    engines_differ : why the engines differ although no statement of the manual is broken
    """

    id: str
    title: str
    about: str
    x: Axis
    y: Axis
    lines: tuple[float, ...]
    start: Callable[[MapCell], Start]
    watch: Callable[[MapCell], FailureCriteria] = lambda cell: FailureCriteria()
    layers: tuple[str, ...] = ("",)
    coarse: int = 4
    theory: tuple[Theory, ...] = ()
    tags: tuple[str, ...] = ()
    quick_lines: tuple[float, ...] = ()
    engines_differ: str = ""

    def lines_run(self, quick: bool) -> tuple[float, ...]:
        """Return the values of y that are run, in the quick atlas or in the whole one."""
        if not quick:
            return self.lines
        return tuple(dict.fromkeys(self.quick_lines or (self.lines[0], self.lines[-1])))


@dataclass(frozen=True)
class MapRecord:
    """A map after its run: its cells with their wall time (s), boundaries, and the engines' agreement."""

    id: str
    title: str
    about: str
    x: Axis
    y: Axis
    layers: tuple[str, ...]
    lines: tuple[float, ...]
    seconds: float
    cells: tuple[CellRun, ...]
    boundaries: tuple[Boundary, ...]
    agreement: tuple[Agreement, ...]


@dataclass(frozen=True)
class Atlas(Study):
    """All measurements."""

    maps: tuple[MapRecord, ...]
    schema: str = SCHEMAS["stability"]

    @property
    def disagreements(self) -> list[Agreement]:
        """Lines on which the engines differ."""
        return [a for m in self.maps for a in m.agreement if a.verdict == "differs"]


DOCUMENT = Document("stability", Atlas)


def write(atlas: Atlas, folder: Path) -> None:
    """Write ``atlas.json`` and ``cells.csv``."""
    write_atomically(folder / "cells.csv", csv_text(_rows(atlas)))
    DOCUMENT.write(folder / "atlas.json", atlas)


def document(atlas: Atlas) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    return {
        "maps": [
            {key: of[key] for key in ("id", "cells", "boundaries")}
            | {"disagreements": [line for line in of["agreement"] if line["verdict"] == "differs"]}
            for of in DOCUMENT.plain(atlas)["maps"]
        ]
    }


def cells(folder: Path) -> Parts[CellRun]:
    """Return the journal ``cells.jsonl`` of finished cells."""
    return Parts(folder / "cells.jsonl", CellRun)


# --- particles before a failure


def state_file(folder: Path, cell: MapCell, engine: Engine) -> Path:
    """Return the file of the particles before a failure."""
    return folder / "states" / f"{cell.anchor}--{engine}.npz"


def write_state(folder: Path, cell: MapCell, engine: Engine, before: dict[str, Any] | None) -> None:
    """Keep the particles before a failure; without a failure, remove an older file of the cell."""
    file = state_file(folder, cell, engine)
    if before is None:
        file.unlink(missing_ok=True)
    else:
        write_arrays(file, before)


def read_state(folder: Path, cell: MapCell, engine: Engine) -> dict[str, Any] | None:
    """Return the arrays of `Examined.before`; None for a run without failure."""
    file = state_file(folder, cell, engine)
    if not file.exists():
        return None
    return dict(read_arrays(file))


# --- tables


def _rows(atlas: Atlas) -> Iterable[Sequence[Any]]:
    yield ("map", "layer", "x", "y", "engine", "kind", "step", "atom", "value", "steps", "seconds", "message")
    for run in (run for of in atlas.maps for run in of.cells):
        cell, o = run.cell, run.outcome
        yield (
            *(cell.map, cell.layer, cell.x, cell.y, run.engine, o.kind),
            *(o.step, o.atom, o.value, o.steps, round(o.seconds, 4), o.message),  # CSV leaves None empty
        )
