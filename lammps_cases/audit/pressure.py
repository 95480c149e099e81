"""Samples of the pressure, compared type by type with the law of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOSTable
from lammps_cases.audit import gather
from lammps_cases.comparison.compare import Comparison, EosState, compare_pressure
from lammps_cases.records.case_parts import FieldRecord

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class PressureSample:
    """Atoms as LAMMPS shows them right after a force evaluation, copied, and the laws of that moment.

    Attributes
    ----------
    table : EOSTable
    box_c : (2, 3) low and high corner, and xy, xz, yz if an edge leans
    periodic : one flag per axis
    step : LAMMPS' count of steps
    arrays : per atom ``id``, ``type``, ``x``, ``v``, ``rho``, ``p``, ``mass``, and ``energy`` if a law needs it
    """

    table: EOSTable
    box_c: Array
    periodic: tuple[bool, ...]
    step: int
    arrays: Mapping[str, Array]

    def of(self, rows_n: Array) -> PressureSample:
        """Return the sample of some atoms."""
        return replace(self, arrays={name: array[rows_n] for name, array in self.arrays.items()})

    def compare(self, digits: bool = False) -> dict[int, tuple[Array | slice, Comparison]]:
        """Compare the pressures; for each type its rows and their comparison."""
        now = self.arrays
        types = np.flatnonzero(np.bincount(now["type"])).tolist()  # a tenth of the time of np.unique
        comparisons: dict[int, tuple[Array | slice, Comparison]] = {}
        for t in types:
            rows: Array | slice = slice(None) if len(types) == 1 else now["type"] == t
            law = EOSTable((self.table[t],))  # alone, as the comparison takes its time for every law of a table
            energy_n = now["energy"][rows] if law.needs_energy else None
            rho_n = now["rho"][rows]
            state = EosState(now["id"][rows], np.ones(rho_n.size, np.int32), rho_n, now["mass"][rows], energy_n)
            comparisons[t] = rows, compare_pressure(law, state, now["p"][rows], digits=digits)
        return comparisons

    def result(
        self, others: Mapping[str, Comparison], pressure: bool
    ) -> tuple[dict[str, Array], dict[int, FieldRecord]]:
        """Return the arrays of all fields sorted by id, and per type the record of the pressure with the digits lost.

        ``others`` are the comparisons of other fields; ``pressure`` says whether the pressure is among those checked.
        """
        order_n = np.argsort(self.arrays["id"], kind="stable")
        ordered = self.of(order_n)
        now = ordered.arrays
        arrays = {name: now[name] for name in ("id", "type", "x", "v", "rho", "mass")}
        arrays |= {"box": self.box_c, "periodic": np.array(self.periodic), "step": np.array(self.step)}
        if "energy" in now:
            arrays["e"] = now["energy"] / now["mass"]
        for field, c in others.items():
            if len(c.bound_n) == len(order_n):
                sides = {"lammps": c.lammps_n, "reference": c.reference_n, "bound": c.bound_n}
                arrays |= {f"{field}.{side}": values_n[order_n] for side, values_n in sides.items()}
        if not pressure:
            return arrays, {}
        reference_n, bound_n, records = np.empty(len(order_n)), np.empty(len(order_n)), {}
        for t, (rows, comparison) in ordered.compare(digits=True).items():
            reference_n[rows], bound_n[rows] = comparison.reference_n, comparison.bound_n
            records[t] = comparison.record
        return arrays | {
            "pressure.lammps": now["p"],
            "pressure.reference": reference_n,
            "pressure.bound": bound_n,
        }, records


def read(lmp: Any, table: EOSTable, mass_t: Array | None, step: int, tag_n: Array, x_nc: Array) -> PressureSample:
    """Copy what LAMMPS shows now; ``mass_t`` is None where every particle has its own mass."""

    def column(name: str) -> Array:
        return gather.atoms(lmp, name, len(tag_n)).copy()

    type_n = column("type")
    arrays: dict[str, Array] = {
        "id": tag_n.copy(),
        "type": type_n,
        "x": x_nc.copy(),
        "v": column("v"),
        "rho": column("rho"),
        "p": column("pressure"),
        "mass": mass_t[type_n] if mass_t is not None else column("rmass"),
    }
    if table.needs_energy:
        arrays["energy"] = column("esph")
    low, high, xy, yz, xz, periodic, _ = lmp.extract_box()
    tilt = (xy, xz, yz)
    box_c = np.array([low, high, *[tilt] * any(tilt)])
    return PressureSample(table, box_c, tuple(bool(flag) for flag in periodic), step, arrays)


def load_compiled(table: EOSTable) -> None:
    """Load the compiled loops before the run, not in its first sample."""
    types_n, ones_n = np.arange(1, len(table) + 1, dtype=np.int32), np.ones(len(table))
    arrays: dict[str, Array] = {"id": types_n, "type": types_n}
    arrays |= dict.fromkeys(("rho", "p", "mass", "energy"), ones_n)
    PressureSample(table, np.zeros((2, 3)), (True,) * 3, 0, arrays).compare()
