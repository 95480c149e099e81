"""The ledger of findings: where LAMMPS differs from its manual, explained and reproduced.

The text of a finding is a document in ``lammps_cases/data/findings``; its behaviour stands in the module of its
subject. One that changes numbers names a variant of the reference that reproduces LAMMPS on every atom; one that
changes how LAMMPS refuses predicts the outcome. Neither changes the reference or a bound.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eos_ref import EOSTable, InputError
from eos_ref.errors import unknown
from lammps_cases.comparison.compare import Comparison, EosState, excess
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings import (
    bonds,
    exchange,
    forces,
    kernels,
    outcomes,
    shifting,
    surfaces,
    thermal,
    units,
    virials,
    walls,
)
from lammps_cases.findings.engines import KNOWN, NEWEST, SEEN_ON
from lammps_cases.findings.entry import Finding, LawFinding, ModelFinding, OutcomeFinding
from lammps_cases.records.levels import SEVERITIES, Severity
from lammps_cases.records.run_record import CaseRecord

if TYPE_CHECKING:
    from lammps_cases.scene import Scene

__all__ = ["KNOWN", "LEDGER", "NEWEST", "SHOWN_BY", "Finding", "accepted_cases", "accepting", "applicable", "by_cause"]
__all__ += ["SEEN_ON", "check_names", "explain_outcome", "explain_pressure", "ledger_of", "severities", "shown_by"]

SHOWN_BY = Path(__file__).with_name("shown_by.json")


def ledger_of(subjects: Iterable[Sequence[Finding]]) -> tuple[Finding, ...]:
    """Return the findings of all subjects in the order of the ledger, by which variants are tried and named."""
    return tuple(sorted((entry for entries in subjects for entry in entries), key=lambda entry: entry.number))


_SUBJECTS = (
    bonds,
    exchange,
    forces,
    kernels,
    outcomes,
    shifting,
    surfaces,
    thermal,
    units,
    virials,
    walls,
)
LEDGER = ledger_of(subject.ENTRIES for subject in _SUBJECTS)


def accepted_cases(engine: str = "") -> dict[str, list[str]]:
    """Return the cases of the accepted runs that show each finding: of an engine, or of any.

    `lammps_cases.versions.evidence` writes the file, which lists for each case the engines that have the finding and do
    not show it there.
    """
    shown: dict[str, dict[str, list[str]]] = json.loads(SHOWN_BY.read_text(encoding="utf-8"))
    return {name: [case for case, but_on in cases.items() if engine not in but_on] for name, cases in shown.items()}


def severities(names: Iterable[str], ledger: Sequence[Finding] = LEDGER) -> dict[str, Severity]:
    """Return findings with their severities, each once, the most severe first; one outside the ledger is severe."""
    of_ledger: dict[str, Severity] = {entry.id: entry.severity for entry in ledger}
    chosen: dict[str, Severity] = {name: of_ledger.get(name, "high") for name in names}
    return dict(sorted(chosen.items(), key=lambda item: SEVERITIES.index(item[1])))


def by_cause(shown: Mapping[str, Collection[str]], ledger: Iterable[Finding] = LEDGER) -> list[Finding]:
    """Return findings grouped by cause; causes, and findings within one, are ordered by how many cases show them."""
    cases: dict[str, set[str]] = {}
    for entry in ledger:
        cases.setdefault(entry.cause, set()).update(shown.get(entry.id, ()))
    return sorted(ledger, key=lambda e: (-len(cases[e.cause]), e.cause, -len(shown.get(e.id, ())), e.number))


def finding(name: str) -> Finding:
    """Return a finding of the ledger by its id."""
    return next(entry for entry in LEDGER if entry.id == name)


def check_names(names: Iterable[str]) -> None:
    """Reject a name that no finding has.

    Raises
    ------
    InputError
    """
    ids = [entry.id for entry in LEDGER]
    for name in names:
        if name not in ids:
            raise unknown("finding", name, ids)


def applicable(problem: Problem, lists: bool = False) -> list[Finding]:
    """Return the findings about the particle model that make a difference to a scene, on any engine.

    Those that follow LAMMPS' neighbour lists are returned only with ``lists``, as they predict nothing without them,
    except those that then leave values without a bound.
    """
    of_model = ((entry, entry.model_variant) for entry in LEDGER if entry.model_variant is not None)
    return [entry for entry, variant in of_model if (lists or variant.blind) and variant.applies(problem)]


def shown_by(problem: Problem, engine: str, lists: bool = False) -> list[Finding]:
    """Return those of the applicable findings that an engine, or the nearest known one, was seen to have."""
    return [entry for entry in applicable(problem, lists) if entry.listed(engine)]


def with_gap(scene: Scene, engine: str) -> list[Finding]:
    """Return the findings of an engine whose variants are known not to reproduce every such scene."""
    return [
        entry
        for entry in LEDGER
        if isinstance(entry, ModelFinding)
        and any(gap.applies(scene) for gap in entry.gaps)
        and (not entry.engines or entry.listed(engine))
    ]


def explain_outcome(record: CaseRecord, scene: Scene | None = None) -> Finding | None:
    """Return the entry that predicts how a case ended without numbers, by its name or by its scene."""
    named = (entry for entry in LEDGER if entry.covers(record.case) and entry.predicts(record))
    shown = (entry for entry in LEDGER if scene is not None and entry.predicts_of(record, scene))
    return next(named, None) or next(shown, None)


def accepting(error: InputError, engine: str) -> Finding | None:
    """Return the entry by which an engine accepts an argument that the reference refuses."""
    of_inputs = (entry for entry in LEDGER if isinstance(entry, OutcomeFinding) and error.what in entry.accepts)
    return next((entry for entry in of_inputs if entry.listed(engine)), None)


def refusing(error: str, deck: str, engine: str) -> Finding | None:
    """Return the entry by which an engine refuses a deck, by its error and the deck's run_style, fixes and computes."""
    text = f"{error}\n{deck}\n"
    of_ends = (entry for entry in LEDGER if isinstance(entry, OutcomeFinding) and entry.refuses)
    return next((e for e in of_ends if e.listed(engine) and re.search(e.refuses, text, re.DOTALL)), None)


def explain_pressure(case: str, table: EOSTable, state: EosState, comparison: Comparison) -> Finding | None:
    """Return the entry whose variant is within the bound on every atom."""
    for entry in LEDGER:
        if isinstance(entry, LawFinding) and entry.covers(case):
            ratio_n = excess(comparison.lammps_n, entry.variant(table, state), comparison.bound_n)[1]
            if bool(np.all(ratio_n <= 1)):
                return entry
    return None
