"""ASE calculators with one interface: the reference, and real LAMMPS, for the particles of an `ase.Atoms`.

A calculation is one force evaluation of the state in the `ase.Atoms`, as in the set-up of a run. In addition to
positions and velocities it uses the per-atom arrays ``type`` (default 1), ``rho`` (density, unless it is summed) and
``e`` (energy per unit mass, if the model is thermal), all in the units of the model. An integrator of ASE moves
particles by the forces, but ignores density and energy: it leaves both arrays unchanged. A model with rho/sum
has the densities of the positions.
"""

from __future__ import annotations

import weakref
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any

import ase
import numpy as np
from ase.calculators.calculator import CalculationFailed, Calculator, all_changes

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError, unknown
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import TILTED
from eos_ref.model.parameters import Model
from eos_ref.numbers.rounded import error
from lammps_cases.comparison.problem import Problem
from lammps_cases.engine import installations
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER
from lammps_cases.findings.variants import combined
from lammps_cases.records.wording import one_line
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.fields import FIELDS
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

FIELDS_OF = {"forces": "f", "pressure": "pressure", "density": "rho"}
ARRAYS = ("type", "rho", "e", "momenta")  # inputs of a result, in addition to those that every calculator compares


class RheoCalculator(Calculator):  # type: ignore[misc]
    """The common base of both calculators: settings, particles, results.

    Results are ``forces`` (n, 3), ``pressure`` and ``density`` (n,), of every particle; there is no energy.

    Parameters
    ----------
    settings : Scene or Model
        The model; the particles of a scene are ignored. The types of a `Model` are all fluid.

    Raises
    ------
    InputError
        Settings of another kind.
    """

    implemented_properties = tuple(FIELDS_OF)

    def __init__(self, settings: Scene | Model) -> None:
        super().__init__()
        scene = scene_of(settings) if isinstance(settings, Model) else settings
        if not isinstance(scene, Scene):
            raise InputError("settings", "must be a Scene or a Model", type(settings).__name__)
        alone = dict.fromkeys(("evolve", "twin", "expect", "violate", "example", "mass"))
        self.scene = scene.model_copy(update={**alone, "compare": tuple(FIELDS_OF.values())})

    def check_state(self, atoms: ase.Atoms, tol: float = 1e-15) -> list[str]:
        """Return what changed since the last calculation; velocities and densities count too."""
        changes: list[str] = super().check_state(atoms, tol)
        before = self.atoms.arrays if self.atoms is not None else {}
        return changes + [
            name for name in ARRAYS if not np.array_equal(before.get(name, ()), atoms.arrays.get(name, ()))
        ]

    def calculate(
        self,
        atoms: ase.Atoms | None = None,
        properties: Sequence[str] = tuple(FIELDS_OF),
        system_changes: Sequence[str] = all_changes,
    ) -> None:
        """Evaluate forces, pressures and densities.

        Raises
        ------
        InputError
            Particles that the model cannot represent.
        CalculationFailed
            LAMMPS gave no answer.
        """
        super().calculate(atoms, properties, system_changes)
        fields = self._evaluated(particles(self.atoms, self.scene))
        self.results = {name: padded(fields[field]) for name, field in FIELDS_OF.items()}

    @abstractmethod
    def _evaluated(self, atoms: Atoms) -> dict[str, Any]:
        """Return the fields of particles, by LAMMPS' names."""


class EosRefCalculator(RheoCalculator):
    """The reference as an ASE calculator.

    Parameters
    ----------
    settings : Scene or Model
    findings : sequence of str
        Findings of the ledger to reproduce: the reference then behaves like a LAMMPS that has them.
    """

    def __init__(self, settings: Scene | Model, findings: Sequence[str] = ()) -> None:
        super().__init__(settings)
        variants = {entry.id: entry.model_variant for entry in LEDGER if entry.model_variant}
        for name in findings:
            if name not in variants:
                raise unknown("finding with a variant of the particle model", name, variants)
        self.variants = [variants[name] for name in findings]
        self.simulation: Simulation | None = None

    def _evaluated(self, atoms: Atoms) -> dict[str, Any]:
        model, state = reference_side.model(self.scene, atoms, ""), reference_side.state(self.scene, atoms)
        problem = Problem(model, reference_side.box(self.scene, atoms), state, 0.0, self.scene.compare, (0,))
        made = combined(self.variants, problem, {})
        if made is None:
            raise InputError("findings", "one of them follows LAMMPS' own numbers, which are not available")
        stages, stepping = made
        self.simulation = stepping(model, problem.box, state, problem.fields, stages)
        self.simulation.setup()
        return {field: self.simulation.output(field) for field in problem.fields}

    def bounds(self) -> dict[str, FloatArray]:
        """Return the bound of every result of the last calculation: the possible effect of rounding alone."""
        if self.simulation is None:
            raise InputError("bounds", "need a calculation first")
        rounded = self.simulation.rounded(type(self.simulation.evaluator))
        return {name: padded(error(rounded.output(field))) for name, field in FIELDS_OF.items()}


class LammpsRheoCalculator(RheoCalculator):
    """Real LAMMPS as an ASE calculator, in its own process, which `close` ends.

    Parameters
    ----------
    settings : Scene or Model
    engine : str
        env, pypi:VERSION or path:PLACE.
    """

    def __init__(self, settings: Scene | Model, engine: str = "env") -> None:
        super().__init__(settings)
        self.workers = Workers(installations.resolve(engine).site, 1)
        self.close = weakref.finalize(self, self.workers.__exit__, None, None, None)

    def _evaluated(self, atoms: Atoms) -> dict[str, Any]:
        reference_side.state(self.scene, atoms)  # rejects undefined input before LAMMPS sees it
        limit = self.scene.engine.time_limit
        outcome = self.workers.outcome(self.workers.submit(job(self.scene, atoms, plan(self.scene)), limit))
        if isinstance(outcome, Failure):
            raise CalculationFailed(f"{outcome.verdict}: {one_line(outcome.message)}")
        return {field: FIELDS[field].of(outcome.arrays, self.scene.dimension) for field in self.scene.compare}


