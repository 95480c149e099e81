"""The page of validations, and its pictures as files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from lammps_cases.pages import frame
from lammps_cases.pages.figures import saved
from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import brief
from lammps_cases.studies.validation import VALIDATIONS, draw
from lammps_cases.studies.validation.model import FlowQuantity, Validation
from lammps_cases.studies.validation.record import LAMMPS, REFERENCE, UNIT, Validated

ASSETS = Path(__file__).parent / "assets"


def write(validated: Validated, folder: Path) -> None:
    """Write ``report.html`` and ``figures/*.svg|png``."""
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    flows = [VALIDATIONS[name] for name in validated.flows]
    html = frame.page(
        ASSETS,
        "validate",
        "good",
        engine=validated.engine.get("distribution", ""),
        validated=validated,
        flows=flows,
        facts=_facts(validated),
        pictures={of.name: saved(draw.figure(validated, of), figures, of.name) for of in flows},
        effects={of.name: list(effects(validated, of)) for of in flows},
        value=lambda number: f"{number:.4g}" if math.isfinite(number) else "",
        sides=(REFERENCE, LAMMPS),
        navigation=[(of.name, of.title) for of in flows],
        nan=math.nan,
    )
    write_atomically(folder / "report.html", html)


def _facts(validated: Validated) -> list[tuple[str, str]]:
    machine = validated.machine
    engine = validated.engine
    return [
        ("LAMMPS", engine.get("distribution") or engine.get("version_string", "")),
        ("processor", f"{machine['processor']}, {machine['cores']} cores"),
        ("took", f"{validated.seconds:.0f} s" + (" (quick)" if validated.quick else "")),
    ]


def effects(validated: Validated, of: Validation) -> Iterator[str]:
    """Yield what LAMMPS, and each of its findings alone, does to the quantities of a flow, in words.

    Of a side that stopped, why, and the quantities at the finest resolution at which it did not.
    """
    for side in validated.sides(of.name):
        if side == REFERENCE:
            continue
        runs = validated.of(of.name, side)
        if runs[-1].message:
            yield f"{_who(side)} {stopped(validated, of.name, side)}"
        run = next((run for run in reversed(runs) if not run.message), None)
        if run is None:
            continue
        beside = next((ours for ours in validated.of(of.name, REFERENCE) if ours.n == run.n), None)
        for quantity in of.quantities:
            if beside is not None and quantity.name in beside.quantities:
                ours, theirs = beside.quantities[quantity.name], run.quantities[quantity.name]
                yield f"{_who(side)}, {run.n}: {quantity.name} {_change(theirs, ours, quantity)}"


def stopped(validated: Validated, flow: str, side: str) -> str:
    """Say why a side has no numbers: of LAMMPS the findings with which the reference loses particles too."""
    *_, last = runs = validated.of(flow, side)
    run = next((run for run in runs if run.lost), last)
    if not run.lost:
        return f"stopped at {run.n} particles: {run.message}"
    names = " and ".join(run.lost.findings)
    how = "alone" if len(run.lost.findings) == 1 else "together"
    too = f"so does the reference with {names} {how}, after step {run.lost.after}"
    none = "the reference does not, with none of the findings tried"
    return f"loses atoms after step {run.lost.step}, at {run.n} particles; {too if names else none}"


def _who(side: str) -> str:
    """Return a side as the beginning of a sentence."""
    if side == UNIT:
        return "LAMMPS where the same particles are 0.75 apart"
    return side if side == LAMMPS else f"The reference with {side}"


def _change(theirs: float, ours: float, quantity: FlowQuantity) -> str:
    """Say one number in place of another, and how far that is from it."""
    found = quantity.absent if math.isnan(theirs) else brief(theirs)
    words = f"{found} in place of the reference's {brief(ours)}"
    if ours and math.isfinite(theirs / ours):
        change = 100 * (theirs / ours - 1)
        words += f", {change:+.0f} %" if abs(change) >= 10 else f", {change:+.1g} %"
    return words if quantity.published is None else f"{words} (should be {brief(quantity.published)})"
