"""Small scenes of the particle model for the tests: deterministic, and in numbers that translate exactly.

Positions, velocities and densities are whole multiples of 2**-20, so that sums with such numbers do not round: a
translated, mirrored or replicated scene holds the same displacements to the last bit.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import EOS, EOSTable
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import MakeEvaluator, Simulation
from eos_ref.model.box import Box
from eos_ref.model.parameters import Force, Model, PairRheo, Thermal, Viscosity
from eos_ref.model.quantities import order
from eos_ref.model.state import State
from eos_ref.numbers.rounded import error, value
from eos_ref.syntax.fixes import FixRheo, Shift, SurfaceDetection

EPS = 2.0**-52
GRID = 2.0**20
RHO0, CS, MASS = (1.25, 0.875), (4.0, 5.5), (1.3125, 0.8125)
TWO_LAWS = EOSTable((EOS("linear", RHO0[0], CS[0], background=0.25), EOS("tait/general", RHO0[1], CS[1], 3.5)))
CONSTANT = (Viscosity("constant", 0.3), Viscosity("constant", 0.7))
POWER = (Viscosity("power", 0.5, 0.75, 0.2, 0.6), Viscosity("constant", 0.7))
HOT = (Thermal(0.7, 1.5), Thermal(0.25, 2.25))
# Scalars, vectors and tensors that an evaluation may leave, by LAMMPS' names.
OUTPUTS = (
    "coordination",
    "rho",
    "chi",
    "grad/v",
    "shift/v",
    "surface",
    "surface/r",
    "surface/n",
    "surface/divr",
    "viscosity",
    "pressure_used",
    "temperature",
    "heatflow",
    "drho",
    "f",
    "stress/atom",
)


def dyadic(array: Any) -> Any:
    """The nearest multiples of 2**-20."""
    return np.round(np.asarray(array, float) * GRID) / GRID


@dataclass(frozen=True)
class Scene:
    """A model, a box and a state."""

    model: Model
    box: Box
    state: State

    def simulate(self, fields: Iterable[str] | None = None, evaluator: MakeEvaluator = ArrayEvaluator) -> Simulation:
        """A simulation that evaluates all that the model has, or some fields."""
        return Simulation(
            self.model, self.box, self.state, everything(self.model) if fields is None else fields, evaluator
        )

    def with_state(self, **changes: Any) -> Scene:
        """The scene with other arrays."""
        return replace(self, state=replace(self.state.copy(), **changes))

    def with_model(self, **changes: Any) -> Scene:
        """The scene with another model."""
        return replace(self, model=replace(self.model, **changes))

    def longdouble(self) -> Scene:
        """The same scene in longdouble arrays."""
        s = self.state
        energy_n = None if s.energy_n is None else s.energy_n.astype(np.longdouble)
        arrays = {k: getattr(s, k).astype(np.longdouble) for k in ("x_nc", "v_nc", "rho_n")}
        return self.with_state(**arrays, energy_n=energy_n)


def everything(model: Model) -> tuple[str, ...]:
    """All quantities that a model has."""
    fix = model.fix
    absent = set()
    absent |= set() if fix.shift else {"shift/v"}
    absent |= set() if fix.surface_detection else {"surface"}
    absent |= set() if fix.interface_reconstruct else {"chi"}
    absent |= set() if fix.thermal else {"temperature", "heatflow", "grad/energy"}
    return tuple(name for name in order() if name not in absent)


def lattice(cells: tuple[int, ...], disorder: float, seed: int) -> Any:
    """Sites of unit spacing, each moved at random by at most ``disorder`` along every axis."""
    x_nc = np.array(list(itertools.product(*map(range, cells)))) + 0.5
    return dyadic(x_nc + np.random.default_rng(seed).uniform(-disorder, disorder, x_nc.shape))


def scene(
    dimension: int = 2,
    *,
    cells: tuple[int, ...] | None = None,
    disorder: float = 0.2,
    seed: int = 1,
    cut: float = 2.625,
    kernel: str = "quintic",
    zmin: int = 0,
    periodic: tuple[bool, ...] | None = None,
    margin: float = 0.0,
    solids: bool = False,
    droplet: bool = False,
    walls: bool = False,
    thermal: tuple[Thermal, ...] | None = None,
    shift: Shift | None = None,
    surface: SurfaceDetection | None = None,
    rho_sum: bool = False,
    self_mass: bool = False,
    laws: EOSTable = TWO_LAWS,
    viscosity: tuple[Viscosity, ...] = CONSTANT,
    artificial: float = 0.0,
    damp: float = 0.0,
    harmonic: bool = False,
    forces: tuple[Force, ...] = (),
    one_type: bool = False,
) -> Scene:
    """A disordered block of unit spacing with random velocities, densities, types and, if wanted, energies.

    ``solids``: the lowest two layers along y are solid; with ``walls`` they are interface/reconstruct's; ``droplet``:
    all particles but one. ``margin`` widens the box beyond the block on its open sides, for free surfaces. Edges are
    shorter than two cutoffs by default.
    """
    cells = cells or ((6, 5) if dimension == 2 else (3, 4, 2))
    x_nc = lattice(cells, disorder, seed)
    n = len(x_nc)
    random = np.random.default_rng(seed + 1000)
    type_n = random.integers(1, 3, n)
    if one_type:
        type_n = np.ones(n, int)
    solid_n = (x_nc[:, 1] < 2) if solids or walls else np.zeros(n, bool)
    if droplet:
        solid_n = np.arange(n) != n // 2
    fix = FixRheo(
        cut,
        kernel,
        zmin,
        thermal=thermal is not None,
        interface_reconstruct=walls,
        surface_detection=surface,
        shift=shift,
        rho_sum=rho_sum,
        self_mass=self_mass,
        rho0=RHO0,
        cs=CS,
    )
    model = Model(
        dimension,
        fix,
        MASS,
        laws,
        PairRheo(cut, artificial, damp, harmonic),
        viscosity,
        thermal,
        forces,
    )
    periodic = periodic or (True,) * dimension
    margins = [0.0 if p else margin for p in periodic]
    box = Box(
        tuple(-m for m in margins),
        tuple(c + m for c, m in zip(cells, margins, strict=True)),
        periodic,
    )
    state = State(
        x_nc,
        dyadic(random.uniform(-1, 1, x_nc.shape)),
        dyadic(np.array(RHO0)[type_n - 1] * random.uniform(0.9, 1.15, n)),
        type_n,
        solid_n,
        dyadic(random.uniform(2, 4, n)) if thermal else None,
    )
    return Scene(model, box, state)


THIN = EOSTable((EOS("linear", RHO0[0], CS[0], background=-8.0), EOS("tait/general", RHO0[1], CS[1], 3.5)))
GAS = EOSTable((EOS("ideal/gas", RHO0[0], CS[0], 1.4), EOS("cubic", RHO0[1], CS[1], 0.8)))
MELTING = (Thermal(0.7, 1.5, 0.3, 1.1), Thermal(0.25, 2.25))
_OPEN = {"periodic": (False, True), "margin": 3.0}
_OPEN_3D = {"periodic": (False, True, False), "margin": 3.0}

# Scenes that together reach every formula; each is built in 2D and in 3D.
RECIPES: dict[str, dict[str, Any]] = {
    "quintic": {"artificial": 0.75, "damp": 0.125},
    "RK0": {"kernel": "RK0", "artificial": 0.75, "damp": 0.125},
    "RK1": {"kernel": "RK1", "artificial": 0.75, "damp": 0.125, "viscosity": POWER},
    "RK2": {"kernel": "RK2", "artificial": 0.75, "damp": 0.125},
    "RK1, some below zmin": {"kernel": "RK1", "zmin2": 17, "zmin3": 26, "damp": 0.125, "open": True},
    "solids": {"solids": True, "artificial": 0.75, "damp": 0.125, "harmonic": True, "viscosity": POWER},
    "walls": {"walls": True, "artificial": 0.75, "damp": 0.125, "viscosity": POWER},
    "walls, RK1": {"walls": True, "kernel": "RK1", "artificial": 0.75, "damp": 0.125},
    "walls, RK2": {"walls": True, "kernel": "RK2", "artificial": 0.75, "damp": 0.125},
    "droplet": {"walls": True, "droplet": True, "cut": 3.25},
    "torn": {"walls": True, "laws": THIN},
    "gas": {"laws": GAS, "thermal": HOT, "artificial": 0.75, "harmonic": True},
    "latent heat": {"thermal": MELTING, "kernel": "RK1", "solids": True},
    "walls, thermal": {"walls": True, "thermal": HOT, "shift": Shift()},
    "rho/sum": {"rho_sum": True, "shift": Shift()},
    "self/mass": {"rho_sum": True, "self_mass": True, "kernel": "RK1"},
    "walls, rho/sum": {"walls": True, "rho_sum": True, "kernel": "RK1"},
    "coordination": {
        "surface2": SurfaceDetection("coordination", 18, 14),
        "surface3": SurfaceDetection("coordination", 27, 25),
        "shift": Shift(),
        "open": True,
    },
    "divergence": {
        "surface2": SurfaceDetection("divergence", 1.7, 13),
        "surface3": SurfaceDetection("divergence", 1.7, 25),
        "shift": Shift(),
        "walls": True,
        "open": True,
    },
    "exclude": {"shift": Shift(("2",)), "damp": 0.125},
    "cross": {"shift": Shift((), (0.3, 0.35, 0.2)), "walls": True},
    "cross, by distance": {"shift": Shift((), (0.3, 0.35, 0.4), weighs_distance=True), "walls": True},
    "forces": {
        "solids": True,
        "forces2": (
            Force("gravity", (0.25, -1.5)),
            Force("addforce", (0.5, 0.0), (1,)),
            Force("setforce", (None, 0.0), (2,)),
        ),
        "forces3": (Force("gravity", (0.25, -1.5, 1.0)), Force("setforce", (None, 0.0, 0.125), (2,))),
    },
    "walls, forces": {
        "walls": True,
        "forces2": (Force("gravity", (0.25, -1.5)), Force("setforce", (0.0, 0.5), (2,))),
        "forces3": (Force("gravity", (0.25, -1.5, 1.0)), Force("setforce", (0.0, 0.5, None), (2,))),
    },
}


def recipe(name: str, dimension: int, **changes: Any) -> Scene:
    """A scene of `RECIPES`."""
    options = {**RECIPES[name], **changes}
    for key in [key for key in options if key[-1] in "23"]:  # a value for one of the dimensions
        setting = options.pop(key)
        if key[-1] == str(dimension):
            options[key[:-1]] = setting
    if options.pop("open", False):
        options |= _OPEN if dimension == 2 else _OPEN_3D
    return scene(dimension, **options)


def results(simulation: Simulation) -> dict[str, Any]:
    """Fields of a simulation that were evaluated, the density of its state among them."""
    found = {name: simulation.fields.get(name) for name in OUTPUTS} | {"rho": simulation.state.rho_n}
    found |= {f"grad/{name}": getattr(simulation.gradient, f"{name}_nc") for name in ("rho", "energy")}
    return {name: field for name, field in found.items() if field is not None}


def bounded(built: Scene, accelerations_nc: Any = None) -> dict[str, tuple[Any, Any]]:
    """Values of all fields of the first evaluation of a scene with the rounding bound of each."""
    simulation = built.simulate()
    if accelerations_nc is not None:
        simulation.other_nc = accelerations_nc
    return {name: (value(field), error(field)) for name, field in results(simulation.rounded()).items()}


def assert_same(found: dict[str, tuple[Any, Any]], expected: dict[str, tuple[Any, Any]], slack: float = 1.0) -> None:
    """Fail unless fields agree within the sum of both bounds."""
    assert found.keys() == expected.keys()
    for name, (a, error_a) in found.items():
        b, error_b = expected[name]
        wrong = ~(np.abs(a - b) <= slack * (error_a + error_b))
        assert not wrong.any(), f"{name}: {a[wrong][:3]}, not {b[wrong][:3]}; bounds {(error_a + error_b)[wrong][:3]}"
