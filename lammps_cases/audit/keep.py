"""What an audit keeps of a deck to compare later runs with: columns of two samples, and rows of thermo output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from lammps_cases.audit.pressure import PressureSample
from lammps_cases.comparison.compare import Comparison, components

STATE = ("id", "type", "x", "v", "rho", "e")
MOST = 500  # particles of a sample
CLOCKS = ("CPU", "TimeoutLeft")  # in the names of columns of thermo output that no second run has the same


def columns(now: PressureSample, others: Mapping[str, Comparison], pressure: bool) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a sample by id as `PressureSample.result`: of all particles, or of evenly spaced ones."""
    order_n = np.argsort(now.arrays["id"], kind="stable")
    n = len(order_n)
    few = order_n[np.linspace(0, n - 1, min(n, MOST)).astype(int)]
    of_few = {
        field: replace(c, lammps_n=c.lammps_n[few], reference_n=c.reference_n[few], bound_n=c.bound_n[few])
        for field, c in others.items()
        if len(c.bound_n) == n
    }
    return now.of(few).result(of_few, pressure)[0]


def take_thermo(lmp: Any, rows: list[dict[str, float]]) -> None:
    """Add the latest row of thermo output to those before it, unless it is there already."""
    latest = lmp.last_thermo()
    if latest:
        row = {name: float(value) for name, value in latest.items() if not any(clock in name for clock in CLOCKS)}
        if not rows or repr(row) != repr(rows[-1]):  # NaN is not equal to itself
            rows.append(row)


def arrays_of(kept: Mapping[int, Mapping[str, npt.NDArray[Any]]]) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of ``fields/CASE@kept.npz``: per step the state, LAMMPS' fields, and one bound for all parts.

    They are called ``STEP/NAME``, and ``STEP/FIELD.bound``; all are tables with a column per part.
    """
    arrays = {}
    for step, sample in kept.items():
        for name, values_n in sample.items():
            if name in STATE or name.endswith(".lammps"):
                arrays[f"{step}/{name.removesuffix('.lammps')}"] = components(values_n)
            elif name.endswith(".bound"):
                arrays[f"{step}/{name}"] = components(values_n).max(axis=1, initial=0.0)[:, None]
    return arrays
