"""Severities of findings and the levels of ``--fail-on``: plain words, which need no other module.

On a deck the severity of a finding follows from its effect: ``high`` above 10 % of the largest right value of some
field, or where the effect is unknown, ``medium`` above 1 %, else ``low``.
"""

from __future__ import annotations

import math
from typing import Literal, get_args

State = Literal["PASS", "KNOWN BUGS", "FAIL", "EMPTY"]  # of whatever is judged
Severity = Literal["high", "medium", "low"]  # of findings
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
FailOn = Literal["high", "medium", "low", "new"]  # the least severity of known findings that fails; new: none does
FAIL_ON: tuple[FailOn, ...] = get_args(FailOn)
EFFECT = r"[0-9]{1,6}(\.[0-9]{1,12})?%"  # of a finding on a deck, above which it fails
LARGEST = {"high": 0.1, "medium": 0.01, "low": 0.0, "new": math.inf}  # effects on a deck that do not fail


def fails(severity: Severity, fail_on: str) -> bool:
    """Return whether a known finding of some severity makes the exit code 1."""
    return fail_on in SEVERITIES and SEVERITIES.index(severity) <= SEVERITIES.index(fail_on)


def allowed(fail_on: str) -> float:
    """Return the largest effect on a deck, over the largest right value of a field, that a level accepts."""
    return LARGEST[fail_on] if fail_on in LARGEST else float(fail_on.rstrip("%")) / 100


def severity_of(effect: float) -> Severity:
    """Return the severity of a finding with some effect on a deck; infinite: unknown."""
    return next((severity for severity in SEVERITIES if effect > LARGEST[severity]), "low")
