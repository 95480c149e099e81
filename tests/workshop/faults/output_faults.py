"""Faults in the output read from real LAMMPS: arrays changed at every step read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from eos_ref.model.quantities import order
from lammps_cases.engine.session import Answer
from lammps_cases.scene.changes import Kind
from lammps_cases.scene.fields import FIELDS
from tests.workshop.faults.fault import Fault, by_id

Arrays = dict[str, Any]
ArraysChange = Callable[[tuple[Arrays, ...]], list[Arrays]]

# Arrays as the engine names them: numbers that vary from atom to atom, counts and classes, and parameters of a type.
_FIELDS = [(field.key, field.quantity) for field in FIELDS.values()]
REAL = {key: q.about for key, q in _FIELDS if not q.discrete and (q.integrated or q.whole in order())} | {
    "rho": "densities (atom property)",
    "esph": "energies (atom property)",
}
WHOLE = {key: q.about for key, q in _FIELDS if q.discrete} | {"type": "types"}
PER_TYPE = {key: q.about for key, q in _FIELDS if key not in REAL and key not in WHOLE}


@dataclass(frozen=True)
class OutputFault(Fault):
    """A fault in the output: the arrays of all steps, changed."""

    change: ArraysChange


def applied(fault: OutputFault, answer: Answer) -> Answer | None:
    """Return the answer with the fault; None if it does not apply, or changes nothing."""
    snapshots = fault.change(answer.snapshots)
    if all(_same(one, other) for one, other in zip(snapshots, answer.snapshots, strict=True)):
        return None
    return replace(answer, arrays=snapshots[-1], snapshots=tuple(snapshots))


def _same(one: Arrays, other: Arrays) -> bool:
    return all(np.array_equal(one[name], other[name]) for name in other)


# --- changes


def _each(name: str, change: Callable[[Any], Any]) -> ArraysChange:
    """Change one array at every step."""
    return lambda snapshots: [s | {name: change(s[name].copy())} if name in s else s for s in snapshots]


def _all(change: Callable[[Any], Any], keep: tuple[str, ...] = ()) -> ArraysChange:
    """Change all arrays at every step."""
    return lambda snapshots: [{k: v if k in keep else change(v.copy()) for k, v in s.items()} for s in snapshots]


def _late(snapshots: tuple[Arrays, ...]) -> list[Arrays]:
    """Replace all arrays by those of the previous step read."""
    return [snapshots[0], *snapshots[:-1]]


def _stale(name: str) -> ArraysChange:
    """Replace one array by that of the previous step read."""
    return lambda snapshots: [
        s | {name: before[name]} if name in s else s for s, before in zip(snapshots, _late(snapshots), strict=True)
    ]


def single(array_n: Any) -> Any:
    """Round to single precision."""
    with np.errstate(over="ignore"):
        return array_n.astype(np.float32).astype(array_n.dtype)


def ends_exchanged(array_n: Any) -> Any:
    """Exchange the first and the last row, in place."""
    array_n[[0, -1]] = array_n[[-1, 0]]
    return array_n


def middle(update: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Transform the row of the middle atom, in place."""

    def change(array_n: Any) -> Any:
        array_n[len(array_n) // 2] = update(array_n[len(array_n) // 2])
        return array_n

    return change


def _one_off(array_n: Any) -> Any:
    """Change the largest component of the middle atom by 1e-9, or of all atoms if that one is 0."""
    flat_n = array_n.reshape(len(array_n), -1)
    row = len(flat_n) // 2
    if not flat_n[row].any():
        row = int(np.abs(flat_n).max(axis=1).argmax())
    flat_n[row, np.abs(flat_n[row]).argmax()] *= 1 + 1e-9
    return array_n


def _axes(array_n: Any) -> Any:
    """Exchange the components x and y."""
    return array_n[:, [1, 0, *range(2, array_n.shape[1])]]


def _axis_lost(array_n: Any) -> Any:
    """Set the component y to 0, in place."""
    array_n[:, 1] = 0.0
    return array_n


_shifted = partial(np.roll, shift=1, axis=0)
VARIABLE = [
    name for name in REAL if name not in ("x", "rho", "esph", "q.viscosity")
]  # others: inputs, read once, constants
OUTPUTS = ("q.rho", "q.pressure", "q.viscosity", "q.temperature", "q.energy")
STRESSES = ("own_stress_atom", "own_virial")
UNSET = ("f", "drho", "pressure", "q.grad/v", "q.heatflow", "q.shift/v", "q.chi", "v")
SIGNED = ("f", "drho", "q.pressure", "q.shift/v", "q.surface/n", "q.stress/v", "q.heatflow", *STRESSES)


# --- the faults: name, kind, what with the words of a field for {}, fields, change of an array or of all steps

_TABLE: tuple[tuple[str, Kind, str, Iterable[str], Callable[[Any], Any]], ...] = (
    ("single", "single precision", "{} rounded to float32", REAL, single),
    ("one-off", "last digits", "{}: one atom off by 1e-9", REAL, _one_off),
    ("zero", "unset", "{} all 0", UNSET, np.zeros_like),
    (
        *("nan", "unset", "{}: NaN for one atom"),
        *(("f", "q.pressure", "q.temperature", "q.stress/t"), middle(lambda _: np.nan)),
    ),
    ("sign", "sign", "{} of the other sign", SIGNED, np.negative),
    ("axes", "exchanged", "components x and y of {}", ("f", "v", "q.shift/v", "q.surface/n", "x"), _axes),
    ("axis-lost", "unset", "component y of {} is 0", ("v", "f", "q.surface/n"), _axis_lost),
    ("transposed", "exchanged", "{} transposed", ("q.grad/v",), lambda m: m.swapaxes(1, 2)),  # stresses are symmetric
    (
        *("diagonal", "missing term", "{}: diagonal only"),
        *(("q.grad/v", "q.stress/v", "q.stress/t"), lambda m: m * np.eye(m.shape[1])),
    ),
    (
        *("swapped", "exchanged", "{} of two atoms exchanged"),
        *(("rho", "pressure", "f", "v", "x", *OUTPUTS), ends_exchanged),
    ),
    ("shifted", "exchanged", "{} of the atom before", [*WHOLE, *PER_TYPE], _shifted),
    ("one-more", "last digits", "{}: larger by 1 for one atom", [*WHOLE, *PER_TYPE], middle(lambda n: n + 1)),
    ("factor", "units", "{} of half their size", ("f", *STRESSES, "own_press"), lambda f: 0.5 * f),
    ("factor", "units", "{} in atm, as of units real", ("q.pressure",), lambda p: p / 68568.415),
)
_OF_ALL: tuple[tuple[str, Kind, str, ArraysChange], ...] = (
    ("all-shifted", "exchanged", "all arrays but the ids are those of the atom before", _all(_shifted, ("id",))),
    ("ids-shifted", "exchanged", "ids of the atom before", _each("id", _shifted)),
    ("id-repeated", "exchanged", "the last id twice", _each("id", lambda n: np.r_[n[:-2], n[-1:], n[-1:]])),
    ("atom-missing", "missing term", "the last atom not read", _all(lambda array_n: array_n[:-1])),
    ("all-late", "stale", "all arrays are those of the reading before", _late),
    ("all-single", "single precision", "all arrays rounded to float32", _all(single, ("id", "type"))),
)


@cache
def faults() -> dict[str, OutputFault]:
    """Return all faults of this family by their id, in order."""
    words = REAL | WHOLE | PER_TYPE
    made = [
        (f"{what}-{name}", kind, about.format(words[name]), _each(name, change))
        for what, kind, about, names, change in _TABLE
        for name in names
    ]
    stale: list[tuple[str, Kind, str, ArraysChange]] = [
        (f"stale-{name}", "stale", f"{REAL[name]} of the reading before", _stale(name)) for name in VARIABLE
    ]
    return by_id(
        OutputFault(f"read.{name.replace('q.', 'output-').replace('/', '-').replace('_', '-')}", kind, what, change)
        for name, kind, what, change in (*made, *stale, *_OF_ALL)
    )
