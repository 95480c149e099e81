"""Statements of an audit about a deck in addition to the verdicts of its fields, the same in every output.

For a known bug: its effect on the deck, the workarounds possible and not yet used there, and a version without it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple, get_args

from eos_ref.eos.registry import LAWS
from lammps_cases.findings import KNOWN, LEDGER, Finding
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.findings.thermal import HEAT_OVER_DENSITY
from lammps_cases.findings.walls import WALL_VELOCITY_LOST
from lammps_cases.records import case_wording, deck_wording
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import number
from lammps_cases.scene.fields import FIELDS

_VERSION = re.compile(r"\b20\d\d\.\d")  # a workaround that names versions itself
Subject = Literal["state", "lost atoms", "stopped", "known bug", "warning", "stability", "not checked"]
SUBJECTS: tuple[Subject, ...] = get_args(Subject)  # the most important first
NEVER = {name: field.unaudited for name, field in FIELDS.items() if field.unaudited}  # with the reasons


def advice(finding: Finding, case: CaseRecord) -> str:
    """Return what to do about a finding on a deck, and the last version of LAMMPS without it; empty if nothing."""
    to_do = _OF_DECK[finding.id](finding, case) if finding.id in _OF_DECK else finding.workaround
    last = next((engine for engine in reversed(KNOWN) if engine not in finding.engines), "")
    names_versions = _VERSION.search(to_do) is not None
    without = f"LAMMPS {last} does not have this bug." if last and finding.engines and not names_versions else ""
    return " ".join(filter(None, (to_do, without)))


def _unit_volumes(finding: Finding, case: CaseRecord) -> str:
    """Name the volumes other than 1; if there are no such volumes, nothing is left to choose."""
    known = [(law.type, law.mass / law.rho0) for law in case.laws if law.mass and LAWS[law.style].takes_cs]
    if not known or len(known) < len(case.laws):
        return finding.workaround
    off: dict[str, list[str]] = {}
    for t, volume in known:
        if not math.isclose(volume, 1, rel_tol=1e-9):
            off.setdefault(number(volume), []).append(str(t))
    if not off:
        return "m/rho0 is 1 already; what remains is the factor rho/rho0."
    values = ", ".join(f"{volume} (type{'s' * (len(types) > 1)} {', '.join(types)})" for volume, types in off.items())
    return f"{finding.workaround} Here it is {values}."


def _over_density(finding: Finding, case: CaseRecord) -> str:
    """Return the workaround unless all densities, the factors, are already 1."""
    all_one = bool(case.laws) and all(law.rho0 == 1 for law in case.laws)
    return "rho0 is 1 already; what remains is the mean density of the pair." if all_one else finding.workaround


def _walls(finding: Finding, case: CaseRecord) -> str:
    """Recommend walls at rest, unless solids may be ice, which moves with the fluid."""
    return "" if any(law.freezes for law in case.laws) else finding.workaround


_OF_DECK: Mapping[str, Callable[[Finding, CaseRecord], str]] = {
    FORCE_PER_VOLUME.id: _unit_volumes,
    HEAT_OVER_DENSITY.id: _over_density,
    WALL_VELOCITY_LOST.id: _walls,
}


class Statement(NamedTuple):
    """One line about a deck; for a known bug with its name."""

    subject: Subject
    text: str
    finding: str = ""

    def __str__(self) -> str:
        return f"{self.subject}{f' {self.finding}' if self.finding else ''}: {self.text}"


def statements(case: CaseRecord, never: Mapping[str, str] | None = None) -> list[Statement]:
    """Return all statements about an audited deck, the most important first; empty for other cases.

    Fields that are ``never`` checked, with the reason of each, share one line without it.
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
    """Describe, by finding, the effect of each on a deck, or else in general, and what to do about it."""
    does, ledger = deck_wording.effects(case), {entry.id: entry for entry in LEDGER}
    said = {}
    for finding in deck_wording.bugs(case):
        entry = ledger.get(finding)
        sentences = [does.get(finding) or (entry.effect if entry else "acts on this deck")]
        sentences += [advice(entry, case)] if entry else []
        said[finding] = ". ".join(filter(None, sentences))
    return said
