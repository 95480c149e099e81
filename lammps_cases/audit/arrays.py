"""Arrays of all atoms, samples of the pressure made of them, and what an audit keeps to compare later runs with.

On one rank the arrays are LAMMPS' own memory; on several, LAMMPS gathers them, and every rank gets all. All ranks call
these functions, in the same order: they follow the same commands and take the same samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOSTable
from lammps_cases.comparison.compare import Comparison, EosState, compare_pressure, components
from lammps_cases.records.case_parts import FieldRecord

Array = npt.NDArray[Any]
_ROW = 3  # numbers of a row of a two-dimensional property
_GATHERED = {0: (0, 1), 2: (1, 1), 3: (1, _ROW)}  # by extract_atom_datatype: what gather_concat takes, and columns
STATE = ("id", "type", "x", "v", "rho", "e")
MARKED = 64  # bit of the status
MOST = 500  # particles of a sample
CLOCKS = ("CPU", "TimeoutLeft")  # in the names of columns of thermo output that no second run has the same


def rank_count(lmp: Any) -> int:
    """Return the number of ranks."""
    return int(lmp.extract_setting("world_size"))


def ids(lmp: Any) -> Array:
    """Return the ids of all atoms, (n,), rank by rank."""
    if rank_count(lmp) == 1:
        id_n: Array = lmp.numpy.extract_atom("id")[: lmp.extract_setting("nlocal")]
        return id_n
    id_n = _gathered(lmp, "id")
    return id_n[: np.count_nonzero(id_n)]  # behind them 0, for atoms that are lost and still counted


def atoms(lmp: Any, name: str, n: int) -> Array:
    """Return a property of all n atoms by extract_atom's name, (n,) or (n, 3), in the order of `ids`."""
    found: Array = lmp.numpy.extract_atom(name) if rank_count(lmp) == 1 else _gathered(lmp, name)
    return found[:n]


def compute(lmp: Any, name: str, columns: int, n: int) -> Array:
    """Return what a compute of at least two columns has for all n atoms, (n, columns)."""
    if rank_count(lmp) == 1:
        table: Array = lmp.numpy.extract_compute(name, 1, 2)
    else:
        table = np.ctypeslib.as_array(lmp.gather_concat(f"c_{name}", 1, columns)).reshape(-1, columns)
    return table[:n]


def members(lmp: Any, group: str, n: int) -> npt.NDArray[np.bool_]:
    """Return which of all n atoms are in a group now, (n,)."""
    bit = lmp.available_ids("group").index(group)
    in_n: npt.NDArray[np.bool_] = atoms(lmp, "mask", n) >> bit & 1 != 0
    return in_n


def marked(lmp: Any) -> Array:
    """Return the ids of the atoms that fix rheo/oxidation has marked, as being in bonds, sorted."""
    id_n = ids(lmp)
    marked_n = atoms(lmp, "rheo_status", len(id_n)) & MARKED != 0
    return np.sort(id_n[marked_n])


def _gathered(lmp: Any, name: str) -> Array:
    kind, columns = _GATHERED[lmp.extract_atom_datatype(name)]
    found = np.ctypeslib.as_array(lmp.gather_concat(name, kind, columns))
    return found.reshape(-1, columns) if columns == _ROW else found


@dataclass(frozen=True)
class PressureSample:
    """Atoms as LAMMPS shows them right after a force evaluation, copied, and the laws of that moment.

    Attributes
    ----------
    table : EOSTable
    box_c : (2, 3) low and high corner, and xy, xz, yz if an edge leans
    periodic : one flag per axis
    step : LAMMPS' count of steps
    arrays : per atom ``id``, ``type``, ``status``, ``x``, ``v``, ``rho``, ``p``, ``mass``; ``energy`` if a law needs it
    others : the other fields of the sample, compared
    checked : whether the pressure is checked as well
    """

    table: EOSTable
    box_c: Array
    periodic: tuple[bool, ...]
    step: int
    arrays: Mapping[str, Array]
    others: Mapping[str, Comparison] = field(default_factory=dict)
    checked: bool = True

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

    def few(self) -> dict[str, Array]:
        """Return the arrays of `result`: of all particles, or of evenly spaced ones."""
        order_n = np.argsort(self.arrays["id"], kind="stable")
        n = len(order_n)
        few = order_n[np.linspace(0, n - 1, min(n, MOST)).astype(int)]
        of_few = {
            name: replace(c, lammps_n=c.lammps_n[few], reference_n=c.reference_n[few], bound_n=c.bound_n[few])
            for name, c in self.others.items()
            if len(c.bound_n) == n
        }
        return replace(self.of(few), others=of_few).result()[0]

    def result(self) -> tuple[dict[str, Array], dict[int, FieldRecord]]:
        """Return the arrays of all fields by id, and per type the record of the pressure with the digits lost."""
        order_n = np.argsort(self.arrays["id"], kind="stable")
        ordered = self.of(order_n)
        now = ordered.arrays
        arrays = {name: now[name] for name in ("id", "type", "x", "v", "rho", "mass")}
        arrays |= {"box": self.box_c, "periodic": np.array(self.periodic), "step": np.array(self.step)}
        if "energy" in now:
            arrays["e"] = now["energy"] / now["mass"]
        for name, c in self.others.items():
            if len(c.bound_n) == len(order_n):
                sides = {"lammps": c.lammps_n, "reference": c.reference_n, "bound": c.bound_n}
                arrays |= {f"{name}.{side}": values_n[order_n] for side, values_n in sides.items()}
        if not self.checked:
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


def read_pressure(
    lmp: Any, table: EOSTable, mass_t: Array | None, step: int, tag_n: Array, x_nc: Array
) -> PressureSample:
    """Copy what LAMMPS shows now; ``mass_t`` is None where every particle has its own mass."""

    def column(name: str) -> Array:
        return atoms(lmp, name, len(tag_n)).copy()

    type_n = column("type")
    arrays: dict[str, Array] = {
        "id": tag_n.copy(),
        "type": type_n,
        "status": column("rheo_status"),
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
