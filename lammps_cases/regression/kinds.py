"""The kinds of change, what counts as one, and what is said of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from lammps_cases.records.wording import INSIDE
from lammps_cases.regression.seen import FieldSeen

Kind = Literal[
    "same bits",
    "same outcome",
    "within bounds",
    "changed",
    "judged otherwise",
    "cannot tell",
    "newly refused",
    "newly accepted",
    "newly crashed",
    "no longer crashed",
    "new field",
    "missing field",
    "new case",
    "missing case",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
ABOUT: dict[Kind, str] = {
    "same bits": "every bit of LAMMPS' array at every step compared",
    "same outcome": "a case without numbers, ended the same way",
    "within bounds": "other bits; both within the bound of the reference, or of the same findings",
    "changed": "other numbers, or a case that ended otherwise",
    "judged otherwise": "the same bits, another verdict or finding: the reference or the ledger changed",
    "cannot tell": "one side holds no digests of its arrays, and is outside the bound",
    "newly refused": "LAMMPS refuses what it took",
    "newly accepted": "LAMMPS takes what it refused",
    "newly crashed": "LAMMPS crashes or hangs where it did not",
    "no longer crashed": "LAMMPS crashed or hung, and does no more",
    "new field": "compared on side B alone",
    "missing field": "compared on side A alone",
    "new case": "of side B alone",
    "missing case": "of side A alone",
}
NEWS: tuple[Kind, ...] = ("new field", "new case")
Closer = Literal["A", "B", "both", "neither"]


def judged(field: FieldSeen) -> tuple[str, tuple[str, ...]]:
    """What a verdict says of LAMMPS: inside the bound, explained by some findings, or neither."""
    return ("inside", ()) if field.verdict in INSIDE else (field.verdict, field.findings)


@dataclass(frozen=True)
class Policy:
    """What is held against side B.

    Attributes
    ----------
    bits : other bits within bounds, and an exact field that is only within its bound
    findings : the same bits explained by other findings (those of the case, which other fields may have brought in)
    news : cases and fields that side A does not hold
    """

    bits: bool = False
    findings: bool = False
    news: bool = True

    def alike(self, one: FieldSeen, other: FieldSeen) -> bool:
        """Whether the same bits were judged the same."""
        if self.bits and one.verdict != other.verdict:
            return False
        if self.findings and one.findings != other.findings:
            return False
        return judged(one)[0] == judged(other)[0]

    def faults(self, kind: Kind) -> bool:
        """Whether a change of some kind is one."""
        if kind in ("same bits", "same outcome"):
            return False
        return self.bits if kind == "within bounds" else self.news or kind not in NEWS


@dataclass(frozen=True)
class Change:
    """One field of a case, or the case as a whole (``field`` empty), on both sides.

    Attributes
    ----------
    closer : the side that agrees with the reference, or is closer to it; of a twin: whose two runs agree
    verdicts, findings, over_bound : of A and of B; a verdict is empty where a side has none
    step : the first at which the bits part
    fault : whether it is held against B
    difference : largest difference of the two LAMMPS arrays, over the bound, at the worst step if both kept that
    """

    case: str
    field: str
    kind: Kind
    closer: Closer = "neither"
    stage: str = ""
    verdicts: tuple[str, str] = ("", "")
    findings: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    over_bound: tuple[float | None, float | None] = (None, None)
    step: int | None = None
    difference: float | None = None
    note: str = ""
    fault: bool = False
