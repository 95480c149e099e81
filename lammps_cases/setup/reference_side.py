"""A scene for the reference: model, box and state, independent of LAMMPS' commands.

The positions, velocities, densities and energies are the doubles that LAMMPS is given. Gravity is exact too:
`lammps_cases.setup.commands` gives every axis a separate fix, whose direction LAMMPS does not round, so that
the acceleration is the scene's vector to the last bit, and the force on a particle one product with its mass.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import MakeEvaluator, Simulation
from eos_ref.model.box import Box, Deform
from eos_ref.model.parameters import Force, Model, PairRheo, Thermal, Viscosity
from eos_ref.model.state import State, check_state
from eos_ref.syntax.fixes import FixRheo, Shift, SurfaceDetection
from eos_ref.syntax.manual import weighs_distance
from eos_ref.syntax.ranges import type_range
from lammps_cases.scene import AtomType, PowerLaw, Scene
from lammps_cases.scene.atoms import Atoms, kernel_cut
from lammps_cases.scene.runs import Stop


def model(scene: Scene, atoms: Atoms, where: str) -> Model:
    """Return the particle model of a scene.

    Raises
    ------
    InputError
        Options that contradict each other.
    """
    return with_cut(scene, kernel_cut(scene, atoms.spacing), where)


def with_cut(scene: Scene, cut: float, where: str = "") -> Model:
    """Return the particle model of a scene, for a cutoff of the kernel.

    Raises
    ------
    InputError
        Options that contradict each other.
    """
    fix, pair = _fix(scene, cut), scene.pair
    try:
        return Model(
            dimension=scene.dimension,
            fix=fix,
            mass_t=tuple(t.mass for t in scene.types),
            eos=scene.eos(where),
            pair=PairRheo(fix.cut, pair.artificial_visc, pair.rho_damp, pair.harmonic_means),
            viscosity=tuple(_viscosity(t) for t in scene.types),
            thermal=tuple(_thermal(t) for t in scene.types) if scene.thermal else None,
            forces=tuple(
                Force(f.style, f.vector, None if f.types is None else tuple(type_range(f.types, len(scene.types))))
                for f in scene.forces
            ),
            deform=_deform(scene),
            units=scene.units,
        )
    except InputError as error:
        raise error.at(where) from None


def _fix(scene: Scene, cut: float) -> FixRheo:
    rheo, shift, surface = scene.rheo, scene.rheo.shifting, scene.rheo.surface_detection
    return FixRheo(
        cut,
        rheo.kernel,
        rheo.zmin,
        thermal=scene.thermal,
        interface_reconstruct=rheo.interface_reconstruct,
        surface_detection=SurfaceDetection(surface.style, surface.limit, surface.splash) if surface else None,
        shift=Shift(shift.exclude, shift.scale_cross_type, weighs_distance(scene.manual)) if shift else None,
        rho_sum=rheo.rho_sum,
        self_mass=rheo.self_mass,
        rho0=scene.rho0,
        cs=scene.cs,
    )


def _deform(scene: Scene) -> Deform | None:
    if not (scene.evolve and (given := scene.evolve.deform)):
        return None
    d = scene.dimension
    shears = given.shears[: d * (d - 1) // 2]
    time = scene.evolve.steps * scene.evolve.timestep
    return Deform(given.rates[:d], given.remap, shears if any(shears) else (), time)


def _viscosity(atom_type: AtomType) -> Viscosity:
    law = atom_type.viscosity
    if isinstance(law, PowerLaw):
        return Viscosity("power", law.eta, law.gd0, law.K, law.n)
    return Viscosity("constant", law)


def _thermal(atom_type: AtomType) -> Thermal:
    return Thermal(
        atom_type.conductivity,
        atom_type.specific_heat,
        atom_type.latent_heat or 0.0,
        atom_type.T_freeze,
    )


def box(scene: Scene, atoms: Atoms) -> Box:
    """Return the box of a scene, with as many axes as dimensions; one that leans later has edges that lean by 0."""
    around, deform = atoms.box(scene.dimension), _deform(scene)
    return replace(around, tilt=around.tilt or (0.0,) * len(deform.shear)) if deform else around


def state(scene: Scene, atoms: Atoms, where: str = "") -> State:
    """Return the particles of a scene before the first step; a density still to be summed is that of equilibrium.

    Raises
    ------
    InputError
        See `eos_ref.model.state.check_state`; or particles outside the plane of a 2D scene.
        The overall pressure of a single particle, to which LAMMPS gives no temperature.
    """
    if "press" in scene.compare and len(atoms) == 1:
        raise InputError(
            "compare", "press needs two particles or more: LAMMPS has no temperature for one", "press", where
        )
    given = unchecked_state(scene, atoms, where)
    check_state(model(scene, atoms, where), box(scene, atoms), given, where)
    return given


def unchecked_state(scene: Scene, atoms: Atoms, where: str = "") -> State:
    """Return what `state` returns, also for states that have a pressure but no neighbourhood: of negative density.

    Raises
    ------
    InputError
        Particles outside the plane of a 2D scene.
    """
    d, n = scene.dimension, len(atoms)
    if d == 2 and atoms.x_nc[:, 2].any():
        raise InputError("position", "must have z = 0 in 2D", float(np.abs(atoms.x_nc[:, 2]).max()), where)
    solid_t = np.array([t.phase == "solid" for t in scene.types])
    rho0_t = np.array(scene.rho0 or (1.0,) * len(scene.types))
    return State(
        x_nc=np.array(atoms.x_nc[:, :d]),
        v_nc=np.zeros((n, d)) if atoms.v_nc is None else np.array(atoms.v_nc[:, :d]),
        rho_n=(rho0_t[atoms.type_n - 1] if atoms.rho_n is None else np.array(atoms.rho_n)),
        type_n=np.array(atoms.type_n),
        solid_n=solid_t[atoms.type_n - 1],
        energy_n=np.array(atoms.energy_n) if scene.thermal else None,
        mass_n=np.array(atoms.mass_n) if scene.mass else None,
    )


def displacement(stop: Stop, scene: Scene, atoms: Atoms) -> FloatArray | None:
    """Return the displacement of every particle at a stop, (n, d); None: none."""
    if stop.displace is None:
        return None
    moved_n = np.isin(atoms.type_n, list(type_range(stop.displace.types or "*", len(scene.types))))
    return np.asarray(np.where(moved_n[:, None], np.array(stop.displace.vector[: scene.dimension]), 0.0))


def simulation(
    scene: Scene,
    atoms: Atoms,
    fields: Iterable[str] = (),
    where: str = "",
    evaluator: MakeEvaluator | None = None,
    stepping: type[Simulation] = Simulation,
) -> Simulation:
    """Return the reference of a scene, to be evaluated and stepped.

    Parameters
    ----------
    fields : iterable of str
        The fields of an evaluation, by LAMMPS' names; empty: those that time steps need.
    evaluator : class, optional
        By default the compiled one, except in a box that is tilted or grows.
    stepping : class
        `Simulation`, or one that adds to it.

    Raises
    ------
    InputError
        See `model` and `state`.
    """
    around = box(scene, atoms)
    if evaluator is None and (around.tilted or _deform(scene)):
        evaluator = ArrayEvaluator
    if evaluator is None:
        from eos_ref.compiled.evaluator import CompiledEvaluator

        evaluator = CompiledEvaluator
    return stepping(model(scene, atoms, where), around, state(scene, atoms, where), fields, evaluator)
