r"""What a flow with a closed solution is: a start, what is measured of it, and the order that theory expects.

All flows take particles at spacing 1 with mass rho0, so that volumes are 1; the box grows with the resolution N
(particles per wavelength, height or diameter). Viscosity and time grow with N as well: Reynolds and Mach numbers stay,
what changes is the spacing in units of the flow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KernelStyle
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
    """Fields at one time, by id; the energy is that of the whole particle, the temperature energy/(m cv)."""

    time: float
    x_nc: FloatArray
    v_nc: FloatArray
    rho_n: FloatArray
    energy_n: FloatArray | None
    pressure_n: FloatArray
    temperature_n: FloatArray | None


@dataclass(frozen=True)
class Flow:
    """A flow with a closed solution.

    Attributes
    ----------
    name, about : what it is, and its further options
    solution : where the closed solution comes from
    resolutions : particles per wavelength, height or diameter; at least three
    expected : the order that theory expects, and why
    start : particles and scene of a resolution
    measures : relative errors of snapshots by name, the headline first
    options : those that show the convergence
    quick : resolutions that are cheap, where the others are not
    """

    name: str
    about: str
    solution: str
    resolutions: tuple[int, ...]
    expected: str
    start: Callable[[int, Options], Start]
    measures: Callable[[int, Options, Sequence[Snapshot]], dict[str, float]]
    options: Options = Options()
    quick: tuple[int, ...] = ()
