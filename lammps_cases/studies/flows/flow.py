r"""What a flow with a closed solution is: a start, what is measured of it, and the order that theory expects.

All flows take particles at spacing 1 with mass rho0, so that volumes are 1; the box grows with the resolution N
(particles per wavelength, height or diameter). Viscosity and time grow with N as well: Reynolds and Mach numbers stay,
what changes is the spacing in units of the flow.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KernelStyle
from lammps_cases.findings.entry import Finding
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case


@dataclass(frozen=True)
class Options:
    """How a flow is solved.

    Attributes
    ----------
    kernel, zmin, rho_sum : arguments of fix rheo
    cut : cutoff of the kernel (spacings)
    dt_fraction : time step over the flow's own limit of stability, `lammps_cases.studies.flows.layout.time_step`
    extra : further options, which each flow names in ``about``
    """

    kernel: KernelStyle = "quintic"
    cut: float = 3.0
    rho_sum: bool = False
    dt_fraction: float = 1.0
    zmin: int = 0
    extra: Mapping[str, float | str] = field(default_factory=dict)

    def number(self, name: str, default: float) -> float:
        """Return a further option that is a number.

        Raises
        ------
        InputError
        """
        value = self.extra.get(name, default)
        if isinstance(value, str):
            raise InputError(f"option {name}", "must be a number", value)
        return float(value)

    def word(self, name: str, default: str) -> str:
        """Return a further option that is a word."""
        return str(self.extra.get(name, default))


@dataclass(frozen=True)
class Body:
    """A force on every fluid particle that depends on where it is, or on its temperature.

    Attributes
    ----------
    formulas : its components for LAMMPS, as formulas of atom-style variables; the temperature is c_warm
    force : the same for the reference, (n, d), of masses (n,), positions (n, d) and temperatures (n,), if there are any
    warm : whether it depends on the temperature
    """

    formulas: tuple[str, str]
    force: Callable[[FloatArray, FloatArray, FloatArray | None], FloatArray]
    warm: bool = False


@dataclass(frozen=True)
class Start:
    """A flow at time 0: the scene, its particles, the steps at which fields are read, the length of a step."""

    case: Case
    atoms: Atoms
    steps: tuple[int, ...]
    timestep: float
    body: Body | None = None


@dataclass(frozen=True)
class Snapshot:
    """Particles after a step, by id.

    Attributes
    ----------
    x_nc, v_nc : (n, d)
        Positions in any periodic image, velocities.
    rho_n, pressure_n : (n,)
    energy_n, temperature_n : (n,), optional
        Energy of the whole particle, and the same over m cv.
    surface_n : (n,), optional
        Class of the field ``surface``: 0 bulk, 1 surface, 2 splash.
    """

    step: int
    x_nc: FloatArray
    v_nc: FloatArray
    rho_n: FloatArray
    pressure_n: FloatArray
    energy_n: FloatArray | None = None
    surface_n: FloatArray | None = None
    time: float = 0.0
    temperature_n: FloatArray | None = None


def relative(error_n: FloatArray, scale_n: FloatArray) -> float:
    """Return the root mean square of an error over that of its scale."""
    return float(np.sqrt(np.mean(np.square(error_n)) / np.mean(np.square(scale_n))))


# --- what others know

DATA = Path(__file__).parent / "data"
Curve = tuple[tuple[float, ...], tuple[float, ...]]  # x, y
Read = Callable[[int, Options, Sequence[Snapshot]], Curve]
Measures = Callable[[int, Options, Sequence[Snapshot]], dict[str, float]]


@dataclass(frozen=True)
class ReferenceCurve:
    """What others know of a curve: points of an experiment or a table, drawn as marks, or a solution, as a line."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    source: str
    scatter: str = ""
    marks: bool = True

    def misfit(self, curve: Curve) -> float:
        """Return the root mean square of what a curve misses it by, over its own: where points are known, or run."""
        x, y = curve
        if self.marks:
            return relative(np.interp(self.x, x, y) - np.array(self.y), np.array(self.y))
        given = np.interp(x, self.x, self.y)
        return relative(np.array(y) - given, given)


def table(name: str, label: str) -> ReferenceCurve:
    """Return the points of ``data/NAME.csv``: lines ``# source`` and ``# scatter``, a header, x and y."""
    lines = (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    about = dict(line.removeprefix("# ").split(": ", 1) for line in lines if line.startswith("# "))
    _, *points = csv.reader(line for line in lines if not line.startswith("#"))
    x, y = zip(*((float(a), float(b)) for a, b in points), strict=True)
    return ReferenceCurve(label, x, y, about["source"], about["scatter"])


def line(label: str, x: FloatArray, y: FloatArray, source: str) -> ReferenceCurve:
    """Return a solution, drawn as a line."""
    return ReferenceCurve(label, tuple(x.tolist()), tuple(y.tolist()), source, marks=False)


def curve(x: FloatArray, y: FloatArray) -> Curve:
    """Return points in the order of x."""
    order = np.argsort(x, kind="stable")
    return tuple(np.asarray(x)[order].tolist()), tuple(np.asarray(y)[order].tolist())


@dataclass(frozen=True)
class FlowPanel:
    """A picture of a flow: what others know, the first of them what errors are taken against, and how a run is read."""

    name: str
    x: str
    y: str
    known: tuple[ReferenceCurve, ...]
    read: Read


@dataclass(frozen=True)
class FlowQuantity:
    """A number that a user reads off the flow.

    Attributes
    ----------
    published : what it should be, None: nobody knows
    absent : what is said where a run has no such number
    """

    name: str
    read: Callable[[int, Options, Sequence[Snapshot]], float]
    published: float | None = None
    source: str = ""
    absent: str = "no number"


def misfits(panels: Sequence[FlowPanel]) -> Measures:
    """Return the measures of a flow that is held against the first known curve of each panel."""

    def measures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
        return {panel.name: panel.known[0].misfit(panel.read(n, options, snapshots)) for panel in panels}

    return measures


@dataclass(frozen=True)
class Flow:
    """A flow of which others know something: a closed solution, an experiment, a table.

    Attributes
    ----------
    name, about : what it is, and its further options
    solution : where what is known comes from
    resolutions : particles per wavelength, height or diameter; at least three
    expected : the order that theory expects, and why
    start : particles and scene of a resolution
    measures : relative errors of snapshots by name, the headline first
    options : those that show the convergence
    quick : resolutions that are cheap, where the others are not
    title : of its section in a validation
    panels, quantities : what a validation compares
    findings : those of LAMMPS that change it, each tried alone on the reference
    left_out : what a validation does not compare, and why
    """

    name: str
    about: str
    solution: str
    resolutions: tuple[int, ...]
    expected: str
    start: Callable[[int, Options], Start]
    measures: Measures
    options: Options = Options()
    quick: tuple[int, ...] = ()
    title: str = ""
    panels: tuple[FlowPanel, ...] = ()
    quantities: tuple[FlowQuantity, ...] = ()
    findings: tuple[Finding, ...] = ()
    left_out: str = ""
