"""Severities of findings and the levels of ``--fail-on``: plain words, for which nothing else is loaded."""

from __future__ import annotations

from typing import Literal, get_args

Severity = Literal["high", "medium", "low"]  # of findings
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
FailOn = Literal["high", "medium", "low", "new"]  # the least severity of known findings that fails; new: none does
FAIL_ON: tuple[FailOn, ...] = get_args(FailOn)


def fails(severity: Severity, fail_on: FailOn) -> bool:
    """Return whether a known finding of some severity makes the exit code 1."""
    return fail_on != "new" and SEVERITIES.index(severity) <= SEVERITIES.index(fail_on)
