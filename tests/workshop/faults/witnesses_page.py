"""The page of `eos-ref witnesses`: every rule of the reference with the cases that depend on it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lammps_cases.pages import frame
from lammps_cases.records.files import write_atomically
from lammps_cases.rules import RULES, SUBJECTS
from tests.workshop.faults.witnesses import ENOUGH, RuleRow

ASSETS = Path(__file__).parent / "assets"


def write(
    rows: Sequence[RuleRow], complaints: Sequence[str], cases: int, folder: Path, command: str, whole: bool = True
) -> None:
    """Write ``witnesses.html``, one file that opens offline; only the ``whole`` of the cases can have too few.

    Of some cases the rules are shown that they witness.
    """
    by_rule = {row.rule: row for row in rows if whole or any(row.cases.values())}
    listed = {
        subject: [by_rule[rule.name] for rule in rules if rule.name in by_rule] for subject, rules in SUBJECTS.items()
    }
    write_atomically(
        folder / "witnesses.html",
        frame.page(
            ASSETS,
            "witnesses",
            "bad" if complaints else "good",
            scripts=[frame.FILTER],
            typed=command,
            complaints=complaints,
            cases=cases,
            number=len(rows),
            shown=len(by_rule),
            whole=whole,
            fewest=sum(bool(row.missing) for row in rows),
            enough=ENOUGH,
            subjects={subject: own for subject, own in listed.items() if own},
            rules=RULES,
        ),
    )
