"""What to do about a finding on an audited deck: what is possible there and not yet done, and a version without it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from lammps_cases.findings import KNOWN, Finding
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.findings.thermal import HEAT_OVER_DENSITY
from lammps_cases.findings.walls import WALL_VELOCITY_LOST
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import number


def advice(finding: Finding, case: CaseRecord) -> str:
    """Return what to do about a finding on a deck, and the last version of LAMMPS without it; empty if nothing."""
    to_do = _OF_DECK.get(finding.id, _general)(finding, case)
    return " ".join(filter(None, (to_do, "" if _VERSION.search(to_do) else _without(finding))))


_VERSION = re.compile(r"\b20\d\d\.\d")  # a workaround that names versions itself


def _without(finding: Finding) -> str:
    last = next((engine for engine in reversed(KNOWN) if engine not in finding.engines), "")
    return f"LAMMPS {last} does not have this bug." if last and finding.engines else ""


def _general(finding: Finding, case: CaseRecord) -> str:
    return finding.workaround


def _unit_volumes(finding: Finding, case: CaseRecord) -> str:
    """Name the volumes that are not 1: if all are, there is nothing left to choose."""
    known = [(law.type, law.mass / law.rho0) for law in case.laws if law.mass and law.style != "ideal/gas"]
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
    """Ask for no factor of 1."""
    all_one = bool(case.laws) and all(law.rho0 == 1 for law in case.laws)
    return "rho0 is 1 already; what remains is the mean density of the pair." if all_one else finding.workaround


def _walls(finding: Finding, case: CaseRecord) -> str:
    """Ask for walls at rest where solids are walls: ice moves with the fluid."""
    return "" if any(law.freezes for law in case.laws) else finding.workaround


_OF_DECK: Mapping[str, Callable[[Finding, CaseRecord], str]] = {
    FORCE_PER_VOLUME.id: _unit_volumes,
    HEAT_OVER_DENSITY.id: _over_density,
    WALL_VELOCITY_LOST.id: _walls,
}
