"""The page of random scenes: verdicts, what is red, findings, the choices that were drawn least."""

from __future__ import annotations

from pathlib import Path

from tests.workshop.fuzz.record import FuzzRecord
from lammps_cases.pages import frame
from lammps_cases.records import wording
from lammps_cases.records.files import write_atomically

ASSETS = Path(__file__).parent / "assets"
RAREST = 12


def write(record: FuzzRecord, folder: Path) -> Path:
    """Write ``fuzz.html``, one file that opens offline."""
    html = frame.page(
        ASSETS,
        "fuzz",
        "bad" if record.red else "good",
        engine=record.engine.label,
        record=record,
        described=wording.engine(record.engine),
        verdicts=dict(sorted(record.verdicts.items())),
        findings=sorted(record.findings.items(), key=lambda item: -item[1]),
        rarest=sorted(record.choices.items(), key=lambda item: item[1])[:RAREST],
        drawn=sum(map(bool, record.choices.values())),
    )
    path = folder / "fuzz.html"
    write_atomically(path, html)
    return path
