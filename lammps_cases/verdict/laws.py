"""Judgement of cases of an equation of state: the law of LAMMPS' own density and energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eos_ref import EOSTable
from lammps_cases.comparison.compare import Comparison, EosState, compare_pressure
from lammps_cases.engine.session import Answer
from lammps_cases.findings import explain_pressure
from lammps_cases.records.run_record import (
    Blame,
    CaseRecord,
    worst,
)
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.law_mistakes import unseen
from lammps_cases.verdict.outcome import (
    Arrays,
    compare_inputs,
    field_arrays,
)

LINT_ATOMS = 2000  # a mistake that 2000 evenly spaced states do not show is taken as undetected


def judge_laws(record: CaseRecord, case: Case, eos: EOSTable, atoms: Atoms, answer: Answer) -> Arrays:
    """Judge the pressure of LAMMPS' own density and energy, as the forces read it and as it is output."""
    got = answer.arrays
    unchanged = case.scene.evolve is None and not case.scene.rheo.interface_reconstruct
    comparisons = compare_inputs(case, atoms, got, unchanged=unchanged)
    state = EosState(got["id"], got["type"], got["rho"], atoms.mass_n, got.get("esph"))
    # Twice: the array that the forces read, and the output, which LAMMPS evaluates anew from the density.
    used = compare_pressure(eos, state, got["pressure"], "pressure_used", digits=False)
    pressure = compare_pressure(eos, state, got["q.pressure"])
    for comparison in (used, pressure):
        if comparison.record.verdict == "differs":
            entry = explain_pressure(case.name, eos, state, comparison)
            if entry is not None:
                comparison.record.verdict, comparison.record.explained_by = "explained", [entry.id]
    comparisons += [used, pressure]
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    record.ended, record.blame = "answered", _blame(comparisons, state)
    record.lint = _lint(eos, state, pressure)
    arrays = field_arrays(atoms, got, comparisons)
    if state.e_n is not None:
        arrays["e"] = state.e_n
    return arrays


def _blame(comparisons: list[Comparison], state: EosState) -> Blame | None:
    """Return the first stage, field and atom outside the bound, with the numbers."""
    for comparison in comparisons:
        record = comparison.record
        if record.first_id is None:
            continue
        at = int(np.searchsorted(state.id_n, record.first_id))
        return Blame(
            field=record.field,
            stage=record.stage,
            atom=record.first_id,
            type=int(state.type_n[at]),
            rho=float(state.rho_n[at]),
            lammps=float(comparison.lammps_n[at]),
            reference=float(comparison.reference_n[at]),
            bound=float(comparison.bound_n[at]),
            outside=record.outside,
            of=len(state.id_n),
        )
    return None


def _lint(eos: EOSTable, state: EosState, pressure: Comparison) -> list[str]:
    every = slice(None, None, max(1, len(state.id_n) // LINT_ATOMS))
    thinned = replace(state, **{name: side_n[every] for name, side_n in vars(state).items() if side_n is not None})
    return unseen(eos, thinned, pressure.reference_n[every], pressure.bound_n[every])
