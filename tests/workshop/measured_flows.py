"""What `eos-ref advise` expects of flows, out of measured tables: ``python -m tests.workshop.measured_flows``.

Validated flows and whole codes are those of ``tables_validation.json`` and ``tables_codes.json`` next to this file; the
flows with closed solutions and the costs of a step are the tables of docs/accuracy.md.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from lammps_cases.records.files import DATA, write_atomically
from lammps_cases.studies.chart import codes
from lammps_cases.studies.flows import cavity, waves
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.page import DOCUMENT, LAMMPS, REFERENCE
from lammps_cases.studies.flows.solve import fit
from lammps_cases.studies.stability.choice import EVIDENCE
from tests.workshop.tables_validation import MEASURED

ROOT = Path(__file__).parents[2]
ACCURACY = ROOT / "docs" / "accuracy.md"
SOLVED = {
    "shear wave, heat wave": ("heat-wave",),
    "Taylor-Green vortices": ("taylor-green",),
    "Poiseuille start-up": ("poiseuille",),
    "Couette start-up": ("couette",),
    "tank at rest": ("tank",),
    "stretching drop": ("drop",),
    "two phases at rest": ("interface",),
}
VALIDATED = {"dam-break": "front", "cavity-stored": "u", "convection": "u"}
REYNOLDS = {
    "dam-break": waves.FASTEST / waves.VISCOSITY,
    "cavity-stored": cavity.REYNOLDS,
    codes.SWIRL.name: codes.REYNOLDS,
}
COSTS = "quintic", "shift", "RK1", "RK2", "rho/sum", "thermal"


def row(of: str, n: int, errors: tuple[Any, Any], orders: tuple[Any, Any], page: str) -> dict[str, Any]:
    rounded = [None if e is None or e != e else float(f"{e:.2g}") for e in (*errors, *orders)]
    names = ("reference", "lammps", "order", "order of lammps")
    return {"of": of, "n": n} | dict(zip(names, rounded, strict=True)) | {"page": page}


def solved(text: str) -> dict[str, Any]:
    """The rows of docs/accuracy.md on flows with closed solutions."""
    found = {}
    for line in text.splitlines():
        cells = [cell.strip().strip("*") for cell in line.strip("|").split("|")]
        for name in SOLVED.get(cells[0], ()):
            numbers = [float(re.match(r"[-\d.e]+", cell)[0]) for cell in cells[2:]]
            n = FLOWS[name].resolutions[-1]
            found[name] = row(cells[1], n, (numbers[0], numbers[1]), (numbers[2], numbers[3]), "docs/accuracy.md")
    return found


def validated() -> dict[str, Any]:
    """The flows that are compared with measurements, at their finest resolution."""
    measured, found = DOCUMENT.read(MEASURED), {}
    for name, measure in VALIDATED.items():
        runs = [measured.of(name, side)[-1] for side in (REFERENCE, LAMMPS)]
        orders = [measured.order(name, side, measure).order for side in (REFERENCE, LAMMPS)]
        errors = (runs[0].errors.get(measure), runs[1].errors.get(measure))
        found[name] = row(measure, runs[0].n, errors, (orders[0], orders[1]), "docs/validation.md")
        found[name]["coarsest"] = measured.of(name, REFERENCE)[0].n
    return found


def whole_codes() -> dict[str, Any]:
    """Vortices at a Reynolds number of 100."""
    section = json.loads(MEASURED.with_name("tables_codes.json").read_text(encoding="utf-8"))["sections"][0]
    sides = {of["engine"]: of for of in section["codes"] if of["flow"] == codes.SWIRL.name}
    ours, theirs = (sides[side] for side in ("reference", "lammps"))
    n, errors = ours["resolutions"], [side["errors"]["profile"] for side in (ours, theirs)]
    orders = [fit(n, of).order for of in errors]
    made = row("profile", n[-1], (errors[0][-1], errors[1][-1]), (orders[0], orders[1]), "docs/accuracy.md")
    return {codes.SWIRL.name: made | {"coarsest": n[0]}}


def costs(text: str) -> dict[str, dict[str, float]]:
    """Microseconds of LAMMPS per particle and step, by dimension and option, from docs/accuracy.md."""
    lines = text.partition("(`eos-ref bench model`)")[2].splitlines()
    found: dict[str, dict[str, float]] = {}
    for cells in ([cell.strip() for cell in line.strip("|").split("|")] for line in lines):
        if begin := re.match(r"([23])D, .*: (\w+)", cells[0]):
            of = found.setdefault(begin[1], {})
            cells[0] = begin[2]
        if cells[0] in COSTS and len(of) < len(COSTS):
            of[cells[0]] = float(cells[2].split()[0])
    return found


def evidence() -> dict[str, Any]:
    """All of it, as ``measured-flows.json`` has it."""
    text = ACCURACY.read_text(encoding="utf-8")
    flows = solved(text) | validated() | whole_codes()
    for name, reynolds in REYNOLDS.items():
        flows[name]["reynolds"] = reynolds
    return {"flows": flows, "steps": costs(text), "costs": "docs/accuracy.md, eos-ref bench model"}


if __name__ == "__main__":
    write_atomically(DATA / EVIDENCE, json.dumps(evidence(), indent=1) + "\n")
