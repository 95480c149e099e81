r"""Twins: a second run of LAMMPS that must give the same as the first, whatever the right numbers are.

`make` turns a scene and its particles into those of the twin, and maps the twin's fields to the frame of the
original. Nothing here evaluates physics. Positions, velocities and displacements are first rounded to a common grid,
and a scale is a power of two, so that the twin poses the same problem to the last bit: what differs in the answers is
rounding, for which there are bounds, or a fault. Only other units round the input as well; see `Twin.rounds_input`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref import Box, InputError
from eos_ref.eos.table import FloatArray
from eos_ref.model.quantities import named
from eos_ref.model.units import UNITS, Units
from lammps_cases.records.yaml_files import flow
from lammps_cases.scene import Scene, TwinSettings
from lammps_cases.scene.atoms import Atoms, IntArray, kernel_cut, seed
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.values import Powers, changed

Fields = dict[str, Any]
UNIT = 2.0**-53  # largest relative error of one rounding
GRID_BITS = 44  # of the grid, below the largest number: sums and differences have spare bits

WHY = {
    "translate": "no term depends on where the particles lie, nor on which of them the box cuts apart",
    "boost": "Galilean invariance: no term depends on a velocity that all particles and walls share",
    "relabel": "ids, and the order in which particles are created, are names",
    "rescale": "every quantity has a dimension: a scene of another size with the same densities and velocities behaves "
    "the same",
    "units": "according to the manual every simulation can be duplicated in every system of units",
    "newton": "which process computes a pair, and which receives it, is bookkeeping",
    "skin": "how far neighbour lists reach beyond the cutoff is bookkeeping",
    "rebuild": "when neighbour lists are rebuilt is bookkeeping, as long as no neighbour is missed",
    "split": "a run continued with pre no is the same run",
    "ranks": "which process owns a particle is bookkeeping",
    "tilt": "tilting by whole edges gives the same lattice of periodic images",
}


@dataclass(frozen=True)
class Scale:
    """Factors between the numbers of two scenes in d dimensions: of length, mass, time, and of units of their own."""

    d: int
    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0
    of_unit: Units = UNITS["lj"]
    in_unit: Units = UNITS["lj"]

    @classmethod
    def of_size(cls, factor: float, d: int) -> Scale:
        """Return the scale of another size with the same densities and velocities."""
        return cls(d, factor, factor**d, factor)

    @classmethod
    def of_units(cls, one: Units, other: Units, d: int) -> Scale:
        """Return the scale of another system of units."""
        return cls(d, one.length / other.length, one.mass / other.mass, one.time / other.time, one, other)

    def of(self, quantity: str) -> float:
        """Return the factor of a quantity."""
        length, mass, time, volume = named(quantity).dimension
        made = self.length ** (length + self.d * volume) * self.mass**mass * self.time**time
        return float(made * (self.of_unit.of(quantity) / self.in_unit.of(quantity)))

    def scaled(self, number: float, powers: Powers) -> float:
        """Return a number of a scene, which is a product of powers of quantities, times its factor."""
        for quantity, power in powers:
            # A division rounds once.
            number = number / self.of(quantity) if power == -1 else number * self.of(quantity) ** power
        return number


@dataclass(frozen=True)
class Twin:
    """Two scenes with their particles that pose the same problem, and the map from the second back to the first.

    Attributes
    ----------
    scene, atoms : the original; its positions and velocities lie on a grid if the twin's differ
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
        """Return whether the two are the same to the reference: only settings of LAMMPS differ."""
        return self.kind in ("newton", "skin", "rebuild", "split", "ranks")

    @property
    def rounds_input(self) -> bool:
        """Return whether the twin's numbers are rounded, as no factor is a power of two."""
        return self.kind == "units"

    def back(self, snapshot: Fields, step: int) -> Fields:
        """Return the fields of the twin in the original's frame, where both should be equal."""
        fields = self.in_place(snapshot)
        for field, added_c in self._added(step).items():
            if field in fields and added_c.any():
                fields[field] = fields[field] - added_c
        return fields

    def in_place(self, fields: Fields) -> Fields:
        """Return the fields of the twin in the original's order and units; applies to bounds too."""
        return {name: array[self.row_n] / self.scale.of(name) for name, array in fields.items()}

    def rounding(self, returned: Fields, step: int) -> Fields:
        """Return the largest rounding error of `back`: of displacement and difference, and of a period added later."""
        atoms, d, errors = self.atoms, self.scene.dimension, {}
        for field, added_c in self._added(step).items():
            if field in returned and added_c.any():
                period_c = (atoms.high_c - atoms.low_c)[:d] if field == "x" else 0.0
                errors[field] = 2 * UNIT * (np.abs(returned[field]) + np.abs(added_c) + period_c)
        return errors

    def _added(self, step: int) -> dict[str, FloatArray]:
        time = step * self.scene.evolve.timestep if self.scene.evolve else 0.0
        return {"x": self.displacement_c + time * self.velocity_c, "v": self.velocity_c}


def describe(settings: TwinSettings) -> str:
    """Return in one line what the second run is, and why it must give the same."""
    (given,) = settings.model_dump(mode="json", exclude_none=True).values()
    return f"{settings.kind} {flow(given)}: {WHY[settings.kind]}"


