"""A validation on disk: ``validate.json``, ``curves.csv``, the page and its pictures.

``runs.jsonl`` is the journal of runs, from which an interrupted validation is resumed.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.records.documents import INFINITE, SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text, write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.records.wording import brief, number
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.figures import BLUE, GREY, RED, STYLE, plain_log_axis, saved
from lammps_cases.studies.flows.catalogue import COMPARED
from lammps_cases.studies.flows.known import Curve, Flow, FlowPanel, ReferenceCurve
from lammps_cases.studies.flows.solve import fit

REFERENCE, LAMMPS, UNIT, START = "reference", "LAMMPS", "LAMMPS in another unit of length", "reference, start "
PUBLISHED = "published"
_COLOURS = {REFERENCE: BLUE, LAMMPS: RED, UNIT: RED, PUBLISHED: "black"}
_SETUP, _FINDING = "#3a8f5c", "#d98200"
_LINES = {REFERENCE: "-", LAMMPS: "--", PUBLISHED: ":"}
_MARKS = ("o", "^", "s", "D")
ASSETS = Path(__file__).parent / "assets"
BUGS = {bug.id: bug for of in COMPARED.values() for bug in (*of.findings, FORCE_PER_VOLUME)}
SPOILT = 0.01  # relative change of a number by a bug, from which on it is named


def called(side: str) -> str:
    """Return the name of a side in tables and legends."""
    if side == UNIT:
        return "LAMMPS, particles 0.75 apart"
    return side if side == PUBLISHED or side.startswith((REFERENCE, LAMMPS)) else f"reference with {side}"


@dataclass(frozen=True)
class Lost:
    """LAMMPS lost particles: the last step with all of them; findings with which the reference loses some, and when."""

    step: int
    findings: tuple[str, ...] = ()
    after: int | None = None


@dataclass(frozen=True)
class FlowRecord:
    """One flow at one resolution, as one side solved it.

    Attributes
    ----------
    side : reference, LAMMPS, LAMMPS in another unit of length; reference with the name of a set-up or the number of
        another start; or the id of the finding that the reference had
    message : of LAMMPS, if it failed; then all else is empty
    lost : the reason, if it lost particles; only at the coarsest resolution
    """

    __pydantic_config__ = INFINITE

    flow: str
    side: str
    n: int
    particles: int
    steps: int
    seconds: float
    message: str
    curves: Mapping[str, Curve]
    errors: Mapping[str, float]
    quantities: Mapping[str, float]
    lost: Lost | None = None


@dataclass(frozen=True)
class Validated(Study):
    """All runs of a validation."""

    runs: tuple[FlowRecord, ...]
    date: str = ""
    schema: str = SCHEMAS["validate"]

    @property
    def facts(self) -> list[tuple[str, str]]:
        """The facts at the top of the page, with the day of the runs."""
        return [*super().facts, ("measured", self.date)]

    @property
    def flows(self) -> list[str]:
        """Names of the flows, in their order."""
        return list(dict.fromkeys(run.flow for run in self.runs))

    def of(self, flow: str, side: str) -> list[FlowRecord]:
        """Return the runs of one side, from the coarsest on."""
        return sorted((run for run in self.runs if (run.flow, run.side) == (flow, side)), key=lambda run: run.n)

    def sides(self, flow: str) -> list[str]:
        """Return the sides that solved a flow."""
        return list(dict.fromkeys(run.side for run in self.runs if run.flow == flow))


DOCUMENT = Document("validate", Validated)


def runs(folder: Path) -> Parts[FlowRecord]:
    """Return the journal ``runs.jsonl`` of finished runs."""
    return Parts(folder / "runs.jsonl", FlowRecord)


def write(validated: Validated, folder: Path) -> None:
    """Write ``validate.json``, ``curves.csv``, ``report.html`` and ``figures/*.svg|png``."""
    curves = ((run, panel, *curve) for run in validated.runs for panel, curve in run.curves.items())
    points = ((of.flow, of.side, of.n, panel, *at) for of, panel, x, y in curves for at in zip(x, y, strict=True))
    write_atomically(folder / "curves.csv", csv_text([("flow", "side", "n", "panel", "x", "y"), *points]))
    DOCUMENT.write(folder / "validate.json", validated)
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    every = [COMPARED[name] for name in validated.flows]
    sections = {of.name: [of] for of in every if of.published is None} | benchmarks(every)
    html = frame.page(
        ASSETS,
        "validate",
        "good",
        engine=validated.engine.get("distribution", ""),
        validated=validated,
        facts=validated.facts,
        sections=sections,
        file=_file,
        first={of.name: first_rows(validated, of) for of in every},
        bars={of.name: bar(validated, of) for of in every},
        spoilt={of.name: spoils(validated, of) for of in every},
        rows={
            name: [row for of in flows for row in rows(validated, of) if not row.side.startswith(START)]
            for name, flows in sections.items()
        },
        title=lambda section: COMPARED[section].title if section in COMPARED else f"Benchmark {section}",
        convergence={
            name: saved(convergence(validated, flows), figures, f"{_file(name)}-order")
            for name, flows in sections.items()
            if any(len(row.values) > 1 for of in flows for row in rows(validated, of))
        },
        pictures={of.name: saved(figure(validated, of), figures, of.name) for of in every if of.panels},
        statements={of.name: list(statements(validated, of)) for of in every},
        stops={of.name: list(stops(validated, of)) for of in every},
        bugs=BUGS,
        value=brief,
        number=number,
        sides=(REFERENCE, LAMMPS),
        order=order,
        called=called,
        numbered=lambda columns: [f"#N = {n}" for n in columns],
        in_another_unit=any(run.side == UNIT for run in validated.runs),
    )
    write_atomically(folder / "report.html", html)


# --- numbers


@dataclass(frozen=True)
class Row:
    """A number or an error of one side by N.

    Attributes
    ----------
    known : of a number; 0 for an error
    printed : order published for an error
    absent : text in place of NaN
    """

    of: str
    name: str
    side: str
    values: Mapping[int, float]
    known: float | None
    printed: float = math.nan
    absent: str = ""

    @property
    def order(self) -> float:
        """Order by which the number approaches what is known, or by which the error falls."""
        known = math.nan if self.known is None else self.known
        return fit(list(self.values), [abs(value - known) for value in self.values.values()]).order

    def said(self, n: int) -> str:
        """Return the value at a resolution in words; empty without one."""
        value = self.values.get(n)
        return "" if value is None else self.absent if math.isnan(value) else number(value)

    @property
    def finest(self) -> int:
        """The finest resolution with a value; 0 for none."""
        return max(self.values, default=0)

    @property
    def is_error(self) -> bool:
        """Whether it is an error of a curve, no number that a user reads off the flow."""
        return self.name.startswith("error of")

    @property
    def missed(self) -> str:
        """What the finest value misses the known one by, in words."""
        known = 0.0 if self.known is None else self.known
        return "" if self.is_error else change(self.values.get(self.finest, math.nan), known)


def rows(validated: Validated, of: Flow) -> list[Row]:
    """Return the numbers that a user reads off a flow, then its errors; of all sides, and those published."""
    runs = [run for run in validated.runs if run.flow == of.name]
    sides = validated.sides(of.name)

    def by_n(side: str, name: str, kind: str) -> dict[int, float]:
        return {run.n: getattr(run, kind)[name] for run in runs if run.side == side and name in getattr(run, kind)}

    found = [
        Row(of.title, each.name, side, by_n(side, each.name, "quantities"), each.published, absent=each.absent)
        for each in of.quantities
        for side in sides
    ]
    measures = list(dict.fromkeys(name for run in runs for name in run.errors)) or [panel.name for panel in of.panels]
    for k, name in enumerate(measures or ["the flow"]):
        found += [Row(of.title, f"error of {name}", side, by_n(side, name, "errors"), 0.0) for side in sides]
        if of.published and of.published.errors and not k:
            published = dict(of.published.errors)
            found.append(Row(of.title, f"error of {name}", PUBLISHED, published, 0.0, of.published.order))
    return found


def first_rows(validated: Validated, of: Flow) -> dict[str, Row]:
    """Return the rows of the first number of a flow, or of its first error, by side."""
    every = rows(validated, of)
    return {row.side: row for row in every if row.name == every[0].name}


def starts(validated: Validated, of: Flow) -> tuple[int, list[float]]:
    """Return the coarsest resolution, and the first number there from every start of the reference."""
    first = first_rows(validated, of)
    n = min(first[REFERENCE].values, default=0)
    sides = [row for side, row in first.items() if side == REFERENCE or side.startswith(START)]
    return n, [row.values[n] for row in sides if n in row.values]


def bar(validated: Validated, of: Flow) -> str:
    """Return half the range of the first number over the starts; empty for one start."""
    _, values = starts(validated, of)
    return brief((max(values) - min(values)) / 2) if len(values) > 1 else ""


def spoils(validated: Validated, of: Flow) -> dict[str, str]:
    """Return by finding how LAMMPS' bug changes a number by a hundredth or more, or that atoms are lost."""
    found: dict[str, str] = {}
    every = [row for row in rows(validated, of) if not row.is_error]
    ours = {row.name: row for row in every if row.side == REFERENCE}
    for row in every:
        bug = FORCE_PER_VOLUME.id if row.side == UNIT else row.side
        for n, value in row.values.items() if bug in BUGS else ():
            right = ours[row.name].values.get(n, math.nan)
            if not abs(value - right) < SPOILT * abs(right):
                where = " where particles are 0.75 apart" if row.side == UNIT else ""
                found.setdefault(bug, f"{row.name} {change(value, right) or row.absent}{where}")
    lost = [run.lost.findings for run in validated.of(of.name, LAMMPS) if run.lost]
    return {bug: "atoms are lost" for findings in lost for bug in findings} | found


def change(theirs: float, ours: float) -> str:
    """Return the difference of two numbers, to a tenth of a per cent at most; empty for numbers without a ratio."""
    ratio = theirs / ours if ours else math.nan
    if not math.isfinite(ratio):
        return ""
    percent = 100 * (ratio - 1)
    if abs(percent) >= 1000:
        return f"{ratio:.0f} times"
    return "0 %" if abs(percent) < 0.05 else f"{percent:+.{0 if abs(percent) >= 10 else 1}f} %"


def order(value: float) -> str:
    """Format an order of convergence for tables; empty for None."""
    return f"{round(value, 1) + 0.0:.1f}" if math.isfinite(value) else ""


def stops(validated: Validated, of: Flow) -> Iterator[str]:
    """Yield why sides stopped at their finest resolution."""
    for side in validated.sides(of.name):
        if side != REFERENCE and validated.of(of.name, side)[-1].message:
            yield f"{called(side)} {stopped(validated, of.name, side)}"


def stopped(validated: Validated, flow: str, side: str) -> str:
    """Return why a side has no numbers: for LAMMPS the findings with which the reference loses particles too."""
    *_, last = runs = validated.of(flow, side)
    run = next((run for run in runs if run.lost), last)
    if not run.lost:
        return f"stopped at {run.n} particles: {run.message}"
    names = " and ".join(run.lost.findings)
    how = "alone" if len(run.lost.findings) == 1 else "together"
    too = f"so does the reference with {names} {how}, after step {run.lost.after}"
    none = "the reference does not, with none of the findings tried"
    return f"loses atoms after step {run.lost.step}, at {run.n} particles; {too if names else none}"


def statements(validated: Validated, of: Flow) -> Iterator[tuple[str, str]]:
    """Yield the statements about a flow, each with its title; numbers are those of the runs."""
    yield "order that theory allows", of.expected
    setups = [f"{REFERENCE}, {name}" for name in of.setups]
    for title, sides in (("order reached", [REFERENCE, LAMMPS]), ("in other set-ups", setups)):
        told: dict[str, list[str]] = {}
        for row in rows(validated, of):
            if row.side in sides and math.isfinite(row.order):
                told.setdefault(row.side, []).append(f"{order(row.order)} ({row.name})")
        if told:
            yield title, "; ".join(f"{side}: {', '.join(words)}" for side, words in told.items())
    if of.limits:
        yield "what limits it", of.limits
    n, values = starts(validated, of)
    bars = [f"± {bar(validated, of)} over {len(values)} starts at N = {n}"] if len(values) > 1 else []
    for panel in of.panels:
        first, *others = [known for known in panel.known if known.marks] or [panel.known[0]]
        bars += [f"{brief(each.misfit((first.x, first.y)))} between {first.label} and {each.label}" for each in others]
    if bars:
        yield "error bar", "; ".join(bars)


# --- benchmarks of the paper


def benchmarks(flows: Iterable[Flow]) -> dict[str, list[Flow]]:
    """Return the flows of every benchmark of the paper, in the paper's order."""
    groups: dict[str, list[Flow]] = {}
    for of in flows:
        if of.published:
            groups.setdefault(of.published.benchmark, []).append(of)
    return dict(sorted(groups.items(), key=lambda group: int(group[0].split()[0])))


def _file(section: str) -> str:
    return section if section in COMPARED else "benchmark-" + section.lower().replace(" ", "-")


# --- pictures


def convergence(validated: Validated, flows: Sequence[Flow]) -> Figure:
    """Draw the first error of flows against N: all sides with two resolutions, and the order that theory allows."""
    with matplotlib.rc_context(STYLE):
        drawn = Figure(figsize=(7.2, 3.0), layout="constrained")
        axis = drawn.subplots()
        for of, mark in zip(flows, itertools.cycle(_MARKS)):
            every = [row for row in rows(validated, of) if row.is_error]
            for row in (row for row in every if row.name == every[0].name and len(row.values) > 1):
                label = textwrap.fill(f"{of.title}, {row.side}" if len(flows) > 1 else row.side, 32)
                axis.loglog(*zip(*sorted(row.values.items()), strict=True), **_style(row.side, mark), label=label)
            if len(flows) == 1 and of.expected[0].isdigit() and every[0].values:
                (n, error), ns = max(every[0].values.items()), np.array(sorted(every[0].values))
                guide = error * (n / ns) ** int(of.expected[0])
                axis.loglog(ns, guide, color=GREY, lw=0.8, ls=":", label=f"order {of.expected[0]}")
        at = sorted({n for of in flows for row in rows(validated, of) for n in row.values})
        axis.set(xlabel="N", ylabel="error", xscale="log", xticks=at, xticklabels=at)
        axis.minorticks_off()
        plain_log_axis(axis.yaxis)
        drawn.legend(loc="outside right center", frameon=False, fontsize=7)
        return drawn


def _style(side: str, mark: str) -> dict[str, Any]:
    colour = _COLOURS.get(side, _SETUP if side.startswith(REFERENCE) else _FINDING)
    line = _LINES.get(side, "-." if side.startswith(REFERENCE) else ":")
    return {"color": colour, "ls": line, "marker": mark, "ms": 4, "mfc": "white"}


def figure(validated: Validated, of: Flow) -> Figure:
    """Draw every panel of a flow; the finest resolution of a side is thick, coarser ones are faint."""
    with matplotlib.rc_context(STYLE):
        count = len(of.panels)
        drawn = Figure(figsize=(3.6 * count + 2.3, 3.2), layout="constrained")
        axes = drawn.subplots(1, count, squeeze=False).ravel()
        for axis, panel in zip(axes, of.panels, strict=True):
            for side in [side for side in validated.sides(of.name) if not side.startswith(START)]:
                _draw_side(axis, validated, of.name, side, panel)
            for known, mark in zip(panel.known, _MARKS, strict=False):
                _draw_known(axis, known, mark)
            axis.set(xlabel=panel.x, ylabel=panel.y)
        labels: dict[str, Any] = {}
        for axis in axes:
            labels |= {label: handle for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
        drawn.legend(list(labels.values()), list(labels), loc="outside right center", frameon=False, fontsize=8)
        return drawn


def _draw_side(axis: Any, validated: Validated, flow: str, side: str, panel: FlowPanel) -> None:
    runs = [run for run in validated.of(flow, side) if panel.name in run.curves]
    of_side = {key: value for key, value in _style(side, "").items() if key in ("color", "ls")}
    for run in runs:
        last = run is runs[-1]
        label = textwrap.fill(f"{called(side)}, N\u00a0=\u00a0{run.n}", 22, break_on_hyphens=False) if last else None
        thick = {"lw": 1.6, "alpha": 0.95} if last else {"lw": 0.8, "alpha": 0.45}
        axis.plot(*run.curves[panel.name], label=label, zorder=3 if side == REFERENCE else 4, **of_side, **thick)


def _draw_known(axis: Any, known: ReferenceCurve, mark: str) -> None:
    first = mark == _MARKS[0]
    style: dict[str, Any] = {"color": "black" if first else GREY, "lw": 1.0, "ls": "-" if first else "-."}
    if known.marks:
        style = {"ls": "none", "marker": mark, "ms": 4.5, "mfc": "white", "mec": "black", "mew": 1}
    axis.plot(known.x, known.y, label=known.label, zorder=5 if known.marks else 2, **style)
