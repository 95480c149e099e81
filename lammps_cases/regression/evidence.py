"""What the accepted runs show of the findings: ``python -m lammps_cases.regression.evidence`` writes it down.

``findings/shown_by.json`` holds the cases that show each finding, ``findings/engines.json`` the versions it was seen
on, README.md a table of all findings. `eos-ref accept` and `eos-ref adopt` write them anew after they have changed the
baselines of this repository.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from packaging.version import Version

from lammps_cases.findings import KNOWN, LEDGER, SHOWN_BY, Finding, engines
from lammps_cases.findings.entry import Severity
from lammps_cases.records.files import write_atomically
from lammps_cases.regression import baseline

ROOT = Path(__file__).parents[2]
BASELINES = ROOT / "reports" / "accepted"
README = ROOT / "README.md"
BEGIN, END = "<!-- findings:begin -->\n", "<!-- findings:end -->\n"


@dataclass(frozen=True)
class Evidence:
    """What the accepted runs show.

    Attributes
    ----------
    engines : versions of LAMMPS that are known, oldest first
    cases : by finding, the cases that show it, on whichever engine
    seen_on : by finding, the engines that it was seen on; also, of one that only probes show, by an earlier intake
    """

    engines: tuple[str, ...]
    cases: dict[str, list[str]]
    seen_on: dict[str, tuple[str, ...]]


def collect(baselines: Path, ledger: Sequence[Finding] = LEDGER) -> Evidence:
    """Gather what the accepted runs show of the findings.

    Raises
    ------
    InputError
        A damaged baseline.
    """
    cases: dict[str, set[str]] = defaultdict(set)
    seen_on: dict[str, set[str]] = defaultdict(set, {entry.id: set(entry.engines) for entry in ledger})
    versions = set(KNOWN)
    for identity in sorted(baselines.glob(f"[!.]*/{baseline.IDENTITY}")):
        side = baseline.read(identity.parent)
        version = side.engine.distribution
        versions |= {version} - {""}
        for case in side.cases.values():
            of_fields = (finding for field in case.fields.values() for finding in field.explained_by)
            for finding in (*case.explained_by, *of_fields):
                cases[finding].add(case.case)
                seen_on[finding] |= {version} - {""}
    order = tuple(sorted(versions, key=Version))
    return Evidence(
        order,
        {entry.id: sorted(cases[entry.id]) for entry in ledger},
        {entry.id: tuple(engine for engine in order if engine in seen_on[entry.id]) for entry in ledger},
    )


def table(evidence: Evidence, ledger: Sequence[Finding] = LEDGER) -> str:
    """Return the findings as a table in Markdown, the most severe first."""
    order = get_args(Severity)
    lines = ["| severity | finding | versions | cases |\n", "|---|---|---|---|\n"]
    for entry in sorted(ledger, key=lambda entry: (-order.index(entry.severity), entry.id)):
        seen_on = evidence.seen_on[entry.id]
        some = ", ".join(engine.removeprefix("2025.7.22") for engine in seen_on)
        versions = "all" if seen_on == evidence.engines else some
        count = len(evidence.cases[entry.id])
        lines.append(f"| {entry.severity} | {entry.title} (`{entry.id}`) | {versions} | {count} |\n")
    return "".join(lines)


def documents(baselines: Path = BASELINES, ledger: Sequence[Finding] = LEDGER) -> dict[Path, str]:
    """Return the files that follow from the ledger and the accepted runs, with their content."""
    evidence = collect(baselines, ledger)
    head, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    tail = rest.partition(END)[2]
    return {
        SHOWN_BY: json.dumps(evidence.cases, indent=1) + "\n",
        engines.FILE: engines.document(evidence.engines, evidence.seen_on),
        README: f"{head}{BEGIN}{table(evidence, ledger)}{END}{tail}",
    }


def publish() -> None:
    """Write the files that follow from the ledger and the accepted runs of this repository."""
    for path, content in documents().items():
        write_atomically(path, content)


if __name__ == "__main__":
    publish()
