"""``adopt.html``: an engine taken in, on one page."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from lammps_cases.records import wording
from lammps_cases.records.levels import SEVERITIES
from lammps_cases.report.pages import frame
from lammps_cases.versions.intake.record import Adoption

ASSETS = Path(__file__).with_name("assets")
ORDER = ("there", "gone in some cases", "gone", "not asked")


def render(adoption: Adoption) -> str:
    """Return the page of an engine that was taken in."""
    rows = sorted(adoption.findings, key=lambda row: (ORDER.index(row.status), SEVERITIES.index(row.severity), row.id))
    return frame.page(
        ASSETS,
        "adopt",
        "bad" if adoption.unexplained or adoption.faults else "good",
        engine=adoption.engine.label,
        adoption=adoption,
        rows=rows,
        reactions=dict(sorted(Counter(row.reaction for row in adoption.inputs).items())),
        lacks=wording.lacks(adoption.faults),
        claims=Counter(row.verdict for row in adoption.claims),
    )
