"""Faults in the output read from real LAMMPS: arrays changed at every step read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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


# --- the faults


def _fault(name: str, kind: Kind, what: str, change: ArraysChange) -> OutputFault:
    return OutputFault(f"read.{name.replace('q.', 'output-').replace('/', '-').replace('_', '-')}", kind, what, change)


def _per_field() -> Iterator[OutputFault]:
    for name, words in REAL.items():
        yield _fault(f"single-{name}", "single precision", f"{words} rounded to float32", _each(name, single))
        yield _fault(f"one-off-{name}", "last digits", f"{words}: one atom off by 1e-9", _each(name, _one_off))
        if name not in ("x", "rho", "esph", "q.viscosity"):  # inputs, compared once, and constants are never stale
            yield _fault(f"stale-{name}", "stale", f"{words} of the reading before", _stale(name))
    for name in ("f", "drho", "pressure", "q.grad/v", "q.heatflow", "q.shift/v", "q.chi", "v"):
        yield _fault(f"zero-{name}", "unset", f"{REAL[name]} all 0", _each(name, np.zeros_like))
    for name in ("f", "q.pressure", "q.temperature", "q.stress/t"):
        yield _fault(f"nan-{name}", "unset", f"{REAL[name]}: NaN for one atom", _each(name, middle(lambda _: np.nan)))
    for name in ("f", "q.pressure", "drho", "q.shift/v", "q.surface/n", "q.stress/v", "q.heatflow"):
        yield _fault(f"sign-{name}", "sign", f"{REAL[name]} of the other sign", _each(name, np.negative))
    for name in ("f", "v", "q.shift/v", "q.surface/n", "x"):
        yield _fault(f"axes-{name}", "exchanged", f"components x and y of {REAL[name]}", _each(name, _axes))
    for name in ("v", "f", "q.surface/n"):
        yield _fault(f"axis-lost-{name}", "unset", f"component y of {REAL[name]} is 0", _each(name, _axis_lost))
    for name in ("q.grad/v",):  # stresses are symmetric
        yield _fault(
            f"transposed-{name}", "exchanged", f"{REAL[name]} transposed", _each(name, lambda m: m.swapaxes(1, 2))
        )
    for name in ("q.grad/v", "q.stress/v", "q.stress/t"):
        yield _fault(
            f"diagonal-{name}",
            "missing term",
            f"{REAL[name]}: diagonal only",
            _each(name, lambda m: m * np.eye(m.shape[1])),
        )
    for name in ("rho", "q.rho", "pressure", "q.pressure", "f", "v", "x", "q.viscosity", "q.temperature", "q.energy"):
        yield _fault(
            f"swapped-{name}", "exchanged", f"{REAL[name]} of two atoms exchanged", _each(name, ends_exchanged)
        )
    for name, words in (WHOLE | PER_TYPE).items():
        yield _fault(f"shifted-{name}", "exchanged", f"{words} of the atom before", _each(name, _shifted))
        yield _fault(
            f"one-more-{name}",
            "last digits",
            f"{words}: larger by 1 for one atom",
            _each(name, middle(lambda n: n + 1)),
        )
    yield _fault(
        "factor-output-pressure",
        "units",
        "pressures in atm, as of units real",
        _each("q.pressure", lambda p: p / 68568.415),
    )
    for name in ("f", "own_stress_atom", "own_virial", "own_press"):
        yield _fault(f"factor-{name}", "units", f"{REAL[name]} of half their size", _each(name, lambda f: 0.5 * f))
    for name in ("own_stress_atom", "own_virial"):
        yield _fault(f"sign-{name}", "sign", f"{REAL[name]} of the other sign", _each(name, np.negative))


@cache
def faults() -> dict[str, OutputFault]:
    """Return all faults of this family by their id, in order."""
    whole = (
        _fault(
            "all-shifted", "exchanged", "all arrays but the ids are those of the atom before", _all(_shifted, ("id",))
        ),
        _fault("ids-shifted", "exchanged", "ids of the atom before", _each("id", _shifted)),
        _fault("id-repeated", "exchanged", "the last id twice", _each("id", lambda n: np.r_[n[:-2], n[-1:], n[-1:]])),
        _fault("atom-missing", "missing term", "the last atom not read", _all(lambda array_n: array_n[:-1])),
        _fault("all-late", "stale", "all arrays are those of the reading before", _late),
        _fault("all-single", "single precision", "all arrays rounded to float32", _all(single, ("id", "type"))),
    )
    return by_id((*_per_field(), *whole))
