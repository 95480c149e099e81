"""The ledger of findings: where LAMMPS differs from its manual, explained and reproduced.

An entry that changes numbers names a variant of the reference that reproduces LAMMPS on every atom; one that changes
how LAMMPS refuses predicts the outcome. Neither changes the reference or a bound. The numbers in the arguments are
those of the cases named, or of two particles.
"""

from __future__ import annotations

import numpy as np

from eos_ref import EOSTable
from lammps_cases.comparison.compare import Comparison, State, excess
from lammps_cases.comparison.trajectory import Particles
from lammps_cases.findings import model, refusals
from lammps_cases.findings.entry import ALL, NEWEST, Entry
from lammps_cases.records.run_record import Verdict

__all__ = ["ALL", "LEDGER", "NEWEST", "Entry", "explain_outcome", "explain_pressure", "shown_by"]

LEDGER: tuple[Entry, ...] = (*refusals.ENTRIES, *model.ENTRIES)


def shown_by(scene: Particles, engine: str, lists: bool = False) -> list[Entry]:
    """The findings about the particle model that a scene shows on an engine.

    Those that follow LAMMPS' lists of neighbours only with ``lists``, as they say nothing where these were not read.
    """
    listed = ((e, e.particles) for e in LEDGER if e.particles is not None and e.listed(engine))
    return [e for e, variant in listed if (lists or not variant.lists) and variant.applies(scene)]


def explain_outcome(case: str, engine: str, verdict: Verdict, message: str) -> Entry | None:
    """The entry that predicts, for this engine, how a case ended without numbers."""
    for entry in LEDGER:
        if entry.outcome == verdict and entry.covers(case, engine) and entry.outcome_text in message:
            return entry
    return None


def explain_pressure(case: str, engine: str, table: EOSTable, state: State, comparison: Comparison) -> Entry | None:
    """The entry, for this engine, whose variant is within the bound on every atom."""
    for entry in LEDGER:
        if entry.variant is not None and entry.covers(case, engine):
            ratio_n = excess(comparison.lammps_n, entry.variant(table, state), comparison.bound_n)[1]
            if bool(np.all(ratio_n <= 1)):
                return entry
    return None
