"""Hypotheses about cases of an equation of state: changed laws, and factors of the pressure."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import EosState, evaluate, excess
from lammps_cases.records.files import read_arrays
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict import mistakes
from lammps_cases.verdict.diagnosis.edits import made
from lammps_cases.verdict.diagnosis.reached import reached

Law = Callable[[EOSTable], EOSTable]
OtherType = Callable[[int, int], int]  # of a type, and of the number of types; all from 0
_LAW_PARAMETERS = {
    "speed of sound": "cs",
    "equilibrium density": "rho0",
    "parameter": "parameter",
    "background": "background",
}
_POWERS: dict[str, Callable[[float], float]] = {
    "a {} of 1": lambda value: 1.0,
    "the square root of the {}": lambda value: value**0.5,
    "the square of the {}": lambda value: value**2,
    "twice the {}": lambda value: 2 * value,
    "half the {}": lambda value: value / 2,
}
_EXPONENTS: dict[str, Callable[[float], float]] = {
    "one more than it is": lambda value: value + 1,
    "one less than it is": lambda value: value - 1,
    "0": lambda value: 0.0,
    "7": lambda value: 7.0,
    "of the other sign": lambda value: -value,
}
Pressure = Callable[[EOSTable, EosState], tuple[FloatArray, FloatArray] | None]  # with its bound


def law_changes(types: int) -> Iterator[tuple[str, Law]]:
    """Yield changes of the laws of all types, in words; some are undefined for some laws and raise there."""
    if types > 1:
        for k in range(types):
            yield from _of_another(f"type {k + 1}", lambda t, count, k=k: k)  # type: ignore[misc]
        yield from _of_another("the next type", lambda t, count: (t + 1) % count)
        yield from _of_another("the previous type", lambda t, count: (t - 1) % count)
    yield from _of_numbers()
    yield "the background pressure were missing", _each(lambda law: replace(law, background=0.0))
    yield "the background pressure had the other sign", _each(lambda law: replace(law, background=-law.background))
    yield (
        "every law were linear",
        _each(lambda law: law if law.needs_energy else EOS("linear", law.rho0, law.cs, None, law.background)),
    )
    for words, other in _EXPONENTS.items():
        yield f"the parameter of every law (gamma, A3) were {words}", _each(_with_parameter(other))


def _each(change: Callable[[EOS], EOS]) -> Law:
    return lambda table: EOSTable(tuple(map(change, table.laws)))


def _of_another(words: str, other: OtherType) -> Iterator[tuple[str, Law]]:
    """Yield what a law could have taken from another type's law: a parameter, or all of it."""

    def taken(key: str) -> Law:
        def change(law: EOS, of: EOS) -> EOS:
            return replace(law, **{key: getattr(of, key)}) if key else of

        return lambda table: EOSTable(
            tuple(change(law, table[other(t, len(table)) + 1]) for t, law in enumerate(table.laws))
        )

    for name, key in _LAW_PARAMETERS.items():
        yield f"the pressure of every particle used the {name} of {words}", taken(key)
    yield f"the pressure of every particle followed the law of {words}", taken("")


def _of_numbers() -> Iterator[tuple[str, Law]]:

    def powered(key: str, number: Callable[[float], float]) -> Law:
        def change(law: EOS) -> EOS:
            changed: Any = {key: number(getattr(law, key))}
            return replace(law, **changed)

        return _each(change)

    for name in ("speed of sound", "equilibrium density"):
        for words, number in _POWERS.items():
            yield f"the pressure of every particle used {words.format(name)}", powered(_LAW_PARAMETERS[name], number)


def _with_parameter(other: Callable[[float], float]) -> Callable[[EOS], EOS]:
    return lambda law: law if law.parameter is None else replace(law, parameter=other(law.parameter))


@dataclass(frozen=True)
class Reproduced:
    """Cases that some changes reproduce, and these changes in words; empty without such a change."""

    cases: frozenset[str]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class _RedLaw:
    table: EOSTable
    state: EosState
    lammps_n: FloatArray
    bound_n: FloatArray

    def reproduced(self, change: Pressure) -> bool:
        """Return whether a change is within its bound on every atom where the reference is not."""
        try:
            with np.errstate(all="ignore"):
                reference_n = evaluate(self.table, self.state)  # first: it fails for a gas without energies
                made = change(self.table, self.state)
                if made is None:
                    return False
                outside = np.any(excess(self.lammps_n, reference_n, made[1])[1] > 1)
                return bool(outside and np.all(excess(self.lammps_n, *made)[1] <= 1))
        except Exception:  # a change that is undefined for this law
            return False


