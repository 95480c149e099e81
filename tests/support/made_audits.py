"""Made-up records of audits."""

from __future__ import annotations

from typing import Any

from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import (
    ActingRecord,
    Blame,
    BreakRecord,
    CheckRecord,
    EffectRecord,
    FieldRecord,
    LostRecord,
    OutlookRecord,
)
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord

HOSTILE = "<b>x</b> *y* | `z` \x1b[31m & ]]>"
BUG, OTHER = "force-per-volume", "heat-is-temperature-rate"


def field(name: str, verdict: Any = "pass", **more: Any) -> FieldRecord:
    values = {"max_abs": 0.0, "max_over_bound": 0.0, "worst_step": 0, "worst_id": 1}
    return FieldRecord(field=name, stage="pair", verdict=verdict, **(values | more))


def deck(name: str = "in.deck", verdict: Any = "pass", fields: int | list[FieldRecord] = 11, **more: Any) -> CaseRecord:
    """An audit with the fields given, by default all inside their bounds."""
    of_fields = [field(f"q{k}") for k in range(fields)] if isinstance(fields, int) else fields
    given = {"fields": of_fields, "tags": ["audit"], "natoms": 1158, "steps": 50}
    return CaseRecord(case=name, verdict=verdict, **(given | more))


def run(*cases: CaseRecord, **more: Any) -> RunRecord:
    return RunRecord(engine=EngineRecord(), reference={}, cases=list(cases), **more).counted()


def effect(relative: float | None, factor: float | None = None, name: str = "f", finding: str = BUG) -> EffectRecord:
    return EffectRecord(finding=finding, field=name, run=1, step=2, particles=7, of=9, relative=relative, factor=factor)


def acting(does: str = "every force is divided by 10 (m/rho0 = 10)", finding: str = BUG) -> ActingRecord:
    return ActingRecord(finding=finding, does=does)


def broke(kind: Any = "not a number", column: str = "vx", value: float = float("nan"), **more: Any) -> BreakRecord:
    given = {"run": 1, "step": 20, "atom": 54, "particles": 3, "of": 144, "both": True}
    return BreakRecord(kind=kind, column=column, value=value, **(given | more))


def lost(ignored: bool, count: int = 800, of: int = 1158, step: int = 50) -> LostRecord:
    return LostRecord(lost=count, of=of, run=1, step=step, ignored=ignored)


def outlook(cause: Any, *findings: str, because: str = "") -> OutlookRecord:
    return OutlookRecord(
        cause=cause, because=because, findings=list(findings), run=1, step=0, taken=20, after=2, steps=100
    )


def blame(name: str = "shift/v", step: int = 0) -> Blame:
    return Blame(field=name, step=step, run=1, atom=3, outside=43, of=256, max_abs=0.1, max_over_bound=1e9, worst_id=3)


def everything() -> CaseRecord:
    """An audit with a message of every kind, quoting words from an untrusted deck."""
    check = {"run": 1, "field": "q0", "type": 0, "verdict": "pass", "max_abs": 0.0}
    looks = [
        CheckRecord(step=0, natoms=1158, max_over_bound=0.0, worst_id=1, **check),
        CheckRecord(step=10, natoms=700, max_over_bound=0.5, worst_id=2, **check),
        CheckRecord(step=20, natoms=358, max_over_bound=0.1, worst_id=2, **check),
    ]
    case = deck(
        verdict="refused",
        ended="refused",
        engine_error="ERROR: Lost atoms: original 1158 current 358 (in.deck:4)",
        fields=[field("q0", max_over_bound=0.5, worst_step=10, until=40), field("pressure", "exact", max_abs=3e-14)],
        checks=looks,
        broke=broke(),
        lost=lost(ignored=True),
        outlook=outlook("findings", BUG),
        effects=[effect(4e4, 4e4)],
        acting=[acting("conduction is 16 times too fast", OTHER)],
        warnings=[f"a mass does not fit {HOSTILE}", "the density was never set"],
        stability=["time step is 104 % of the limit"],
        unchecked={"f": f"fix 7 ({HOSTILE}) adds to it", "chi": "no such feature"},
        out_of_scope=["chi"],
        reproduce="eos-ref audit in.deck",
    )
    case.message = case_wording.message(case)
    return case
