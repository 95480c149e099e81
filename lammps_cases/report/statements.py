"""What an audit says of a deck beside the verdicts of its fields: the same statements in every output."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

from lammps_cases.findings import LEDGER
from lammps_cases.records import case_wording, deck_wording
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.report.advice import advice
from lammps_cases.scene.fields import FIELDS

Subject = Literal["state", "lost atoms", "stopped", "known bug", "warning", "stability", "not checked"]
SUBJECTS: tuple[Subject, ...] = get_args(Subject)  # what matters most first
NEVER = {name: field.unaudited for name, field in FIELDS.items() if field.unaudited}  # and why


class Statement(NamedTuple):
    """One line on a deck; of a known bug with its name."""

    subject: Subject
    text: str
    finding: str = ""

    def __str__(self) -> str:
        return f"{self.subject}{f' {self.finding}' if self.finding else ''}: {self.text}"


def statements(case: CaseRecord, never: Mapping[str, str] | None = None) -> list[Statement]:
    """Return all that is said of an audited deck, what matters most first; nothing of other cases.

    Fields that ``never`` are checked, with the reason of each, stand in one line without it.
    """
    if "audit" not in case.tags:
        return []
    said: dict[Subject, list[str]] = {
        "state": [deck_wording.broke_at_length(case.broke)] if case.broke else [],
        "lost atoms": [deck_wording.lost(case.lost)] if case.lost and case.lost.ignored else [],
        "stopped": [case_wording.outlook(case)] if case.outlook else [],
        "warning": case.warnings,
        "stability": case.stability,
        "not checked": deck_wording.unchecked(case, never),
    }
    lines = [Statement(subject, line) for subject, of_subject in said.items() for line in of_subject]
    lines += [Statement("known bug", text, finding) for finding, text in known_bugs(case).items()]
    return sorted(lines, key=lambda line: SUBJECTS.index(line.subject))


def known_bugs(case: CaseRecord) -> dict[str, str]:
    """Say, by finding, what each does to a deck, or else in general, and what to do about it."""
    does, ledger = deck_wording.effects(case), {entry.id: entry for entry in LEDGER}
    said = {}
    for finding in deck_wording.bugs(case):
        entry = ledger.get(finding)
        sentences = [does.get(finding) or (entry.effect if entry else "acts on this deck")]
        sentences += [advice(entry, case)] if entry else []
        said[finding] = ". ".join(filter(None, sentences))
    return said
