"""Arrays of all atoms: LAMMPS' own memory on one rank; on several, LAMMPS gathers them, and every rank gets all.

All ranks call these functions, in the same order: they follow the same commands and take the same samples.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
_ROW = 3  # numbers of a row of a two-dimensional property
_GATHERED = {0: (0, 1), 2: (1, 1), 3: (1, _ROW)}  # by extract_atom_datatype: what gather_concat takes, and columns


def ranks(lmp: Any) -> int:
    """Return the number of ranks."""
    return int(lmp.extract_setting("world_size"))


def ids(lmp: Any) -> Array:
    """Return the ids of all atoms, (n,), rank by rank."""
    if ranks(lmp) == 1:
        id_n: Array = lmp.numpy.extract_atom("id")[: lmp.extract_setting("nlocal")]
        return id_n
    id_n = _gathered(lmp, "id")
    return id_n[: np.count_nonzero(id_n)]  # behind them 0, for atoms that are lost and still counted


def atoms(lmp: Any, name: str, n: int) -> Array:
    """Return a property of all n atoms by extract_atom's name, (n,) or (n, 3), in the order of `ids`."""
    found: Array = lmp.numpy.extract_atom(name) if ranks(lmp) == 1 else _gathered(lmp, name)
    return found[:n]


def compute(lmp: Any, name: str, columns: int, n: int) -> Array:
    """Return what a compute of at least two columns has for all n atoms, (n, columns)."""
    if ranks(lmp) == 1:
        table: Array = lmp.numpy.extract_compute(name, 1, 2)
    else:
        table = np.ctypeslib.as_array(lmp.gather_concat(f"c_{name}", 1, columns)).reshape(-1, columns)
    return table[:n]


def members(lmp: Any, group: str, n: int) -> npt.NDArray[np.bool_]:
    """Return which of all n atoms are in a group now, (n,)."""
    bit = lmp.available_ids("group").index(group)
    in_n: npt.NDArray[np.bool_] = atoms(lmp, "mask", n) >> bit & 1 != 0
    return in_n


def _gathered(lmp: Any, name: str) -> Array:
    kind, columns = _GATHERED[lmp.extract_atom_datatype(name)]
    found = np.ctypeslib.as_array(lmp.gather_concat(name, kind, columns))
    return found.reshape(-1, columns) if columns == _ROW else found
