"""Traceability both ways: claims without a case, and cases without a claim."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from lammps_cases.claims.model import Claim, without_claim
from lammps_cases.claims.verdicts import Names


@dataclass(frozen=True)
class Trace:
    """What leads nowhere.

    Attributes
    ----------
    untestable : claims without a case, and why
    dangling : patterns of claims that fit no case
    unclaimed : cases without a claim, and why; empty where nobody has said it
    stale : reasons given for cases that have a claim, or are no cases
    """

    untestable: dict[str, str]
    dangling: dict[str, list[str]]
    unclaimed: dict[str, str]
    stale: list[str]

    @property
    def complete(self) -> bool:
        """Whether everything has its counterpart or its reason."""
        return not self.dangling and not self.stale and all(self.unclaimed.values())


def trace(claims: Sequence[Claim], cases: Iterable[str]) -> Trace:
    """Follow claims to cases (and probes), and back."""
    names = Names(cases)
    every = {name for names_of in names.by_head.values() for name in names_of}
    dangling = {c.id: [p for p in c.cases if not names.matching(p)] for c in claims}
    claimed = {name for claim in claims for name in names.of(claim)}
    reasons: dict[str, str] = {}
    stale = []
    for pattern, why in without_claim().items():
        fits = [name for name in names.matching(pattern) if name not in claimed]
        reasons |= dict.fromkeys(fits, why)
        if not fits:
            stale.append(pattern)
    return Trace(
        {claim.id: claim.untestable for claim in claims if claim.untestable},
        {id: patterns for id, patterns in dangling.items() if patterns},
        {name: reasons.get(name, "") for name in sorted(every - claimed)},
        stale,
    )
