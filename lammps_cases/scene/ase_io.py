"""Conversion from and to ASE: extended XYZ files as scenes, pressures of an `ase.Atoms`, results as an `ase.Atoms`."""

from __future__ import annotations

import hashlib
import io
import re
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eos_ref import EOSTable, InputError
from eos_ref.cache import cache_folder
from eos_ref.eos.table import FloatArray
from lammps_cases.records.files import MIB, read_bytes, write_arrays
from lammps_cases.scene import Scene

if TYPE_CHECKING:
    import ase

LARGEST = 512 * MIB


def pressures(atoms: ase.Atoms, eos: EOSTable) -> FloatArray:
    """Return the pressure of every particle of an `ase.Atoms`.

    Parameters
    ----------
    atoms : ase.Atoms
        With the per-atom array ``rho`` (density), optionally ``type`` (1 to N, default 1) and ``e`` (internal energy
        per unit mass).
    eos : EOSTable
        The laws of all types.

    Returns
    -------
    ndarray of float64, (n,)

    Raises
    ------
    InputError
        An array is missing or of the wrong kind.
    """
    if "rho" not in atoms.arrays:
        raise InputError("Atoms", "needs the per-atom array rho", sorted(atoms.arrays))
    type_n = atoms.arrays.get("type", np.ones(len(atoms), int))
    return eos.pressure(atoms.arrays["rho"], type_n, atoms.arrays.get("e"))


def as_atoms(arrays: dict[str, Any]) -> ase.Atoms:
    """Return the particles of a case (its ``fields/CASE.npz``) as an `ase.Atoms`, all fields as per-atom arrays.

    Types become chemical symbols in the order H, He, ... for viewers; the array ``type`` keeps the numbers. Arrays are
    named and shaped so that extended XYZ takes them: ``grad_v_lammps`` (n, 4) of ``grad/v.lammps`` (n, 2, 2), row by
    row. The corner of the box, which an `ase.Atoms` lacks, is ``info["Origin"]``. Velocities and masses are in the
    units of the scene, like everything else.
    """
    import ase

    low_c, high_c, *tilt = arrays["box"]
    (lx, ly, lz), (xy, xz, yz) = high_c - low_c, tilt[0] if tilt else (0.0, 0.0, 0.0)
    cell = [[lx, 0.0, 0.0], [xy, ly, 0.0], [xz, yz, lz]]
    atoms = ase.Atoms(numbers=arrays["type"], positions=arrays["x"], cell=cell, pbc=arrays.get("periodic", True))
    atoms.info["Origin"] = np.asarray(low_c)
    if "mass" in arrays:  # a run of an earlier version has neither
        atoms.set_masses(arrays["mass"])
        atoms.set_velocities(arrays["v"])
        atoms.set_array("velo", np.asarray(arrays["v"]))  # OVITO's name of velocities in extended XYZ
    for name in sorted(arrays):
        values = np.asarray(arrays[name])
        if name not in ("box", "x", "v", "mass", "periodic", "step"):
            shape = values.shape if values.ndim < 3 else (len(values), -1)
            atoms.set_array(re.sub(r"[^A-Za-z0-9]+", "_", name), values.reshape(shape))
    return atoms


def read_extxyz(path: Path, scene: Scene) -> dict[str, Any]:
    """Return the particles of an extended XYZ file: x, low, high, periodic, spacing and, if present, type, rho, e.

    Raises
    ------
    InputError
        Unreadable, truncated, empty, without an orthogonal cell, or with particles outside it.
    """
    arrays = _arrays(path)
    x_nc, cell_cc, place = arrays["positions"], arrays["cell"], path.name
    if len(x_nc) == 0:
        raise InputError("extxyz", "the scene is empty: needs at least one particle", path.name)
    low_c, high_c = np.zeros(3), np.diag(cell_cc).copy()
    if not np.isfinite(cell_cc).all() or np.any(cell_cc != np.diag(high_c)) or np.any(high_c[: scene.dimension] <= 0):
        raise InputError("Lattice", "must be orthogonal with positive, finite edges", cell_cc.tolist(), place)
    if scene.dimension == 2:
        low_c[2], high_c[2] = -0.5, 0.5
    inside_n = np.all((x_nc >= low_c) & (x_nc < high_c), axis=1)
    if not inside_n.all():
        bad = int(np.flatnonzero(~inside_n)[0])
        raise InputError(
            "position", "must lie within the cell", x_nc[bad].tolist(), f"{place}, atom {bad + 1}", "positions"
        )
    for name in ("rho", "e"):
        for bad in np.flatnonzero(~np.isfinite(arrays.get(name, 0.0))).tolist():
            found = float(arrays[name][bad])
            raise InputError(
                f"column {name}", "must hold finite numbers", found, f"{place}, atom {bad + 1}", "positions"
            )
    volume = float(np.prod((high_c - low_c)[: scene.dimension]))
    return {
        "x": x_nc,
        "low": low_c,
        "high": high_c,
        "periodic": tuple(bool(p) or (c == 2 and scene.dimension == 2) for c, p in enumerate(arrays["pbc"])),
        "spacing": (volume / len(x_nc)) ** (1 / scene.dimension),
        **{name: arrays[name] for name in ("type", "rho", "e") if name in arrays},
    }


def _arrays(path: Path) -> dict[str, Any]:
    """Return a file's arrays as ASE reads them, cached by content: importing ASE takes longer than most scenes."""
    try:
        content = read_bytes(path, "extxyz", LARGEST)
    except InputError as error:
        raise InputError("extxyz", error.rule, path.name) from None
    digest = hashlib.sha256(content + Path(__file__).read_bytes() + version("ase").encode()).hexdigest()
    cached = cache_folder("extxyz") / f"{digest}.npz"
    if not cached.exists():
        write_arrays(cached, _read_with_ase(content, path))
    try:
        with np.load(cached) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):  # a damaged cache: make it again
        return _read_with_ase(content, path)


def _read_with_ase(content: bytes, path: Path) -> dict[str, Any]:
    import ase.io

    try:
        text = content.decode("utf-8")
        if int(text.partition("\n")[0]) > text.count("\n"):  # ASE would read that many lines
            raise ValueError("it ends before the particles that its first line counts")
        atoms: Any = ase.io.read(io.StringIO(text), index=0, format="extxyz")
        arrays = {"positions": np.array(atoms.positions, float), "cell": atoms.cell.array, "pbc": np.asarray(atoms.pbc)}
        for name, kind in (("type", int), ("rho", float), ("e", float)):
            if name in atoms.arrays:
                with np.errstate(invalid="ignore"):  # from a type that is NaN
                    arrays[name] = np.asarray(atoms.arrays[name]).astype(kind)
                if arrays[name].ndim != 1:
                    raise ValueError(f"{name} must hold one number per particle")
        for bad in np.flatnonzero(arrays.get("type", 0) != atoms.arrays.get("type", 0)):
            found = atoms.arrays["type"][bad]
            raise ValueError(f"column type must hold whole numbers, found {found} for atom {bad + 1}")
    except Exception as error:  # ASE raises many kinds for a broken file
        raise InputError("extxyz", f"cannot be read: {str(error) or type(error).__name__}", path.name) from None
    return arrays
