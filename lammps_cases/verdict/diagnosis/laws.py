"""Hypotheses about cases of an equation of state: changed laws, factors of the pressure, edits of its formulas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eos_ref import EOSTable
from eos_ref.eos import bounds
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.changed import pressure
from lammps_cases.comparison.compare import EosState, evaluate, excess
from lammps_cases.records.files import read_arrays
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.changes import Change
from lammps_cases.verdict.diagnosis.changes import candidates


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

    def reproduced(self, change: Change) -> bool:
        """Return whether a change is within its bound on every atom where the reference is not.

        The bound is that of the reference, wider where the pressure is larger, and of one more operation.
        """
        try:
            with np.errstate(all="ignore"):
                reference_n = evaluate(self.table, self.state)  # first: it fails for a gas without energies
                bound_n = bounds.comparison(self.table, self.state.rho_n, self.state.type_n, self.state.e_n)
                p_n = pressure(change, self.table, self.state)
                if p_n is None:
                    return False
                larger_n = np.maximum(1.0, np.abs(p_n) / np.maximum(np.abs(reference_n), np.finfo(float).tiny))
                bound_n = bound_n * larger_n + 4 * bounds.EPS * np.abs(p_n)
                outside = np.any(excess(self.lammps_n, reference_n, bound_n)[1] > 1)
                return bool(outside and np.all(excess(self.lammps_n, p_n, bound_n)[1] <= 1))
        except Exception:  # a change that is undefined for this law
            return False


def hypotheses(records: Sequence[CaseRecord], cases: Mapping[str, Case], fields: Path) -> tuple[int, Reproduced]:
    """Return how many changes were tried, and those that reproduce the most cases."""
    red = {record.case: made for record in records if (made := _read(record, cases[record.case], fields))}
    first = next(iter(red.values()), None)
    if first is None:
        return 0, Reproduced(frozenset(), ())
    types = max(len(case.table) for case in red.values())
    tried, holds = 0, dict[str, frozenset[str]]()
    for change in candidates(types, lambda: evaluate(first.table, first.state)):
        if change.function or change.table:
            tried += 1
            held = frozenset(name for name, case in red.items() if case.reproduced(change))
            holds[change.sentence] = max(held, holds.get(change.sentence, held), key=len)
    best = max(holds.values(), key=len, default=frozenset[str]())
    return tried, Reproduced(best, tuple(sentence for sentence, held in holds.items() if held and held == best))


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
