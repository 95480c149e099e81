"""Particles of a scene: positions, types and fields as arrays, the same doubles for LAMMPS and the reference."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import Box, EOSTable, InputError
from eos_ref.eos.table import FloatArray
from lammps_cases.records.files import MIB, read_text
from lammps_cases.scene import FromData, FromDump, FromFile, FromXYZ, Lattice, Listed, Scene, Values
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.complaints import Source
from lammps_cases.scene.particles import ValueTable

LARGEST_TABLE = 512 * MIB
IntArray = npt.NDArray[np.integer]
# Basis of each lattice in units of its cell; the cell of hex is 1 x sqrt(3).
_BASIS: dict[str, tuple[tuple[float, ...], ...]] = {
    "sq": ((0.0, 0.0),),
    "hex": ((0.0, 0.0), (0.5, 0.5)),
    "sc": ((0.0, 0.0, 0.0),),
    "bcc": ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5)),
    "fcc": ((0.0, 0.0, 0.0), (0.0, 0.5, 0.5), (0.5, 0.0, 0.5), (0.5, 0.5, 0.0)),
}


@dataclass(frozen=True)
class Atoms:
    """Particles sorted by id; ``energy_n`` is that of the whole particle, as LAMMPS stores it.

    ``rho_n`` is None where LAMMPS sums the density. ``periodic`` holds one flag per axis, ``tilt`` xy, xz and yz.
    """

    id_n: IntArray
    type_n: IntArray
    x_nc: FloatArray
    mass_n: FloatArray
    low_c: FloatArray
    high_c: FloatArray
    periodic: tuple[bool, bool, bool]
    spacing: float
    v_nc: FloatArray | None = None
    rho_n: FloatArray | None = None
    energy_n: FloatArray | None = None
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __len__(self) -> int:
        return len(self.id_n)

    def within(self, box: Box) -> Atoms:
        """Return the same particles in another box along some axes."""
        d = len(box.low_c)
        low_c, high_c = np.array([*box.low_c, *self.low_c[d:]]), np.array([*box.high_c, *self.high_c[d:]])
        xy, xz, yz = (*box.tilt, 0.0, 0.0, 0.0)[:3]
        return replace(self, low_c=low_c, high_c=high_c, tilt=(xy, xz, yz))

    def box(self, dimension: int = 3) -> Box:
        """Return the box along some axes."""
        tilt = self.tilt[: dimension * (dimension - 1) // 2]
        low_c, high_c = (tuple(end_c[:dimension].tolist()) for end_c in (self.low_c, self.high_c))
        return Box(low_c, high_c, self.periodic[:dimension], tilt if any(tilt) else ())


def seed(name: str) -> int:
    """Return the seed of a case: 64 bits of the SHA-256 of its name."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")


def _random(case: Case, purpose: str) -> np.random.Generator:
    return np.random.default_rng(seed(f"{case.name}/{purpose}"))


def build(case: Case, eos: EOSTable | None) -> Atoms:
    """Return the particles of a case.

    Parameters
    ----------
    eos : EOSTable or None
        The reference's laws, whose domain must contain the densities; None for a scene that LAMMPS is expected to
        refuse.

    Raises
    ------
    InputError
        An unreadable file, a field of the wrong length, or a density at which a law is not defined.
    """
    try:
        return _build(case, eos)
    except InputError as error:
        source = case.source.name
        if case.source.is_file():
            source = Source(case.source).key(error.key, case.labels)
        where = ", ".join(filter(None, (source, f"case {case.name}", error.where)))
        raise InputError(error.what, error.rule, error.found, where, error.key) from None


