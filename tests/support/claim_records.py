"""Handmade records of cases, as a run would leave them."""

from __future__ import annotations

from collections.abc import Sequence

from lammps_cases.claims.probes import manual
from lammps_cases.findings import LEDGER
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case

CASES: dict[str, Case] = {case.name: case for case in casefile.load()}
PROBES = {probe.name: probe for probe in manual.probes()}
KNOWN = (*CASES, *PROBES)
# Cases that LAMMPS refuses, or in which it crashes, although the scene does not expect it.
WITHOUT_NUMBERS = {name for name in CASES for entry in LEDGER if entry.outcome is not None and entry.covers(name)}


def fields_of(case: Case) -> tuple[str, ...]:
    """The fields in the record of a case."""
    given = ("esph",) if case.scene.energy is not None or hasattr(case.scene.positions, "extxyz") else ()
    return case.scene.compare if case.scene.whole_model else ("type", "rho", *given, "pressure_used", "pressure")


def field(name: str, verdict: str = "pass", explained_by: Sequence[str] = ()) -> FieldRecord:
    """A field, well within its bound or a thousand times outside."""
    ratio = 0.1 if verdict in ("exact", "pass") else 1e3
    return FieldRecord.model_validate(
        {
            "field": name,
            "stage": "made",
            "verdict": verdict,
            "max_abs": ratio,
            "max_over_bound": ratio,
            "worst_id": 1,
            "explained_by": explained_by,
        }
    )


def good(name: str) -> CaseRecord:
    """The record of a case or probe that agrees with the manual."""
    if name in PROBES:
        return CaseRecord(case=name, verdict="pass", expects=PROBES[name].refused)
    case = CASES[name]
    if case.scene.expect:
        return CaseRecord(case=name, verdict="refused", expects=case.scene.expect.refused)
    return CaseRecord(case=name, verdict="pass", natoms=9, fields=[field(f) for f in fields_of(case)])


def all_good() -> dict[str, CaseRecord]:
    """A run of a LAMMPS that follows its manual."""
    return {name: good(name) for name in KNOWN}


def wrong(name: str, fields: tuple[str, ...] = (), findings: Sequence[str] = ()) -> CaseRecord:
    """The record of a case that differs in some fields, or in its ending; findings make it explained."""
    record = good(name)
    verdict = "explained" if findings else "differs"
    if not record.fields:
        return record.model_copy(update={"verdict": verdict, "explained_by": list(findings), "message": "otherwise"})
    chosen = fields or tuple(f.field for f in record.fields)
    made = [field(f.field, verdict, findings) if f.field in chosen else f for f in record.fields]
    return record.model_copy(update={"verdict": verdict, "fields": made})
