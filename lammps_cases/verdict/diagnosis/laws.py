"""Hypotheses about cases of an equation of state: changed laws, and factors of the pressure."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eos_ref import EOSTable
from eos_ref.eos import bounds
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import EosState, evaluate, excess
from lammps_cases.records.files import read_arrays
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict import law_mistakes
from lammps_cases.verdict.diagnosis.edits import made
from lammps_cases.verdict.diagnosis.law_changes import law_changes
from lammps_cases.verdict.diagnosis.reached import reached

Pressure = Callable[[EOSTable, EosState], tuple[FloatArray, FloatArray] | None]  # with its bound


@dataclass(frozen=True)
class Reproduced:
    """Cases that some changes reproduce, and these in words; empty if none does."""

    cases: frozenset[str]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class _RedLaw:
    table: EOSTable
    state: EosState
    lammps_n: FloatArray
    bound_n: FloatArray

    def reproduced(self, change: Pressure) -> bool:
        """Return whether a change is inside its bound on every atom, which is none that the reference is in too."""
        try:
            with np.errstate(all="ignore"):
                reference_n = evaluate(self.table, self.state)  # first: of a gas without energies there is none
                made = change(self.table, self.state)
                if made is None:
                    return False
                outside = np.any(excess(self.lammps_n, reference_n, made[1])[1] > 1)
                return bool(outside and np.all(excess(self.lammps_n, *made)[1] <= 1))
        except Exception:  # a change that has no meaning for this law
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
    for name, mutant in law_mistakes.MUTANTS.items():

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
    """Yield edits of the functions that the laws of a case go through."""
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
