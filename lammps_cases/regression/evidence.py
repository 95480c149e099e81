"""What the accepted runs show of the findings: ``python -m lammps_cases.regression.evidence`` writes it down.

``findings/shown_by.json`` holds the cases that show each finding, README.md a table of all findings. `eos-ref accept`
writes both anew after it has changed the baselines of this repository.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import get_args

from lammps_cases.findings import KNOWN, LEDGER, SHOWN_BY, Finding
from lammps_cases.findings.entry import Severity
from lammps_cases.records.files import write_atomically
from lammps_cases.regression import baseline

ROOT = Path(__file__).parents[2]
BASELINES = ROOT / "reports" / "accepted"
README = ROOT / "README.md"
BEGIN, END = "<!-- findings:begin -->\n", "<!-- findings:end -->\n"
Shown = Mapping[str, Sequence[str]]  # id of a finding: cases


def shown_by(baselines: Path, ledger: Sequence[Finding] = LEDGER) -> dict[str, list[str]]:
    """List the cases of the accepted runs, of whichever engine, that show each finding.

    Raises
    ------
    InputError
        A damaged baseline.
    """
    cases: dict[str, set[str]] = defaultdict(set)
    for identity in sorted(baselines.glob(f"[!.]*/{baseline.IDENTITY}")):
        for case in baseline.read(identity.parent).cases.values():
            of_fields = (finding for field in case.fields.values() for finding in field.explained_by)
            for finding in (*case.explained_by, *of_fields):
                cases[finding].add(case.case)
    return {entry.id: sorted(cases[entry.id]) for entry in ledger}


def table(shown: Shown, ledger: Sequence[Finding] = LEDGER) -> str:
    """Return the findings as a table in Markdown, the most severe first."""
    order = get_args(Severity)
    lines = ["| severity | finding | wheels | cases |\n", "|---|---|---|---|\n"]
    for entry in sorted(ledger, key=lambda entry: (-order.index(entry.severity), entry.id)):
        some = ", ".join(engine.removeprefix("2025.7.22") for engine in entry.engines)
        wheels = "all" if entry.engines == KNOWN else some
        lines.append(f"| {entry.severity} | {entry.title} (`{entry.id}`) | {wheels} | {len(shown[entry.id])} |\n")
    return "".join(lines)


def documents(baselines: Path = BASELINES, ledger: Sequence[Finding] = LEDGER) -> dict[Path, str]:
    """Return the files that follow from the ledger and the accepted runs, with their content."""
    shown = shown_by(baselines, ledger)
    head, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    tail = rest.partition(END)[2]
    return {SHOWN_BY: json.dumps(shown, indent=1) + "\n", README: f"{head}{BEGIN}{table(shown, ledger)}{END}{tail}"}


def publish() -> None:
    """Write the files that follow from the ledger and the accepted runs of this repository."""
    for path, content in documents().items():
        write_atomically(path, content)


if __name__ == "__main__":
    publish()