def _build(case: Case, eos: EOSTable | None) -> Atoms:
    scene = case.scene
    if isinstance(scene.positions, Lattice):
        file = _lattice(case, scene.positions)
    elif isinstance(scene.positions, Listed):
        file = _listed(scene.positions, scene.dimension)
    else:
        file = _from_file(case, scene.positions)
    x_nc, low_c, high_c, periodic, spacing = (file[k] for k in ("x", "low", "high", "periodic", "spacing"))
    n = len(x_nc)
    type_n = file["type"] if "type" in file else _deal(case, n, range(1, len(scene.types) + 1))
    wrong = type_n[(type_n < 1) | (type_n > len(scene.types))]
    if wrong.size:
        raise InputError("type", f"must lie within 1 to {len(scene.types)}", int(wrong[0]), key="positions")
    mass_n = np.array([t.mass for t in scene.types])[type_n - 1]
    if scene.mass:
        mass_n = _field(case, "mass", scene.mass, type_n, mass_n)
    rho0_n = np.array(scene.rho0 or [1.0] * len(scene.types))[type_n - 1]
    rho_n = _field(case, "rho", scene.rho, type_n, rho0_n) if scene.rho else file.get("rho")
    e_n = _field(case, "energy", scene.energy, type_n, rho0_n) if scene.energy else file.get("e")
    energy_n = file.get("energy") if e_n is None else mass_n * e_n
    e_n = energy_n / mass_n if e_n is None and energy_n is not None else e_n
    bad = np.flatnonzero(~(np.isfinite(mass_n) & (mass_n > 0)))
    if bad.size:
        raise InputError("mass", "must be positive", float(mass_n[bad[0]]), f"atom {bad[0] + 1}")
    _check_fields(case, eos, type_n, rho_n, e_n)
    v_nc = _velocities(case, type_n, file.get("v"))
    atoms = Atoms(np.arange(1, n + 1), type_n, x_nc, mass_n, low_c, high_c, periodic, spacing, v_nc, rho_n, energy_n)
    if tilt := file.get("tilt"):
        if isinstance(scene.positions, FromFile):
            _check_tilt_of_file(case, tilt)
        atoms = replace(atoms, tilt=(*tilt, *(0.0,) * (3 - len(tilt))))
        if isinstance(scene.positions, Lattice):  # it fills the upright box
            atoms = replace(atoms, x_nc=x_nc - atoms.box().shift(atoms.box().images(x_nc)))
    if scene.interacts:
        _check_positions(case, atoms)
    return atoms


def _lattice(case: Case, lattice: Lattice) -> dict[str, Any]:
    """Return the particles of a lattice as of a file: x, low, high, periodic, spacing, tilt and, with regions, type."""
    dimension, spacing = case.scene.dimension, lattice.spacing
    x_nc, high_c = _sites(lattice, dimension)
    type_n = _region_types(case, lattice, x_nc[:, :dimension] / high_c[:dimension]) if lattice.regions else None
    periodic = (*(lattice.periodic or (True,) * dimension), *(True,) * (3 - dimension))
    if lattice.disorder:
        moved = _random(case, "positions").uniform(-1, 1, (len(x_nc), dimension)) * lattice.disorder * spacing
        x_nc[:, :dimension] += moved
        around_c = np.array(periodic) & (np.arange(3) < dimension)
        x_nc[:, around_c] = np.mod(x_nc[:, around_c], high_c[around_c])
    margin_c = np.where(periodic, 0.0, lattice.margin * spacing)
    low_c, high_c = 0.0 - margin_c, high_c + margin_c
    if dimension == 2:
        low_c[2], high_c[2] = -spacing / 2, spacing / 2
    box = {"low": low_c, "high": high_c, "periodic": periodic, "spacing": spacing, "tilt": lattice.tilt}
    if type_n is None:
        return {"x": x_nc, **box}
    return {"x": x_nc[type_n > 0], "type": type_n[type_n > 0], **box}


def _listed(listed: Listed, dimension: int) -> dict[str, Any]:
    """Return the particles of a list as of a file: x, type, low, high, periodic, spacing, tilt."""
    n, depth = len(listed.x), listed.spacing / 2
    x_nc, low_c, high_c = np.zeros((n, 3)), np.full(3, -depth), np.full(3, depth)
    x_nc[:, :dimension], low_c[:dimension], high_c[:dimension] = listed.x, listed.low, listed.high
    return {
        "x": x_nc,
        "type": np.array(listed.types or (1,) * n),
        "low": low_c,
        "high": high_c,
        "periodic": (*(listed.periodic or (True,) * dimension), *(True,) * (3 - dimension)),
        "spacing": listed.spacing,
        "tilt": listed.tilt,
    }


def _region_types(case: Case, lattice: Lattice, place_nc: FloatArray) -> IntArray:
    """Return the types of all sites, given in fractions of the lattice; 0 where there is no particle.

    Types named by no region are dealt out to the sites in no region (type 1 if no type is left).
    """
    type_n = np.full(len(place_nc), -1)
    for region in lattice.regions:
        inside_n = np.all((place_nc >= region.low) & (place_nc < region.high), axis=1)
        if not inside_n.any():
            corners = f"low {list(region.low)} and high {list(region.high)}"
            raise InputError("positions", f"{corners} enclose no site; they are fractions of the lattice")
        type_n[inside_n] = region.type or 0
    if not (type_n != 0).any():
        raise InputError("positions", "the scene is empty: its regions remove every particle")
    named = {region.type for region in lattice.regions}
    rest = [t for t in range(1, len(case.scene.types) + 1) if t not in named] or [1]
    free = int((type_n < 0).sum())
    type_n[type_n < 0] = _deal(case, free, rest)
    return type_n


