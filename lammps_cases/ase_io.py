"""ASE in and out: extended XYZ files as scenes, pressures of an `ase.Atoms`, results as an `ase.Atoms`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eos_ref import EOSTable, InputError
from eos_ref.eos import FloatArray
from lammps_cases.scene import Scene

if TYPE_CHECKING:
    import ase


def pressures(atoms: ase.Atoms, eos: EOSTable) -> FloatArray:
    """Pressure of every particle of an `ase.Atoms`.

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
    """The particles of a case (its ``fields/CASE.npz``) as an `ase.Atoms`, all fields as per-atom arrays.

    Types become chemical symbols in the order H, He, ... for viewers; the array ``type`` keeps the numbers.
    """
    import ase

    low_c, high_c = arrays["box"]
    atoms = ase.Atoms(numbers=arrays["type"], positions=arrays["x"], cell=high_c - low_c, pbc=True)
    for name in sorted(arrays):
        if name not in ("box", "x"):
            atoms.set_array(name.replace(".", "_"), np.asarray(arrays[name]))
    return atoms


def read_extxyz(path: Path, scene: Scene, where: str) -> dict[str, Any]:
    """Particles of an extended XYZ file: x, low, high, periodic, spacing and, if present, type, rho, e.

    Raises
    ------
    InputError
        Unreadable, truncated, empty, without an orthogonal cell, or with particles outside of it.
    """
    import ase.io

    if not path.is_file():
        raise InputError("extxyz", "no such file", path.name, where)
    try:
        atoms: Any = ase.io.read(path, index=0, format="extxyz")
    except Exception as error:  # ASE raises many kinds for a broken file
        raise InputError("extxyz", f"cannot be read: {error or type(error).__name__}", path.name, where) from None
    if len(atoms) == 0:
        raise InputError("extxyz", "the scene is empty: needs at least one particle", path.name, where)
    cell_cc = atoms.cell.array
    high_c = np.diag(cell_cc).copy()
    if np.any(cell_cc != np.diag(high_c)) or np.any(high_c[: scene.dimension] <= 0):
        raise InputError("Lattice", "must be orthogonal with positive edges", cell_cc.tolist(), f"{where}, {path.name}")
    low_c = np.zeros(3)
    x_nc = np.array(atoms.positions, float)
    if scene.dimension == 2:
        low_c[2], high_c[2] = -0.5, 0.5
    if not np.isfinite(x_nc).all() or np.any(x_nc < low_c) or np.any(x_nc >= high_c):
        bad = int(np.flatnonzero(~np.all((x_nc >= low_c) & (x_nc < high_c), axis=1))[0])
        raise InputError(
            "position",
            "must lie within the cell",
            x_nc[bad].tolist(),
            f"{where}, {path.name}, atom {bad + 1}",
        )
    volume = float(np.prod((high_c - low_c)[: scene.dimension]))
    found = {
        "x": x_nc,
        "low": low_c,
        "high": high_c,
        "periodic": tuple(bool(p) or (c == 2 and scene.dimension == 2) for c, p in enumerate(atoms.pbc)),
        "spacing": (volume / len(atoms)) ** (1 / scene.dimension),
    }
    for name in ("type", "rho", "e"):
        if name in atoms.arrays:
            found[name] = np.asarray(atoms.arrays[name], int if name == "type" else float)
    return found
