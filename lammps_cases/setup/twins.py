r"""Twins: a second run of LAMMPS that must give what the first gives, whatever the right numbers are.

`make` turns a scene and its particles into those of the twin, and says how the twin's fields look in the frame of the
original. Nothing here evaluates physics. Positions, velocities and displacements are first rounded to a common grid,
and a scale is a power of two, so that the twin poses the same problem to the last bit: what differs in the answers is
rounding, for which there are bounds, or a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from eos_ref.model.quantities import QUANTITIES, Dimension
from eos_ref.syntax.manual import Manual, weighs_distance
from lammps_cases.scene import AtomType, ForceSettings, Lattice, PowerLaw, RheoSettings, Scene, TwinSettings
from lammps_cases.scene.atoms import Atoms, IntArray, kernel_cut, seed
from lammps_cases.scene.casefile import Case

Fields = dict[str, Any]
UNIT = 2.0**-53  # largest relative error of one rounding
GRID_BITS = 44  # of the grid, below the largest number: sums and differences have bits to spare

WHY = {
    "translate": "no term depends on where the particles lie, nor on which of them the box cuts apart",
    "boost": "Galilean invariance: no term depends on a velocity that all particles and walls share",
    "relabel": "ids, and the order in which particles are created, are names",
    "rescale": "every quantity has a dimension: a scene of another size with the same densities and velocities behaves "
    "the same",
    "newton": "who computes a pair, and who is told, is bookkeeping",
    "skin": "how far neighbour lists reach beyond the cutoff is bookkeeping",
    "rebuild": "when neighbour lists are built anew is bookkeeping, as long as no neighbour is missed",
    "split": "a run continued with pre no is the same run",
    "ranks": "which process owns a particle is bookkeeping",
}


# Of the input, beside the quantities of the model.
INPUTS = {
    "mass": Dimension(mass=1),
    "time": Dimension(time=1),
    "acceleration": Dimension(1, 0, -2),
    "diffusivity": Dimension(2, 0, -1),
}


def dimension(name: str) -> Dimension:
    """Return the dimension of a quantity of the model or of the input."""
    return INPUTS[name] if name in INPUTS else QUANTITIES[name].dimension


@dataclass(frozen=True)
class Scale:
    """Lengths times ``factor`` at the same densities and velocities: masses times factor^d, times times factor."""

    factor: float
    d: int

    def of(self, quantity: str) -> float:
        """Return the factor of a quantity."""
        length, mass, time, volume = dimension(quantity)
        return float(self.factor ** (length + self.d * (mass + volume) + time))


@dataclass(frozen=True)
class Twin:
    """Two scenes with their particles that pose one problem, and the way back from the second to the first.

    Attributes
    ----------
    scene, atoms : the original; its positions and velocities lie on a grid, if the twin's are other ones
    other_scene, other_atoms : the twin
    steps : steps at which the two are compared
    row_n : row of every particle of the original in the twin's arrays
    displacement_c, velocity_c : added to all positions and velocities
    """

    kind: str
    scene: Scene
    atoms: Atoms
    other_scene: Scene
    other_atoms: Atoms
    steps: tuple[int, ...]
    row_n: IntArray
    scale: Scale
    displacement_c: FloatArray
    velocity_c: FloatArray

    @property
    def same_problem(self) -> bool:
        """Return whether the reference cannot tell the two apart: only settings of LAMMPS differ."""
        return self.kind in ("newton", "skin", "rebuild", "split", "ranks")

    def back(self, snapshot: Fields, step: int) -> Fields:
        """Return the fields of the twin as the original should have them."""
        found = self.in_place(snapshot)
        for field, added_c in self._added(step).items():
            if field in found and added_c.any():
                found[field] = found[field] - added_c
        return found

    def in_place(self, fields: Fields) -> Fields:
        """Return the fields of the twin in the original's order and units; what holds for bounds too."""
        return {name: array[self.row_n] / self.scale.of(name) for name, array in fields.items()}

    def rounding(self, returned: Fields, step: int) -> Fields:
        """Return the largest rounding error of `back`: of displacement and difference, and of a period added later."""
        atoms, d, found = self.atoms, self.scene.dimension, {}
        for field, added_c in self._added(step).items():
            if field in returned and added_c.any():
                period_c = (atoms.high_c - atoms.low_c)[:d] if field == "x" else 0.0
                found[field] = 2 * UNIT * (np.abs(returned[field]) + np.abs(added_c) + period_c)
        return found

    def _added(self, step: int) -> dict[str, FloatArray]:
        time = step * self.scene.evolve.timestep if self.scene.evolve else 0.0
        return {"x": self.displacement_c + time * self.velocity_c, "v": self.velocity_c}


