"""The quantities of the particle model, one record each, and what a force evaluation of some of them needs.

A quantity is named as LAMMPS' output of it is (``grad/v``), or in words without one (``kernel``). `required`
orders what some fields need; `eos_ref.evaluation.time_step` evaluates just that, in that order. A new quantity takes a
record here, its formula, and the line of the evaluation that calls it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from eos_ref.errors import InputError
from eos_ref.model.parameters import Model
from eos_ref.model.state import Gradients, State, Surface
from eos_ref.model.units import KIND_OF, Kind
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array

Keyword = Literal["interface/reconstruct", "shift", "surface/detection", "thermal"]


class Dimension(NamedTuple):
    """Powers of length, mass and time, and of the volume of a particle: length^2 in 2D, length^3 in 3D.

    Temperature has a unit of its own. Densities, pressures and stresses are per area in 2D.
    """

    length: int = 0
    mass: int = 0
    time: int = 0
    volume: int = 0


NUMBER, LENGTH, VELOCITY, RATE = Dimension(), Dimension(1), Dimension(1, 0, -1), Dimension(0, 0, -1)
DENSITY, PRESSURE, VISCOSITY = Dimension(0, 1, 0, -1), Dimension(2, 1, -2, -1), Dimension(2, 1, -1, -1)
FORCE, ENERGY, POWER = Dimension(1, 1, -2), Dimension(2, 1, -2), Dimension(2, 1, -3)
# Power = 2 kappa V_i V_j (T_i - T_j) (x.grad W)/r^2, with V a volume and x.grad W / r^2 of 1/(volume length^2).
CONDUCTIVITY = Dimension(4, 1, -3, -1)


class Evaluation(Protocol):
    """What quantities are read from; see `eos_ref.evaluation.time_step.Simulation`."""

    model: Model
    state: State
    evaluator: Any
    gradient: Gradients
    surface: Surface

    def stress(self, total: bool) -> Array:
        """Return the viscous or total stress of every particle."""

    def status(self) -> Array:
        """Return the status word of every particle."""

    def pressure_of_all(self) -> Array:
        """Return the pressure tensor of the virial of all particles."""

    def press(self) -> Array:
        """Return the pressure of all particles, with the kinetic part."""


@dataclass(frozen=True)
class Quantity:
    """A quantity that every particle has.

    Attributes
    ----------
    name : as LAMMPS names it
    about : what it is, in the plural
    dimension : powers of the units
    rank : 0 scalar, 1 vector, 2 tensor
    inputs : quantities that it is computed from, of all models or of a given one; None: no stage of an evaluation
    reads : quantities that it depends on, of all models or of a given one, where these are not its inputs
    part_of : the quantity that it is evaluated with
    keyword : of fix rheo, without which a model does not have it; parts have that of the whole
    discrete : whether it is a count or a class
    integrated : whether time steps change it
    completed_by : another quantity, with which it is finished where the model has that: densities of walls with chi
    result : where an evaluation leaves it, if not in its fields
    output : how it follows from the state when it is read; by default it is that of the last evaluation
    """

    name: str
    about: str
    dimension: Dimension = NUMBER
    rank: int = 0
    inputs: tuple[str, ...] | Callable[[Model], tuple[str, ...]] | None = None
    reads: Callable[[Model], tuple[str, ...]] | None = None
    part_of: str = ""
    keyword: Keyword | None = None
    discrete: bool = False
    integrated: bool = False
    completed_by: str = ""
    result: Callable[[Evaluation], Array] | None = None
    output: Callable[[Evaluation], Array] | None = None

    @property
    def whole(self) -> str:
        """Return the quantity of an evaluation that gives it."""
        return self.part_of or self.name

    def needs(self, model: Model) -> tuple[str, ...]:
        """Return the quantities that it is computed from in a model."""
        return self.inputs(model) if callable(self.inputs) else self.inputs or ()


def _density(model: Model) -> tuple[str, ...]:
    return ("rho", "chi") if model.fix.interface_reconstruct else ("rho",)


def _gradient(model: Model) -> tuple[str, ...]:
    return ("correction" if model.corrects_gradients else "kernel", *_density(model))


def _surface(model: Model) -> tuple[str, ...]:
    return ("pairs", "coordination", "kernel", *_density(model))


def _shift(model: Model) -> tuple[str, ...]:
    return ("kernel", *_density(model), *(["surface"] if model.fix.surface_detection else []))


def _pressure(model: Model) -> tuple[str, ...]:
    return (*_density(model), *(["energy"] if model.eos.needs_energy else []))


def _pair_terms(model: Model) -> tuple[str, ...]:
    # One pass over the pairs gives force, density diffusion and heat flow; all terms of the model are in it.
    return (
        *_gradient(model),
        *(["grad/v"] if model.pair.artificial_viscosity else []),
        *(["grad/rho"] if model.pair.rho_damp and model.corrects_gradients else []),
        *(["temperature"] if model.fix.thermal else []),
    )


def _with_velocities(inputs: Callable[[Model], tuple[str, ...]]) -> Callable[[Model], tuple[str, ...]]:
    """Return what a sum over the velocities of neighbours depends on."""
    return lambda model: (*inputs(model), "v")


def _diffusion(model: Model) -> tuple[str, ...]:
    return (*_gradient(model), *(["grad/rho"] if model.pair.rho_damp and model.corrects_gradients else []))


def _force(model: Model) -> tuple[str, ...]:
    artificial = ["grad/v"] if model.pair.artificial_viscosity else []
    return (*_gradient(model), *artificial, "pressure", "viscosity", "v")


def _viscosity(model: Model) -> tuple[str, ...]:
    return ("grad/v",) if any(law.style == "power" for law in model.viscosity) else ()


def _thermal(name: str) -> Callable[[Evaluation], Array]:
    """Return a parameter of rheo/thermal, of the type of every particle."""
    return lambda e: np.array([getattr(p, name) for p in e.model.thermal or ()])[e.state.type_n - 1]


# In the order of a force evaluation; then what a state holds.
QUANTITIES: dict[str, Quantity] = {
    q.name: q
    for q in (
        Quantity("pairs", "pairs", inputs=()),
        Quantity("coordination", "coordination numbers", inputs=("pairs",), discrete=True),
        Quantity("kernel", "kernel values", Dimension(volume=-1), inputs=("pairs",)),
        Quantity(
            "rho",
            "densities",
            DENSITY,
            inputs=lambda model: ("kernel",) if model.fix.rho_sum else (),
            completed_by="chi",
            integrated=True,
            output=lambda e: e.state.rho_n,
        ),
        Quantity("correction", "matrices of reproducing kernels", inputs=("kernel", "coordination", "rho")),
        Quantity("chi", "same-phase fractions", inputs=("kernel", "rho"), keyword="interface/reconstruct"),
        Quantity(
            "rho_wall",
            "densities of walls",
            DENSITY,
            part_of="chi",
            output=lambda e: where(e.state.solid_n, e.state.rho_n, 0.0),
        ),
        Quantity(
            "grad/v",
            "velocity gradients",
            RATE,
            2,
            _gradient,
            _with_velocities(_gradient),
            result=lambda e: e.gradient.v_ncc,
        ),
        Quantity(
            "grad/rho", "density gradients", Dimension(-1, 1, 0, -1), 1, _gradient, result=lambda e: e.gradient.rho_nc
        ),
        Quantity(
            "grad/energy",
            "energy gradients",
            Dimension(1, 1, -2),
            1,
            _gradient,
            keyword="thermal",
            result=lambda e: e.gradient.energy_nc,
        ),
        Quantity(
            "surface",
            "surface classes",
            inputs=_surface,
            keyword="surface/detection",
            discrete=True,
            result=lambda e: e.surface.class_n,
        ),
        Quantity("surface/r", "distances to the surface", LENGTH, part_of="surface", result=lambda e: e.surface.r_n),
        Quantity("surface/n", "normals", NUMBER, 1, part_of="surface", result=lambda e: e.surface.normal_nc),
        Quantity("surface/divr", "divergences of positions", part_of="surface", result=lambda e: e.surface.divr_n),
        Quantity("shift/v", "shifting velocities", VELOCITY, 1, _shift, _with_velocities(_shift), keyword="shift"),
        Quantity("viscosity", "viscosities", VISCOSITY, inputs=_viscosity),
        Quantity(
            "pressure",
            "pressures",
            PRESSURE,
            inputs=_pressure,
            output=lambda e: e.evaluator.pressure(e.state.rho_n, e.state.energy_n),
        ),
        Quantity("pressure_used", "pressures that forces use", PRESSURE, part_of="pressure"),
        Quantity("conductivity", "conductivities", CONDUCTIVITY, keyword="thermal", output=_thermal("conductivity")),
        Quantity("cv", "specific heats", Dimension(2, 0, -2), keyword="thermal", output=_thermal("specific_heat")),
        Quantity("temperature", "temperatures", inputs=("energy",), keyword="thermal"),
        Quantity(
            "stress/v", "viscous stresses", PRESSURE, 2, ("grad/v", "viscosity"), output=lambda e: e.stress(False)
        ),
        Quantity("stress/t", "total stresses", PRESSURE, 2, ("stress/v", "pressure"), output=lambda e: e.stress(True)),
        Quantity(
            "heatflow",
            "heat flows",
            POWER,
            inputs=_pair_terms,
            reads=lambda model: (*_gradient(model), "temperature"),
            keyword="thermal",
        ),
        Quantity("drho", "rates of density", Dimension(0, 1, -1, -1), inputs=_pair_terms, reads=_diffusion),
        Quantity("f", "forces", FORCE, 1, lambda model: (*_pair_terms(model), "pressure", "viscosity"), _force),
        Quantity("stress/atom", "virial stresses", ENERGY, 2, ("f",)),
        Quantity(
            "virial", "virial pressures", PRESSURE, 2, part_of="stress/atom", output=lambda e: e.pressure_of_all()
        ),
        Quantity("press", "overall pressures", PRESSURE, part_of="stress/atom", output=lambda e: e.press()),
        Quantity("x", "positions", LENGTH, 1, integrated=True, output=lambda e: e.state.x_nc),
        Quantity("v", "velocities", VELOCITY, 1, integrated=True, output=lambda e: e.state.v_nc),
        Quantity("energy", "energies", ENERGY, keyword="thermal", integrated=True, output=lambda e: e.state.energy_n),
        Quantity("phase", "phases", discrete=True, integrated=True, output=lambda e: e.state.solid_n.astype(float)),
        Quantity("status", "status words", completed_by="surface", discrete=True, output=lambda e: e.status()),
    )
}

# Of the input, in addition to the quantities of the model.
INPUTS: dict[str, Quantity] = {
    q.name: q
    for q in (
        Quantity("number", "numbers"),
        Quantity("mass", "masses", Dimension(mass=1)),
        Quantity("time", "times", Dimension(time=1)),
        Quantity("acceleration", "accelerations", Dimension(1, 0, -2)),
        Quantity("diffusivity", "diffusivities", Dimension(2, 0, -1)),
        Quantity("A3", "inverse squares of densities", Dimension(0, -2, 0, 2)),
        Quantity("latent heat", "energies per mass", Dimension(2, 0, -2)),
    )
}


def named(name: str) -> Quantity:
    """Return the record of a quantity of the model or of the input."""
    return INPUTS[name] if name in INPUTS else QUANTITIES[name]


def order() -> tuple[str, ...]:
    """Return the quantities of a force evaluation, in its order."""
    return tuple(q.name for q in QUANTITIES.values() if q.inputs is not None)


def has(model: Model, keyword: Keyword | None) -> bool:
    """Return whether a model has a keyword of fix rheo; always without one."""
    fix = model.fix
    return {
        None: True,
        "interface/reconstruct": fix.interface_reconstruct,
        "shift": fix.shift is not None,
        "surface/detection": fix.surface_detection is not None,
        "thermal": fix.thermal,
    }[keyword]


def keyword_of(name: str) -> Keyword | None:
    """Return the keyword of fix rheo without which a model does not have a quantity."""
    return QUANTITIES[QUANTITIES[name].whole].keyword


def of_model(model: Model, name: str) -> Quantity:
    """Return the record of a quantity that a model has.

    Raises
    ------
    InputError
        A name that there is not, or that this model has not.
    """
    if name not in QUANTITIES:
        raise InputError("field", f"must be one of {', '.join(QUANTITIES)}", name)
    if not has(model, keyword_of(name)):
        raise InputError("field", "is not part of this model (see the keywords of fix rheo)", name)
    return QUANTITIES[name]


def evaluated_for(model: Model, name: str) -> tuple[str, ...]:
    """Return the quantities of an evaluation that give a field of a model.

    Raises
    ------
    InputError
        See `of_model`.
    """
    field = of_model(model, name)
    completed = field.completed_by and has(model, keyword_of(field.completed_by))
    return (field.whole, field.completed_by) if completed else (field.whole,)


def needed_to_step(model: Model) -> tuple[str, ...]:
    """Return the fields that a time step itself needs."""
    fix = model.fix
    wanted = ["f"]
    if not fix.rho_sum:
        wanted += ["grad/v", "drho"]
    if fix.shift:
        wanted += [
            "shift/v",
            "grad/v",
            *([] if fix.rho_sum else ["grad/rho"]),
            *(["grad/energy"] if fix.thermal else []),
        ]
    if fix.thermal:
        wanted += ["temperature", "heatflow"]
    return tuple(wanted)


def dependencies(model: Model, name: str) -> frozenset[str]:
    """Return all quantities that the values of a field depend on, itself and the state included.

    Raises
    ------
    InputError
        See `of_model`.
    """
    found: set[str] = set()
    ahead = [name, *evaluated_for(model, name)]
    while ahead:
        of = ahead.pop()
        if of not in found:
            found.add(of)
            quantity = QUANTITIES[of]
            ahead += (quantity.reads or quantity.needs)(model)
    return frozenset(found)


def required(model: Model, wanted: Iterable[str]) -> tuple[str, ...]:
    """Return all quantities that some fields need, in the order of evaluation.

    Raises
    ------
    InputError
        See `of_model`.
    """
    ahead = [name for field in wanted for name in evaluated_for(model, field)]
    names: set[str] = set()
    while ahead:
        name = ahead.pop()
        if name not in names:
            names.add(name)
            ahead += QUANTITIES[name].needs(model)
    return tuple(name for name in order() if name in names)


# LAMMPS' unit of a quantity that `eos_ref.model.units` does not list follows from its dimension.
_KIND_OF_DIMENSION: dict[Dimension, Kind] = {
    **dict.fromkeys((FORCE, ENERGY, POWER), "energy"),
    PRESSURE: "pressure",
    DENSITY: "density",
    VISCOSITY: "viscosity",
}
for _quantity in QUANTITIES.values():
    if _quantity.dimension in _KIND_OF_DIMENSION:
        KIND_OF.setdefault(_quantity.name, _KIND_OF_DIMENSION[_quantity.dimension])
