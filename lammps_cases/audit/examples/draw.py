"""Pictures of an example: its flow beside the closed solution, and where its energy goes."""

from __future__ import annotations

import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from lammps_cases.audit import balance
from lammps_cases.audit.examples.collect import Example
from lammps_cases.audit.rerun import AS_IT_IS, FINER
from lammps_cases.records.case_parts import BudgetRecord, ClosedRecord, SeriesRecord
from lammps_cases.report.pages.figures import BLUE, FAINT, INK, RED, THEMED, themed

# Colours of Okabe & Ito (2008), which the colour-blind tell apart.
PARTS = {
    "pressure": "#0072b2",
    "viscosity": "#d55e00",
    "artificial viscosity": "#e69f00",
    "density diffusion": "#009e73",
    "shifting": "#cc79a7",
    "other fixes": "#56b4e9",
}


def picture(example: Example) -> Markup:
    """Return the figure of a deck; nothing without budgets."""
    case = example.case
    if len(case.budgets) < 2:
        return Markup("")
    with matplotlib.rc_context(THEMED):
        figure = Figure(figsize=(10.4, 3.0), layout="constrained")
        left, right = figure.subplots(1, 2)
        own, exact = balance.measured(case), case.closed
        what = exact.quantity if exact else "kinetic energy"
        left.set_title(f"{what} (units of the deck)", color=INK)
        if exact is not None:
            left.plot(exact.steps, exact.values, color=FAINT, lw=3.0, alpha=0.5, label="closed solution")
        for series in case.series:
            if series.name in (AS_IT_IS, FINER) and series.steps:
                style = "-" if series.name == AS_IT_IS else "--"
                label = "reference" if series.name == AS_IT_IS else f"reference, {series.name}"
                left.plot(series.steps, _values(series, exact), style, color=BLUE, lw=1.2, label=label)
        left.plot(own.steps, _values(own, exact), "o", color=RED, ms=3.0, label="LAMMPS")
        left.set_xlabel("step", color=FAINT)
        left.legend(frameon=False, fontsize=8, labelcolor=INK)
        right.set_title("power of each part of the model (units of the deck)", color=INK)
        first = [of for of in case.budgets if of.run == case.budgets[-1].run]
        for name, colour in PARTS.items():
            powers = [_power(of, name) for of in first]
            if any(powers):
                right.plot([of.step for of in first], powers, color=colour, lw=1.3, label=name)
        right.set_xlabel("step", color=FAINT)
        right.legend(frameon=False, fontsize=8, labelcolor=INK)
    return themed(figure, f"figure-{example.name}", f"{example.name}: {what} and power, step by step", {})


def _values(series: SeriesRecord, exact: ClosedRecord | None) -> list[float]:
    """Return what the closed solution is of, else the kinetic energy."""
    if exact is None or exact.decays:
        return series.kinetic
    axis = "xyz".index(exact.quantity[-1])
    return [momentum[axis] for momentum in series.momentum]


def _power(of: BudgetRecord, name: str) -> float:
    """Return what a part adds to both energies per time."""
    return sum(part.power + part.storage for part in of.parts if part.name == name)