def make(case: Case, atoms: Atoms) -> Twin:
    """Return the twin of a case.

    Raises
    ------
    InputError
        A displacement that moves particles out of the box, or that no double can represent.
    """
    scene, settings = case.scene, case.scene.twin
    assert settings is not None
    n, d, kind = len(atoms), scene.dimension, settings.kind
    nowhere_c = np.zeros(d)
    unscaled = Scale(d)
    same = Twin(kind, scene, atoms, scene, atoms, scene.snapshots, np.arange(n), unscaled, nowhere_c, nowhere_c)
    if settings.translate is not None:
        return _translated(same, settings.translate, case.where)
    if settings.boost is not None:
        return _boosted(same, settings.boost)
    if settings.tilt is not None:
        return _tilted(same, settings.tilt)
    if settings.relabel is not None:
        return _relabelled(same, case.name)
    if settings.rescale is not None:
        return _rescaled(same, Scale.of_size(settings.rescale, d))
    if settings.units is not None:
        return _rescaled(same, Scale.of_units(UNITS[scene.units], UNITS[settings.units], d), units=settings.units)
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
    moved_nc, turned_nc = _wrapped(x_nc + by_c, atoms.box(d))
    outside = np.flatnonzero(((moved_nc < low_c) | (moved_nc > high_c) | ((moved_nc == high_c) & periodic)).any(axis=1))
    if outside.size:
        rule = "must leave particles in the box along axes that are not periodic"
        raise InputError("twin.translate", rule, tuple(by), f"{where}, atom {outside[0] + 1}")
    if ((moved_nc.astype(np.longdouble) + turned_nc) - by_c != x_nc).any():
        raise InputError("twin.translate", "no double holds the moved positions exactly", tuple(by), where)
    original, other = (replace(atoms, x_nc=_with_plane(array_nc, atoms.x_nc)) for array_nc in (x_nc, moved_nc))
    return replace(same, atoms=original, other_atoms=other, displacement_c=by_c)


def _wrapped(x_nc: FloatArray, box: Box) -> tuple[FloatArray, FloatArray]:
    """Return positions moved into a box, and by what, both (n, d)."""
    turned_nc = box.shift(box.images(x_nc))
    return x_nc - turned_nc, turned_nc


def _tilted(same: Twin, by: Sequence[int]) -> Twin:
    """Return the twin whose edges lean by additional whole edges, which lie on the grid of the positions."""
    d, atoms = same.scene.dimension, same.atoms
    box = atoms.box(d)
    tilt = np.resize(box.tilt or 0.0, len(by))
    x_nc, numbers = gridded(atoms.x_nc[:, :d], np.array([*box.low_c, *box.high_c, *tilt]))
    low_c, high_c = (
        _with_plane(ends[None], full_c[None])[0]
        for ends, full_c in zip(np.split(numbers[: 2 * d], 2), (atoms.low_c, atoms.high_c), strict=True)
    )
    (lx, ly, _), (xy, xz, yz) = high_c - low_c, (*numbers[2 * d :], 0.0, 0.0)[:3]
    by_xy, by_xz, by_yz = (*by, 0, 0)[:3]
    leaning = (xy + by_xy * lx, xz + by_xz * lx + by_yz * xy, yz + by_yz * ly)
    original, other = (replace(atoms, low_c=low_c, high_c=high_c, tilt=tilt) for tilt in ((xy, xz, yz), leaning))
    original, other = (replace(a, x_nc=_with_plane(_wrapped(x_nc, a.box(d))[0], atoms.x_nc)) for a in (original, other))
    return replace(same, atoms=original, other_atoms=other)


def _boosted(same: Twin, by: Sequence[float]) -> Twin:
    d, atoms = same.scene.dimension, same.atoms
    full_nc = np.zeros(atoms.x_nc.shape) if atoms.v_nc is None else atoms.v_nc
    v_nc, by_c = gridded(full_nc[:, :d], np.array(by))
    original, other = (replace(atoms, v_nc=_with_plane(array_nc, full_nc)) for array_nc in (v_nc, v_nc + by_c))
    return replace(same, atoms=original, other_atoms=other, velocity_c=by_c)


def _with_plane(array_nc: FloatArray, full_nc: FloatArray) -> FloatArray:
    """Return all three axes, with those of the scene replaced."""
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


# --- another size, other units


def _rescaled(same: Twin, scale: Scale, **update: Any) -> Twin:
    other = rescaled(same.scene, scale, kernel_cut(same.scene, same.atoms.spacing)).model_copy(update=update)
    return replace(same, other_scene=other, other_atoms=rescaled_atoms(same.atoms, scale), scale=scale)


def rescaled(scene: Scene, scale: Scale, cut: float) -> Scene:
    """Return a scene in other numbers: every parameter times its factor; temperatures stay.

    The extra repulsion of reconstructed walls (NUMERICS.md, section 5) has the dimension of a force in 3D only, and the
    normal of a surface contains a constant that does not scale (1e-10; NUMERICS.md, section 4).
    """
    given = scene.model_copy(update={"rheo": scene.rheo.model_copy(update={"cut": cut})})
    return changed(given, lambda _, value, powers: scale.scaled(value, powers))


def rescaled_atoms(atoms: Atoms, scale: Scale) -> Atoms:
    """Return the particles in other numbers."""
    length = scale.of("x")
    return replace(
        atoms,
        x_nc=atoms.x_nc * length,
        low_c=atoms.low_c * length,
        high_c=atoms.high_c * length,
        tilt=(atoms.tilt[0] * length, atoms.tilt[1] * length, atoms.tilt[2] * length),
        spacing=atoms.spacing * length,
        mass_n=atoms.mass_n * scale.of("mass"),
        v_nc=None if atoms.v_nc is None else atoms.v_nc * scale.of("v"),
        rho_n=None if atoms.rho_n is None else atoms.rho_n * scale.of("rho"),
        energy_n=None if atoms.energy_n is None else atoms.energy_n * scale.of("energy"),
    )