def describe(settings: TwinSettings) -> str:
    """Return in one line what the second run is, and why it must give the same."""
    (given,) = settings.model_dump(exclude_none=True).values()
    return f"{settings.kind} {given}: {WHY[settings.kind]}"


def make(case: Case, atoms: Atoms) -> Twin:
    """Return the twin of a case.

    Raises
    ------
    InputError
        A displacement that moves particles out of the box, or that no double holds.
    """
    scene, settings = case.scene, case.scene.twin
    assert settings is not None
    n, d, kind = len(atoms), scene.dimension, settings.kind
    nowhere_c = np.zeros(d)
    unscaled = Scale(1.0, d)
    same = Twin(kind, scene, atoms, scene, atoms, scene.snapshots, np.arange(n), unscaled, nowhere_c, nowhere_c)
    if settings.translate is not None:
        return _translated(same, settings.translate, case.where)
    if settings.boost is not None:
        return _boosted(same, settings.boost)
    if settings.relabel is not None:
        return _relabelled(same, case.name)
    if settings.rescale is not None:
        scale = Scale(settings.rescale, d)
        other = rescaled(scene, scale, kernel_cut(scene, atoms.spacing))
        return replace(same, other_scene=other, other_atoms=rescaled_atoms(atoms, scale), scale=scale)
    if settings.split is not None:
        return _split(same)
    return replace(same, other_scene=_with_other_settings(scene, settings))


# --- the kinds


