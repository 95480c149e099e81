"""Arrays of LAMMPS: per-atom properties and computes, sorted by id, and the neighbour list of pair style rheo."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
COMPONENTS = ((0, 3, 4), (3, 1, 5), (4, 5, 2))  # of a tensor among xx, yy, zz, xy, xz, yz
NUMBER_BITS = 2**29 - 1  # of a list entry; the other bits hold how many bonds the two particles are apart


@dataclass(frozen=True)
class Compute:
    """A compute other than ``q``: a number or symmetric tensor of each atom, or a global one, which each atom gets."""

    id: str
    tensor: bool
    overall: bool


def read(
    lmp: Any,
    outputs: Mapping[str, tuple[int, ...]] | None = None,
    atom_arrays: tuple[str, ...] = (),
    computes: tuple[Compute, ...] = (),
) -> dict[str, Array]:
    """Return per-atom arrays sorted by id, copied.

    Properties of the atom style, ``q.NAME`` of compute ``q``, and other computes by their ids.
    """
    n = lmp.extract_global("nlocal")
    id_n = lmp.numpy.extract_atom("id")[:n].copy()
    order_n = np.argsort(id_n, kind="stable")
    arrays = {"id": id_n[order_n]}
    for name in atom_arrays:
        arrays[name] = lmp.numpy.extract_atom(name)[:n][order_n]
    if outputs:
        ends = np.cumsum([math.prod(shape) for shape in outputs.values()])
        table = _of_atoms(lmp, "q", int(ends[-1]), n)
        for (name, shape), end in zip(outputs.items(), ends, strict=True):
            columns = table[order_n, end - math.prod(shape) : end]
            arrays[f"q.{name}"] = columns.reshape(n, *shape)
    return arrays | {compute.id: _computed(lmp, compute, order_n) for compute in computes}


def _of_atoms(lmp: Any, compute_id: str, columns: int, n: int) -> Array:
    """Return the numbers of a compute for the atoms here, (n, columns).

    A rank without atoms has no memory to show, but takes part in the evaluation: others may wait for it.
    """
    kind = 1 if columns == 1 else 2  # LAMMPS stores a single column as a vector
    if not n:
        lmp.extract_compute(compute_id, 1, kind)
        return np.empty((0, columns))
    table: Array = lmp.numpy.extract_compute(compute_id, 1, kind)[:n].reshape(n, -1)
    return table


def _computed(lmp: Any, compute: Compute, order_n: Array) -> Array:
    """Return the numbers or tensors of a compute for atoms in an order, (n,) or (n, 3, 3)."""
    n = len(order_n)
    # LAMMPS' constants: 0 global, 1 per atom; 0 a number, 1 a vector, 2 an array.
    if not compute.overall:
        found_nf = _of_atoms(lmp, compute.id, 6, n)[order_n]
    elif compute.tensor:
        found_nf = np.tile(lmp.numpy.extract_compute(compute.id, 0, 1), (n, 1))
    else:
        return np.full(n, lmp.numpy.extract_compute(compute.id, 0, 0))
    return np.asarray(found_nf[:, COMPONENTS])


def _pairs(lmp: Any, index: int) -> Array:
    """Return the pairs of a neighbour list, (p, 2); LAMMPS stores the neighbours of many atoms contiguously.

    A separate array for each atom would take three times as long.
    """
    read = [lmp.get_neighlist_element_neighbors(index, k) for k in range(lmp.get_neighlist_size(index))]
    atom_k, count_k = np.array([of[:2] for of in read], np.int64).reshape(-1, 2).T
    at_k = np.array([ctypes.addressof(of.contents) if count else 0 for _, count, of in read], np.int64)
    atom_k, count_k, at_k = (of_k[count_k > 0] for of_k in (atom_k, count_k, at_k))
    breaks = np.flatnonzero(np.diff(at_k) != ctypes.sizeof(ctypes.c_int) * count_k[:-1]) + 1
    rows = [
        np.ctypeslib.as_array((ctypes.c_int * int(counts.sum())).from_address(int(places[0])))
        for counts, places in zip(np.split(count_k, breaks), np.split(at_k, breaks), strict=True)
        if len(counts)
    ]
    other_p = np.concatenate([np.zeros(0, np.int32), *rows]).astype(np.int64)
    return np.column_stack([np.repeat(atom_k, count_k), other_p & NUMBER_BITS])


def read_list(lmp: Any) -> dict[str, Array]:
    """Return the neighbour list of pair style rheo, copied; it counts local atoms, then ghosts.

    Returns
    -------
    dict
        ``id_s``, the id of each local or ghost atom; ``x_sc``, its position; ``own_s``, whether it is local;
        ``pair_ps``, the two atoms of every pair, counted likewise, in the order of the list; ``rank_s``, the process;
        ``low_rc``, the lower corner of its part of the box, in fractions if the box is tilted; ``newton``, the flags of
        pairs and bonds.
    """
    natoms = lmp.extract_global("nlocal") + lmp.extract_global("nghost")
    id_s = lmp.numpy.extract_atom("id", nelem=natoms).ravel()
    return {
        "id_s": id_s.copy(),
        "own_s": np.arange(natoms) < lmp.extract_global("nlocal"),
        "x_sc": lmp.numpy.extract_atom("x", nelem=natoms, dim=3).copy(),
        "pair_ps": _pairs(lmp, lmp.find_pair_neighlist("rheo")),
        "rank_s": np.zeros(natoms, int),
        "low_rc": np.array([lmp.extract_global("sublo_lambda" if lmp.extract_setting("triclinic") else "sublo")]),
        "newton": np.array([lmp.extract_setting(f"newton_{of}") for of in ("pair", "bond")], bool),
    }
