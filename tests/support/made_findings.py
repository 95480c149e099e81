"""Findings made by hand."""

from __future__ import annotations

from typing import Any

from lammps_cases.findings import Finding

TEXTS = dict.fromkeys(("title", "effect", "documented", "observed", "argument", "workaround"), "")


def finding(name: str, number: int = 1, **settings: Any) -> Finding:
    """A finding that says nothing."""
    return Finding(name, number, severity="low", **TEXTS, **settings)
