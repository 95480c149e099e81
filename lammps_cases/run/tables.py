"""Runs as pandas tables, for notebooks."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from lammps_cases.records.files import read_arrays
from lammps_cases.records.run_record import read_run

if TYPE_CHECKING:
    import pandas as pd


def fields(run: str | Path) -> pd.DataFrame:
    """Tabulate the compared fields of a report folder: case, field, stage, verdict, errors, digits lost.

    Raises
    ------
    InputError
        The folder holds no run.
    """
    import pandas as pd

    rows = [
        {
            "case": case.case,
            "units": case.units,
            "natoms": case.natoms,
            **field.model_dump(include={"field", "stage", "verdict", "max_abs", "max_over_bound", "bound", "worst_id"}),
            "digits_lost_lammps": field.digits_lost.lammps,
            "digits_lost_reference": field.digits_lost.reference,
        }
        for case in read_run(Path(run)).cases
        for field in case.fields
    ]
    return pd.DataFrame(rows)


def particles(run: str | Path, case: str) -> pd.DataFrame:
    """Tabulate the particles of a case: id, type, position, density and both sides of every compared field.

    Components of vectors and tensors have columns of their own: ``f/x.lammps``, ``grad/v/xy.bound``.
    """
    import pandas as pd

    arrays = read_arrays(Path(run) / "fields" / f"{case}.npz")
    columns: dict[str, npt.NDArray[Any]] = {}
    for name in arrays:
        if name not in ("box", "x"):
            columns |= _columns(name, arrays[name])
    columns |= dict(zip("xyz", arrays["x"].T, strict=True))
    return pd.DataFrame(columns).sort_values("id", ignore_index=True)


def _columns(name: str, values: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    if values.ndim == 1:
        return {name: values}
    field, dot, side = name.rpartition(".")
    axes = itertools.product("xyz"[: values.shape[1]], repeat=values.ndim - 1)
    parts = values.reshape(len(values), -1).T
    return {f"{field}/{''.join(axis)}{dot}{side}": part for axis, part in zip(axes, parts, strict=True)}