def _velocities(case: Case, type_n: IntArray, of_file_nc: FloatArray | None) -> FloatArray | None:
    scene = case.scene
    if scene.velocity.values is not None:
        v_nc = np.zeros((len(type_n), 3))
        given = np.array(scene.velocity.values)
        v_nc[:, : scene.dimension] = _one_per_particle(given, len(type_n), "velocity")
        return v_nc
    moves = scene.velocity.random or scene.velocity.uniform or any(t.velocity for t in scene.types)
    if not moves:
        return of_file_nc
    v_nc = _random(case, "velocity").uniform(-1, 1, (len(type_n), 3)) * scene.velocity.random
    for t, atom_type in enumerate(scene.types, 1):
        of_type = type_n == t
        if atom_type.phase == "solid":
            v_nc[of_type] = 0.0
        v_nc[of_type, : scene.dimension] += np.array(atom_type.velocity or scene.velocity.uniform or 0.0)
    v_nc[:, scene.dimension :] = 0.0
    return v_nc


def _check_positions(case: Case, atoms: Atoms) -> None:
    """Check that interacting particles lie in the box, and not on top of one another."""
    x_nc, low_c, high_c, periodic = atoms.x_nc, atoms.low_c, atoms.high_c, atoms.periodic
    outside = np.flatnonzero(atoms.box().outside(x_nc))
    if outside.size:
        place = f"atom {outside[0] + 1}"
        raise InputError("position", "must lie in the box (margin)", x_nc[outside[0]].tolist(), place, "positions")
    wrapped_nc = np.where((x_nc == high_c) & np.array(periodic), low_c, x_nc)
    order_n = np.lexsort(wrapped_nc.T)
    same = np.flatnonzero((wrapped_nc[order_n[1:]] == wrapped_nc[order_n[:-1]]).all(axis=1))
    if same.size:
        one, other = sorted((order_n[same[0]] + 1, order_n[same[0] + 1] + 1))
        rule = f"of atom {other} must differ from that of atom {one}"
        raise InputError("position", rule, x_nc[one - 1].tolist(), key="positions")


