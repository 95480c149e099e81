"""Reading the per-atom arrays of a run."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.errors import InputError
from lammps_cases.comparison.compare import excess, worst_component

_PREFIX = 10  # bytes before the header of an .npy file of version 1: magic, version, length of the header


def read_arrays(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read all arrays of an npz file that `files.write_arrays` wrote; they are read-only.

    As np.load, in half the time: that parses the header of every array as Python source, and a run has a thousand
    arrays with a dozen different headers.

    Raises
    ------
    InputError
        The file is damaged.
    """
    try:
        return _read(path)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError("per-atom arrays", f"cannot be read: {error}", where=str(path)) from None


def one_per_atom(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Let the component closest to its bound stand for every vector and tensor of a compared field."""
    reduced = dict(arrays)
    for name in arrays:
        field, _, side = name.rpartition(".")
        sides = [f"{field}.{of}" for of in ("lammps", "reference", "bound")]
        if side != "lammps" or arrays[name].ndim == 1 or not all(of in arrays for of in sides):
            continue
        lammps_n, reference_n, bound_n = (np.asarray(arrays[of], float) for of in sides)
        ratio_n = excess(lammps_n, reference_n, bound_n)[1]
        for of, values_n in zip(sides, (lammps_n, reference_n, bound_n), strict=True):
            reduced[of] = worst_component(values_n, ratio_n)
    return reduced


def _read(path: Path) -> dict[str, npt.NDArray[Any]]:
    arrays = {}
    with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
        for name in archive.namelist():
            raw = archive.read(name)
            start = _PREFIX + int.from_bytes(raw[8:_PREFIX], "little")
            shape, fortran, dtype = _header(raw[:start])
            values = np.frombuffer(raw, dtype, offset=start)
            arrays[name.removesuffix(".npy")] = values.reshape(shape, order="F" if fortran else "C")
    return arrays


@lru_cache(maxsize=256)
def _header(raw: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    stream = io.BytesIO(raw)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("not an array of npy format 1.0")
    return np.lib.format.read_array_header_1_0(stream)
