"""Handmade sides of comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lammps_cases.records.case_parts import Ended, Verdict, as_expected
from lammps_cases.records.outcome import CaseOutcome, FieldOutcome, StepOutcome
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.versions.outcomes import Sample, Samples, Side


def field(
    name: str = "f",
    verdict: Verdict = "pass",
    bits: str = "aa",
    over: float | None = 0.5,
    findings: Sequence[str] = (),
    steps: Sequence[tuple[int, Verdict, str]] = (),
) -> FieldOutcome:
    at = tuple(StepOutcome(step, of_step, bits_of_step) for step, of_step, bits_of_step in steps)
    return FieldOutcome(name, verdict, tuple(findings), over, bits, "pair", at)


def case(name: str, *fields: FieldOutcome, seconds: float = 0.0) -> CaseOutcome:
    return CaseOutcome(name, "pass", True, seconds=seconds, fields={f.field: f for f in fields})


def ended(
    how: Ended,
    verdict: Verdict,
    expects: str = "",
    message: str = "",
    findings: Sequence[str] = (),
    name: str = "one",
) -> CaseOutcome:
    return CaseOutcome(name, verdict, as_expected(verdict, expects), how, tuple(findings), expects, message)


class Kept(Samples):
    """Arrays in memory."""

    def __init__(self, **arrays: Sample) -> None:
        super().__init__()
        self.arrays = arrays

    def of(self, field: str) -> Sample | None:
        return self.arrays.get(field)


def sample(*values: float, bound: float = 1.0, step: int | None = None) -> Sample:
    return Sample(step, np.array(values), np.full(len(values), bound))


def side(*cases: CaseOutcome, name: str = "side", **more: Any) -> Side:
    kept: Kept = more.pop("kept", Kept())
    engine = EngineRecord(version_string="20250722", distribution=more.pop("version", "1"))
    return Side(name, engine, {"eos-ref": "0.1.0"}, {c.case: c for c in cases}, lambda case: kept)