def hypotheses(records: Sequence[CaseRecord], cases: Mapping[str, Case], fields: Path) -> tuple[int, Reproduced]:
    """Return how many changes were tried, and those that reproduce the most cases."""
    red = {record.case: made for record in records if (made := _read(record, cases[record.case], fields))}
    types = max((len(case.table) for case in red.values()), default=1)
    tried, holds = 0, list[tuple[frozenset[str], str]]()
    edits = _edits(next(iter(red.values()))) if red else ()
    for sentence, change in itertools.chain(_changes(types), edits):
        tried += 1
        held = frozenset(name for name, case in red.items() if case.reproduced(change))
        if held:
            holds.append((held, sentence))
    if not holds:
        return tried, Reproduced(frozenset(), ())
    best = max((held for held, _ in holds), key=len)
    return tried, Reproduced(best, tuple(sentence for held, sentence in holds if held == best))


def _read(record: CaseRecord, case: Case, fields: Path) -> _RedLaw | None:
    path = fields / f"{record.case}.npz"
    if record.blame is None or not path.is_file():
        return None
    arrays, table = read_arrays(path), case.scene.eos(case.where)
    mass_n = arrays["mass"]
    energy_n = arrays["e"] * mass_n if "e" in arrays else None
    state = EosState(arrays["id"], arrays["type"], arrays["rho"], mass_n, energy_n)
    name = record.blame.field
    if f"{name}.lammps" not in arrays:
        return None
    return _RedLaw(table, state, np.asarray(arrays[f"{name}.lammps"], float), arrays[f"{name}.bound"])


def _changes(types: int) -> Iterator[tuple[str, Pressure]]:
    for sentence, law in law_changes(types):

        def of_law(table: EOSTable, state: EosState, law=law) -> tuple[FloatArray, FloatArray]:  # type: ignore[no-untyped-def]
            other = law(table)
            return evaluate(other, state), bounds.comparison(other, state.rho_n, state.type_n, state.e_n)

        yield sentence, of_law
    for name, mutant in mistakes.LAW_MUTANTS.items():

        def of_mistake(table: EOSTable, state: EosState, mutant=mutant) -> tuple[FloatArray, FloatArray] | None:  # type: ignore[no-untyped-def]
            p_n = mutant(table, state)
            return None if p_n is None else (p_n, bounds.comparison(table, state.rho_n, state.type_n, state.e_n))

        yield f"the reference made the mistake: {name}", of_mistake
    for words, factor in _FACTORS.items():

        def times(table: EOSTable, state: EosState, factor=factor) -> tuple[FloatArray, FloatArray]:  # type: ignore[no-untyped-def]
            factor_n = factor(table, state)
            bound_n = bounds.comparison(table, state.rho_n, state.type_n, state.e_n) * np.abs(factor_n)
            p_n = evaluate(table, state) * factor_n
            return p_n, bound_n + 4 * bounds.EPS * np.abs(p_n)

        yield f"the pressure of every particle {words}", times


def _edits(case: _RedLaw) -> Iterator[tuple[str, Pressure]]:
    for function in reached(lambda: evaluate(case.table, case.state)):
        for edit in function.edits():

            def edited(table: EOSTable, state: EosState, edit=edit) -> tuple[FloatArray, FloatArray]:  # type: ignore[no-untyped-def]
                reference_n, bound_n = (
                    evaluate(table, state),
                    bounds.comparison(table, state.rho_n, state.type_n, state.e_n),
                )
                with made([edit]):
                    p_n = evaluate(table, state)
                larger_n = np.maximum(1.0, np.abs(p_n) / np.maximum(np.abs(reference_n), np.finfo(float).tiny))
                return p_n, bound_n * larger_n + 4 * bounds.EPS * np.abs(p_n)

            yield function.sentence(edit), edited


def _rho0(table: EOSTable, state: EosState) -> FloatArray:
    return np.array([law.rho0 for law in table.laws])[state.type_n - 1]


_FACTORS: dict[str, Callable[[EOSTable, EosState], FloatArray]] = {
    "were twice as large": lambda table, state: np.full(len(state.rho_n), 2.0),
    "were half as large": lambda table, state: np.full(len(state.rho_n), 0.5),
    "had the other sign": lambda table, state: np.full(len(state.rho_n), -1.0),
    "were missing": lambda table, state: np.zeros(len(state.rho_n)),
    "were multiplied by the mass": lambda table, state: state.mass_n,
    "were divided by the mass": lambda table, state: 1 / state.mass_n,
    "were multiplied by the density": lambda table, state: state.rho_n,
    "were divided by the density": lambda table, state: 1 / state.rho_n,
    "were multiplied by the volume": lambda table, state: state.mass_n / state.rho_n,
    "were divided by the volume": lambda table, state: state.rho_n / state.mass_n,
    "were multiplied by the equilibrium density": _rho0,
    "were divided by the equilibrium density": lambda table, state: 1 / _rho0(table, state),
    "were multiplied by the density over its equilibrium density": lambda table, state: (
        state.rho_n / _rho0(table, state)
    ),
    "were divided by the density over its equilibrium density": lambda table, state: _rho0(table, state) / state.rho_n,
}