def padded(values: Any) -> FloatArray:
    """Return a field in ASE's form: vectors with three components."""
    array = np.array(values, float)
    return np.pad(array, [(0, 0), (0, 3 - array.shape[1])]) if array.ndim == 2 else array


def particles(atoms: ase.Atoms, scene: Scene) -> Atoms:
    """Return the particles of an `ase.Atoms`, wrapped into the box along the periodic axes.

    Its cell, with the corner ``info["Origin"]`` (default 0), is the box; in 2D a third edge has no meaning.

    Raises
    ------
    InputError
        A cell that LAMMPS cannot represent, types that the scene lacks, no density.
    """
    n, d = len(atoms), scene.dimension
    cell_cc, low_c = np.array(atoms.cell.array), np.array(atoms.info.get("Origin", np.zeros(3)), float)
    edge_c = np.diag(cell_cc)[:d]
    if np.any(edge_c <= 0) or np.triu(cell_cc, 1)[:d, :d].any():
        raise InputError("cell", "must have edges along x, in the plane of x and y, and up", cell_cc.tolist())
    spacing = getattr(scene.positions, "spacing", (float(np.prod(edge_c)) / max(n, 1)) ** (1 / d))
    high_c = low_c + np.diag(cell_cc)
    if d == 2:
        low_c[2], high_c[2] = -spacing / 2, spacing / 2
    type_n = np.asarray(atoms.arrays.get("type", np.ones(n, int)))
    if n and not (type_n.min() >= 1 and type_n.max() <= len(scene.types)):
        raise InputError("type", f"must lie within 1 to {len(scene.types)}", int(type_n.max()))
    rho_n, e_n = (atoms.arrays.get(name) for name in ("rho", "e"))
    if rho_n is None and not scene.rho_sum:
        raise InputError("Atoms", "needs the per-atom array rho", sorted(atoms.arrays))
    mass_n = np.array([t.mass for t in scene.types])[type_n - 1]
    x_nc = atoms.positions.copy()
    open_c = [not flag for flag in atoms.pbc[:d]]
    xy, xz, yz = (float(cell_cc[of, to]) if of < d else 0.0 for to, of in TILTED)
    energy_n = None if e_n is None else mass_n * e_n
    made = Atoms(
        np.arange(1, n + 1), type_n, x_nc, mass_n, low_c, high_c,
        (not open_c[0], not open_c[1], d == 2 or not open_c[2]), spacing,
        atoms.get_velocities(), None if scene.rho_sum else rho_n, energy_n, (xy, xz, yz),
    )  # fmt: skip
    box = made.box(d)
    x_nc[:, :d] -= box.shift(box.images(x_nc[:, :d]))
    return made


def _type(model: Model, t: int) -> dict[str, Any]:
    """Return the keys of an atom type in a scene."""
    fix, law = model.fix, model.viscosity[t]
    given: dict[str, Any] = {"mass": model.mass_t[t], "rho0": fix.rho0 and fix.rho0[t], "cs": fix.cs and fix.cs[t]}
    given["viscosity"] = (
        law.eta if law.style == "constant" else {"eta": law.eta, "gd0": law.gd0, "K": law.K, "n": law.n}
    )
    if model.thermal:
        thermal = vars(model.thermal[t])
        given |= {name: value for name, value in thermal.items() if value or name != "latent_heat"}
    return given


def _pressure(model: Model) -> Iterator[dict[str, Any]]:
    """Yield the groups of fix rheo/pressure in a scene."""
    for t, eos in enumerate(model.eos, 1):
        argument = {} if eos.law.parameter is None else {eos.law.parameter: eos.parameter}
        yield {"types": str(t), "style": eos.style, **argument}
        if eos.background:
            yield {"types": str(t), "style": "background", "P_b": eos.background}


def scene_of(model: Model) -> Scene:
    """Return a scene with the settings of a model, and a single particle."""
    fix, pair, d = model.fix, model.pair, model.dimension
    forces = [
        {"style": force.style, "vector": force.vector, "types": str(t)}
        for force in model.forces
        for t in force.types or range(1, len(model.mass_t) + 1)
    ]
    shift = fix.shift and {"exclude": fix.shift.exclude_types, "scale_cross_type": fix.shift.scale_cross_type}
    return Scene.model_validate(
        {
            "units": model.units,
            "dimension": d,
            "types": [_type(model, t) for t in range(len(model.mass_t))],
            "positions": {"x": [[0.5] * d], "low": [0.0] * d, "high": [1.0] * d},
            "pressure": list(_pressure(model)),
            "compare": list(FIELDS_OF.values()),
            "forces": forces,
            "energy": {"constant": 1.0} if fix.thermal else None,
            "rheo": {
                "kernel": fix.kernel,
                "cut": fix.cut,
                "zmin": fix.zmin,
                "rho_sum": fix.rho_sum,
                "self_mass": fix.self_mass,
                "interface_reconstruct": fix.interface_reconstruct,
                "surface_detection": fix.surface_detection and vars(fix.surface_detection),
                "shift": shift or False,
            },
            "pair": {
                "artificial_visc": pair.artificial_viscosity,
                "rho_damp": pair.rho_damp,
                "harmonic_means": pair.harmonic_means,
            },
        }
    )
