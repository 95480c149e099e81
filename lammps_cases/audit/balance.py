"""What the budgets of a deck say: what is conserved, what makes the difference to a closed solution."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lammps_cases.audit.closed import deviation
from lammps_cases.audit.rerun import AS_IT_IS
from lammps_cases.records.case_parts import BudgetPart, BudgetRecord, ClosedRecord, SeriesRecord
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import number

LAMMPS = "LAMMPS"


@dataclass(frozen=True)
class Conserved:
    """A sum that is 0 where the formulas conserve a quantity, in the sample in which it is largest.

    Attributes
    ----------
    quantity : its name
    kept : whether rounding alone makes it in every sample
    share : the sum over that of its absolute terms, by the formulas
    broken_by : findings that change it, with the share by which
    """

    quantity: str
    kept: bool
    share: float
    broken_by: dict[str, float]


@dataclass(frozen=True)
class Part:
    """What one change of the reference does to the deviation from a closed solution, all at one step.

    ``deviation`` is the run's own, ``contribution`` what the changed thing adds to it; None if the run broke off.
    """

    name: str
    step: int
    deviation: float | None
    contribution: float | None
    ended: str


def conserved(budgets: Sequence[BudgetRecord]) -> Iterator[Conserved]:
    """Go through what the formulas may conserve."""
    for quantity in budgets[0].residual if budgets else ():
        shares = [_share(abs(of.residual[quantity]), _size(of, quantity)) for of in budgets]
        kept = all(abs(of.residual[quantity]) <= of.bound[quantity] for of in budgets)
        broken: dict[str, float] = {}
        for of in budgets:
            for finding in of.findings:
                change = _share(_change(of, finding, quantity), _size(of, quantity))
                if _change(of, finding, quantity) > of.bound[quantity]:
                    broken[finding.name] = max(change, broken.get(finding.name, 0.0))
        yield Conserved(quantity, kept, max(shares), broken)


def _share(of: float, size: float) -> float:
    return of / size if size else 0.0


def _size(of: BudgetRecord, quantity: str) -> float:
    """Return what a sum is measured by: the forces of pairs, or the powers of the parts."""
    if quantity == "momentum":
        return of.size
    return sum(abs(part.power) + abs(part.storage) + abs(part.heat) for part in of.parts)


def _change(of: BudgetRecord, finding: BudgetPart, quantity: str) -> float:
    if quantity == "momentum":
        return max((abs(a - b) for a, b in zip(finding.force, of.pairs.force, strict=True)), default=0.0)
    if quantity == "heat":
        return abs(finding.heat - of.pairs.heat)
    return abs(finding.power + finding.storage - of.pairs.power - of.pairs.storage)


def measured(case: CaseRecord) -> SeriesRecord:
    """Return LAMMPS' own run as a series: its samples of the last run."""
    own = [of for of in case.budgets if of.run == case.budgets[-1].run]
    return SeriesRecord(
        name=LAMMPS,
        steps=[of.step - own[0].step for of in own],
        kinetic=[of.kinetic for of in own],
        momentum=[of.momentum for of in own],
    )


def parts(case: CaseRecord) -> list[Part]:
    """Return the deviation of every run from the closed solution, LAMMPS' own first; empty without one."""
    exact = case.closed
    if exact is None or not case.series:
        return []
    right = next(series for series in case.series if series.name == AS_IT_IS)
    deviations = []
    for series in [measured(case), *case.series]:
        own = deviation(exact, series)
        at = max((step for step in series.steps if step in exact.steps), default=0)
        reference = deviation(exact, right, at) if at else None
        away = None if own is None or reference is None or series is right or series.name == LAMMPS else reference - own
        if away is not None and series.findings:  # which such a run has, and the reference as it is has not
            away = -away
        deviations.append(Part(series.name, at, own, away, series.ended))
    return deviations


def log_deviation(exact: ClosedRecord | None, columns: Mapping[str, Sequence[float]]) -> tuple[int, float] | None:
    """Return last step and deviation of a decay by the thermo output of a log; None if it is of something else."""
    energy, steps = columns.get("KinEng", []), columns.get("Step", [])
    if exact is None or not exact.decays or not energy or not all(of > 0 for of in energy[:: len(energy) - 1 or 1]):
        return None
    rate = math.log(exact.values[-1] / exact.values[0]) / (exact.steps[-1] - exact.steps[0])
    return int(steps[-1]), math.log(energy[-1] / energy[0]) / (steps[-1] - steps[0]) / rate - 1


def dissipated(budgets: Sequence[BudgetRecord]) -> dict[str, float]:
    """Return what each part of the model does to the energy on average over the samples, by name."""
    totals: dict[str, float] = {}
    for of in budgets:
        for part in of.parts:
            totals[part.name] = totals.get(part.name, 0.0) + (part.power + part.storage) / len(budgets)
    return totals


def percent(of: float | None) -> str:
    """Write a relative difference, without a sign if none is left of it; empty for None."""
    if of is None:
        return ""
    rounded = round(100 * of, 2)
    return f"{rounded:+.2f} %".replace("-", "\N{MINUS SIGN}") if rounded else "0.00 %"


def lines(case: CaseRecord) -> Iterator[str]:
    """Yield in words what is conserved, and what makes up the difference to the closed solution."""
    for of in conserved(case.budgets):
        lost = f"not conserved by the formulas, {number(of.share, 2)} of its terms remain"
        broken = "".join(f"; {name} changes it by {number(by, 2)} of its terms" for name, by in of.broken_by.items())
        yield f"{of.quantity}: {'conserved but for rounding' if of.kept else lost}{broken}"
    if case.closed is not None:
        yield f"closed solution of the {case.closed.quantity}: {case.closed.flow}, {case.closed.about}"
    for part in parts(case):
        adds = f", so that this adds {percent(part.contribution)}" if part.contribution is not None else ""
        away = percent(part.deviation) if part.deviation is not None else part.ended
        who = part.name if part.name == LAMMPS else f"reference, {part.name}"
        yield f"{who}: {away} at step {part.step}{adds}"
