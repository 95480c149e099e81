"""Handmade findings."""

from __future__ import annotations

from typing import Any

from lammps_cases.findings.entry import Finding, Law, LawFinding, ModelFinding
from lammps_cases.findings.variants import Variant
from lammps_cases.records.levels import Severity

TEXTS: dict[str, Any] = dict.fromkeys(
    ("title", "effect", "remedy", "documented", "observed", "argument", "workaround"), ""
)


def finding(
    name: str,
    number: int = 1,
    severity: Severity = "low",
    law: Law | None = None,
    model: Variant | None = None,
    **more: Any,
) -> Finding:
    """A finding without text, of the kind of its variant."""
    texts = TEXTS | more
    if law is not None:
        return LawFinding(id=name, number=number, severity=severity, variant=law, **texts)
    if model is not None:
        return ModelFinding(id=name, number=number, severity=severity, variant=model, **texts)
    return Finding(id=name, number=number, severity=severity, **texts)
