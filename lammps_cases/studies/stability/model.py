"""What a stability map is made of: cells that are run, what came of them, and the boundaries between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from lammps_cases.studies.flows.flow import Start

Engine = Literal["reference", "lammps"]
ENGINES: tuple[Engine, ...] = get_args(Engine)
# How a run ends, from sound to worst; `stable` is no failure.
Kind = Literal[
    "stable",
    "lost digits",  # fewer correct digits of the pressure than a map asks for
    "misclassified surface",  # a surface particle taken for bulk, or bulk for surface
    "ill-conditioned matrix",  # moment matrix with a condition number that leaves fewer than four digits
    "failed matrix",  # no Cholesky factor
    "loss of hyperbolicity",  # dP/drho <= 0
    "negative pressure",  # a tension that the law should not give (only where a map watches for it)
    "clumping",  # particles much closer than they began: tensile or pairing instability
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
    """A parameter: from ``low`` to ``high``, resolved to ``width`` (of its logarithm to base 10 if ``log``)."""

    name: str
    low: float
    high: float
    width: float
    log: bool = False


@dataclass(frozen=True)
class MapCell:
    """A place on a map: the values of its axes, and which layer (a variant of the scene, as ``with shift``)."""

    map: str
    x: float
    y: float
    layer: str = ""


@dataclass(frozen=True)
class FailureCriteria:
    """What a run is watched for, beside what is always: numbers that are none, lost particles, errors, crashes, hangs.

    Attributes
    ----------
    every : steps between two looks; a failure is then located to the step by running the stretch again
    growth : kinetic energy over ``energy`` beyond which it has grown; None: not watched
    energy : kinetic energy that the scene can supply (energy); None: the largest of the first look and the start
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
    """How one engine ended in a cell.

    ``step``, ``atom`` (id) and ``value`` say where and with which number the failure was first seen, ``message`` what
    an engine said; ``seconds`` the wall time. ``steps`` is the number of steps asked for.
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
class Boundary:
    """Where the kind changes along x, on one line of a map: between ``low`` and ``high``."""

    map: str
    layer: str
    y: float
    engine: Engine
    low: float
    high: float
    below: Kind
    above: Kind


@dataclass(frozen=True)
class Theory:
    """A limit that theory gives: x as a function of y, to be drawn over a map of one layer (None: of all)."""

    name: str
    x_of_y: Callable[[float], float]
    layer: str | None = None


@dataclass(frozen=True)
class StabilityMap:
    """A map: cells are made by ``start`` and watched by ``watch``.

    Attributes
    ----------
    lines : values of y on which boundaries are bisected along x
    coarse : number of places along x that are run first; between neighbours of different kind bisection follows
    tags : ``quick`` maps make the one-minute atlas, ``long`` ones run only by name or tag
    quick_lines : the lines of the quick atlas; none: the first and the last
    reference_only : layers that LAMMPS has nothing of, as numbers of another precision
    engines_differ : why the engines differ here although no statement of the manual is broken
    """

    id: str
    title: str
    about: str
    x: Axis
    y: Axis
    lines: tuple[float, ...]
    start: Callable[[MapCell], Start]
    watch: Callable[[MapCell], FailureCriteria]
    layers: tuple[str, ...] = ("",)
    coarse: int = 4
    theory: tuple[Theory, ...] = ()
    tags: tuple[str, ...] = ()
    quick_lines: tuple[float, ...] = ()
    reference_only: tuple[str, ...] = ()
    engines_differ: str = ""

    def engines(self, layer: str) -> tuple[Engine, ...]:
        """Return the engines that a layer can be run on."""
        return ("reference",) if layer in self.reference_only else ENGINES