def gridded(values: FloatArray, added: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two arrays rounded to a common grid, on which they can be added without rounding."""
    largest = max(np.abs(values).max(initial=0.0), np.abs(added).max(initial=0.0))
    grid = 2.0 ** (np.ceil(np.log2(largest)) - GRID_BITS) if largest else 1.0
    return np.round(values / grid) * grid, np.round(added / grid) * grid


def _translated(same: Twin, by: Sequence[float], where: str) -> Twin:
    d, atoms = same.scene.dimension, same.atoms
    low_c, high_c = atoms.low_c[:d], atoms.high_c[:d]
    x_nc, by_c = gridded(atoms.x_nc[:, :d], np.array(by))
    periodic = np.array(atoms.periodic[:d])
    x_nc = np.where(periodic & (x_nc >= high_c), x_nc - (high_c - low_c), x_nc)
    turns_nc = np.where(periodic, np.floor((x_nc + by_c - low_c) / (high_c - low_c)), 0.0)
    moved_nc = (x_nc + by_c) - turns_nc * (high_c - low_c)
    outside = np.flatnonzero(((moved_nc < low_c) | (moved_nc > high_c) | ((moved_nc == high_c) & periodic)).any(axis=1))
    if outside.size:
        rule = "must leave particles in the box along axes that are not periodic"
        raise InputError("twin.translate", rule, tuple(by), f"{where}, atom {outside[0] + 1}")
    returned_nc = moved_nc.astype(np.longdouble) + turns_nc * (high_c - low_c) - by_c
    if (returned_nc != x_nc).any():
        raise InputError("twin.translate", "no double holds the moved positions exactly", tuple(by), where)
    original, other = (replace(atoms, x_nc=_with_plane(array_nc, atoms.x_nc)) for array_nc in (x_nc, moved_nc))
    return replace(same, atoms=original, other_atoms=other, displacement_c=by_c)


def _boosted(same: Twin, by: Sequence[float]) -> Twin:
    d, atoms = same.scene.dimension, same.atoms
    full_nc = np.zeros(atoms.x_nc.shape) if atoms.v_nc is None else atoms.v_nc
    v_nc, by_c = gridded(full_nc[:, :d], np.array(by))
    original, other = (replace(atoms, v_nc=_with_plane(array_nc, full_nc)) for array_nc in (v_nc, v_nc + by_c))
    return replace(same, atoms=original, other_atoms=other, velocity_c=by_c)


def _with_plane(array_nc: FloatArray, full_nc: FloatArray) -> FloatArray:
    """Return all three axes, of which only those of the scene are replaced."""
    found_nc = full_nc.copy()
    found_nc[:, : array_nc.shape[1]] = array_nc
    return found_nc


def _relabelled(same: Twin, name: str) -> Twin:
    atoms = same.atoms
    order_n = np.random.default_rng(seed(f"{name}/relabel")).permutation(len(atoms))
    other = replace(
        atoms,
        type_n=atoms.type_n[order_n],
        x_nc=atoms.x_nc[order_n],
        mass_n=atoms.mass_n[order_n],
        v_nc=None if atoms.v_nc is None else atoms.v_nc[order_n],
        rho_n=None if atoms.rho_n is None else atoms.rho_n[order_n],
        energy_n=None if atoms.energy_n is None else atoms.energy_n[order_n],
    )
    return replace(same, other_atoms=other, row_n=np.argsort(order_n))


def _split(same: Twin) -> Twin:
    evolve = same.scene.evolve
    assert evolve is not None

    def halting(*steps: int) -> Scene:
        return same.scene.model_copy(update={"evolve": evolve.model_copy(update={"compare_at": steps})})

    last = evolve.steps
    return replace(same, scene=halting(last), other_scene=halting(last // 2, last), steps=(last,))


def _with_other_settings(scene: Scene, settings: TwinSettings) -> Scene:
    """Return the same scene with other settings of LAMMPS."""
    if settings.rebuild is not None:
        update: dict[str, Any] = settings.rebuild.model_dump()
    else:
        update = {settings.kind: getattr(settings, settings.kind)}
    return scene.model_copy(update={"engine": scene.engine.model_copy(update=update)})


# --- another size


def rescaled(scene: Scene, scale: Scale, cut: float) -> Scene:
    """Return a scene at another size: every parameter but those of density and velocity times its own factor.

    So pressures, energies per mass, temperatures, specific heats and the parameters of all equations of state stay as
    they are. The extra repulsion of reconstructed walls (NUMERICS.md, section 5) has the dimension of a force in 3D
    only, and the normal of a surface a constant that does not scale (1e-10; NUMERICS.md, section 4).
    """
    positions = scene.positions
    if isinstance(positions, Lattice):
        positions = positions.model_copy(update={"spacing": positions.spacing * scale.of("x")})
    update: dict[str, Any] = {
        "types": tuple(_rescaled_type(t, scale, scene.thermal) for t in scene.types),
        "positions": positions,
        "rheo": _rescaled_rheo(scene.rheo, scene.manual, scale, cut),
        "pair": scene.pair.model_copy(update={"rho_damp": scene.pair.rho_damp * scale.of("diffusivity")}),
        "forces": tuple(_rescaled_force(force, scale) for force in scene.forces),
    }
    if scene.evolve:
        timestep = scene.evolve.timestep * scale.of("time")
        update["evolve"] = scene.evolve.model_copy(update={"timestep": timestep})
    return scene.model_copy(update=update)


def _rescaled_type(t: AtomType, scale: Scale, thermal: bool) -> AtomType:
    law, eta = t.viscosity, scale.of("viscosity")
    if isinstance(law, PowerLaw):
        # K is a viscosity times a strain rate to the power of 1 - n.
        rate = scale.of("grad/v")
        scaled = {"eta": law.eta * eta, "gd0": law.gd0 * rate, "K": law.K * eta * rate ** (1 - law.n)}
        law = law.model_copy(update=scaled)
    else:
        law = law * eta
    update: dict[str, Any] = {"mass": t.mass * scale.of("mass"), "viscosity": law}
    if thermal:  # a type with a thermal property makes particles carry energy
        update["conductivity"] = t.conductivity * scale.of("conductivity")
    return t.model_copy(update=update)


def _rescaled_rheo(rheo: RheoSettings, manual: Manual, scale: Scale, cut: float) -> RheoSettings:
    update: dict[str, Any] = {"cut": cut * scale.of("x")}
    if rheo.shifting and rheo.shifting.scale_cross_type:
        keep, cmin, wmin = rheo.shifting.scale_cross_type
        support = scale.of("kernel") * (scale.of("x") if weighs_distance(manual) else 1.0)
        scaled = (keep, cmin, wmin * support)
        update["shift"] = rheo.shifting.model_copy(update={"scale_cross_type": scaled})
    return rheo.model_copy(update=update)


def _rescaled_force(force: ForceSettings, scale: Scale) -> ForceSettings:
    by = scale.of("acceleration" if force.style == "gravity" else "f")
    return force.model_copy(update={"vector": tuple(None if v is None else v * by for v in force.vector)})


def rescaled_atoms(atoms: Atoms, scale: Scale) -> Atoms:
    """Return the particles at another size, with their densities and velocities."""
    length = scale.of("x")
    return replace(
        atoms,
        x_nc=atoms.x_nc * length,
        low_c=atoms.low_c * length,
        high_c=atoms.high_c * length,
        spacing=atoms.spacing * length,
        mass_n=atoms.mass_n * scale.of("mass"),
        energy_n=None if atoms.energy_n is None else atoms.energy_n * scale.of("energy"),
    )