def _sites(lattice: Lattice, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Return the sites of a lattice with one corner at 0, and the opposite corner."""
    basis_bc = np.array(_BASIS[lattice.lattice])
    cell_c = np.ones(dimension)
    if lattice.lattice == "hex":
        cell_c[1] = np.sqrt(3.0)
    axes = np.meshgrid(*(np.arange(k) for k in lattice.cells), indexing="ij")
    corner_nc = np.stack([axis.ravel() for axis in axes], axis=1)
    with np.errstate(over="ignore"):
        high_c = np.array(lattice.cells) * cell_c * lattice.spacing
    if not np.isfinite(high_c).all():
        raise InputError("spacing", "must leave the box finite", lattice.spacing, key="positions")
    x_nc = ((corner_nc[:, None, :] + basis_bc[None, :, :] + 0.25) * cell_c * lattice.spacing).reshape(-1, dimension)
    padding = np.zeros((len(x_nc), 3 - dimension))
    return np.hstack([x_nc, padding]), np.concatenate([high_c, np.zeros(3 - dimension)])


def _deal(case: Case, n: int, types: Sequence[int]) -> IntArray:
    type_n = np.array(types)[np.arange(n) * len(types) // max(n, 1)]
    if case.scene.arrangement == "shuffled":
        _random(case, "types").shuffle(type_n)
    return type_n


def _field(case: Case, name: str, values: Values, type_n: IntArray, unit_n: FloatArray) -> FloatArray:
    n = len(type_n)
    if values.constant is not None:
        return np.full(n, values.constant)
    if values.per_type is not None:
        return np.array(values.per_type)[type_n - 1]
    if values.values is not None:
        return _one_per_particle(np.array(values.values), n, name)
    if values.table is not None:
        return _one_per_particle(_column(case.source.parent, values.table, name), n, name)
    if values.offset is not None:
        d_n: FloatArray = np.geomspace(values.offset.low, values.offset.high, n)
        if values.offset.sign != "+":
            d_n[slice(None) if values.offset.sign == "-" else slice(1, None, 2)] *= -1
        return np.asarray(unit_n * (1 + _random(case, name).permutation(d_n)))
    low, high = values.range or values.ratio or (0.0, 0.0)
    spaced = np.geomspace(low, high, n) if values.spacing == "log" else np.linspace(low, high, n)
    dealt_n = _random(case, name).permutation(spaced)
    return np.asarray(dealt_n * unit_n if values.ratio else dealt_n)


def _one_per_particle(values_n: FloatArray, n: int, key: str) -> FloatArray:
    if len(values_n) != n:
        raise InputError("per-atom values", f"need one value per particle ({n})", len(values_n), key, key)
    return np.asarray(values_n, float)


def _column(folder: Path, table: ValueTable, key: str) -> FloatArray:
    name, column = table.csv, table.column
    try:
        text = read_text(folder / name, "table", LARGEST_TABLE)
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except (InputError, csv.Error) as error:
        rule = error.rule if isinstance(error, InputError) else f"cannot be read: {error}"
        raise InputError("table", rule, name, key, key) from None
    names = [name for name in rows[0] if name] if rows else []  # None: values beyond the last column
    if column not in names:
        raise InputError("column", f"must be one of {', '.join(names) or 'none (no rows)'}", column, key, key)
    values_n = np.empty(len(rows))
    for k, row in enumerate(rows):
        try:
            values_n[k] = float(row[column])
        except (TypeError, ValueError):
            values_n[k] = np.nan
        if not np.isfinite(values_n[k]):
            raise InputError(
                f"column {column}", "must hold finite numbers", row[column], f"{key}, line {k + 2} of {name}", key
            )
    return values_n


def _check_fields(
    case: Case, eos: EOSTable | None, type_n: IntArray, rho_n: FloatArray | None, e_n: FloatArray | None
) -> None:
    scene = case.scene
    for key, values_n in (("rho", rho_n), ("energy", e_n)):
        for k, value in enumerate(() if values_n is None or np.isfinite(values_n).all() else values_n.tolist(), 1):
            if not math.isfinite(value):
                raise InputError(key, "must be finite", value, f"atom {k}")
    if eos is None:
        return
    if scene.thermal and e_n is None:
        needing = f"{eos.style_with_energy} needs" if eos.needs_energy else "thermal properties of types need"
        raise InputError("energy", f"{needing} the energy of every particle")
    if rho_n is None and not scene.rho_sum:
        raise InputError("rho", "must be given unless rho_sum is on")
    for t, law in enumerate(eos.laws, 1):
        if rho_n is None:
            continue
        of_type = type_n == t
        bad = np.flatnonzero(of_type & ~law.is_defined(rho_n))
        if bad.size:
            rule = f"{law.style} of type {t} is defined within {law.defined.low:g} to {law.defined.high:g}"
            raise InputError("rho", rule, float(rho_n[bad[0]]), f"atom {bad[0] + 1}")
        with np.errstate(all="ignore"):
            large = np.flatnonzero(of_type)[
                ~np.isfinite(law.evaluate(rho_n[of_type], None if e_n is None else e_n[of_type]))
            ]
        if large.size:
            raise InputError(
                "rho",
                f"the pressure of {law.style} overflows",
                float(rho_n[large[0]]),
                f"atom {large[0] + 1}",
            )


def _from_file(case: Case, positions: FromXYZ | FromData | FromDump) -> dict[str, Any]:
    """Return the particles of a scene's file: x, low, high, periodic, spacing and the other arrays it holds."""
    folder, scene = case.source.parent, case.scene
    if isinstance(positions, FromXYZ):
        from lammps_cases.scene.ase_io import read_extxyz

        return read_extxyz(folder / positions.file, scene)
    from lammps_cases.scene.lammps_files import read_data, read_dump

    if isinstance(positions, FromData):
        arrays = read_data(folder / positions.file, scene, positions.periodic)
    else:
        named = positions.columns.model_dump(exclude_none=True)
        arrays = read_dump(folder / positions.file, scene, positions.step, named)
    solid_t = np.array([False, *(t.phase == "solid" for t in scene.types)])
    for k in np.flatnonzero(arrays.get("solid", False) != solid_t.take(arrays["type"], mode="clip")):
        if "solid" in arrays:
            rule = f"of type {arrays['type'][k]} must be that of the particles of the file"
            raise InputError("phase", rule, "solid" if arrays["solid"][k] else "fluid", f"atom {k + 1}")
    return arrays


def _check_tilt_of_file(case: Case, tilt: tuple[float, ...]) -> None:
    """Apply the box checks once the box is known from the file."""
    twin, evolve = case.scene.twin, case.scene.evolve
    translated = twin is not None and twin.translate is not None
    if translated or (evolve and (evolve.deform or any(stop.stretch for stop in evolve.stops))):
        raise InputError("tilt", "of a file's box goes with no translate, stretch or deform", list(tilt))


def kernel_cut(scene: Scene, spacing: float) -> float:
    """Return the cutoff of the kernel: as given, or 3 spacings."""
    return scene.rheo.cut or 3.0 * spacing
