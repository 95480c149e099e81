"""A validation on disk: ``validate.json``, ``curves.csv``, the page and its pictures.

``runs.jsonl`` is the journal of runs, from which an interrupted validation is resumed.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from lammps_cases.records.documents import INFINITE, SCHEMAS, Document, Study
from lammps_cases.records.files import csv_text, write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.records.wording import brief, number
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.figures import BLUE, GREY, RED, STYLE, saved
from lammps_cases.studies.flows.catalogue import COMPARED
from lammps_cases.studies.flows.flow import Curve, Flow, FlowPanel, ReferenceCurve
from lammps_cases.studies.flows.solve import Fit, fit

REFERENCE, LAMMPS, UNIT = "reference", "LAMMPS", "LAMMPS in another unit of length"
_COLOURS = {REFERENCE: BLUE, LAMMPS: RED, UNIT: RED}
_FINDING = "#d98200"
_MARKS = ("o", "^", "s", "D")
ASSETS = Path(__file__).parent / "assets"


def called(side: str) -> str:
    """Return the name of a side in tables and legends."""
    return {UNIT: "LAMMPS, particles 0.75 apart"}.get(
        side, side if side in (REFERENCE, LAMMPS) else f"reference with {side}"
    )


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
    side : reference, LAMMPS, LAMMPS in another unit of length; or the id of the finding that the reference had
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
    schema: str = SCHEMAS["validate"]

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

    def order(self, flow: str, side: str, measure: str) -> Fit:
        """Return the order of convergence of a measure."""
        runs = [run for run in self.of(flow, side) if measure in run.errors]
        return fit([run.n for run in runs], [run.errors[measure] for run in runs])


DOCUMENT = Document("validate", Validated)


def runs(folder: Path) -> Parts[FlowRecord]:
    """Return the journal ``runs.jsonl`` of finished runs."""
    return Parts(folder / "runs.jsonl", FlowRecord)


def _write_tables(validated: Validated, folder: Path) -> None:
    """Write ``validate.json`` and ``curves.csv``."""
    write_atomically(folder / "curves.csv", csv_text(_rows(validated)))
    DOCUMENT.write(folder / "validate.json", validated)


def _rows(validated: Validated) -> Iterable[Sequence[Any]]:
    yield ("flow", "side", "n", "panel", "x", "y")
    for run in validated.runs:
        for panel, (x, y) in run.curves.items():
            yield from ((run.flow, run.side, run.n, panel, *point) for point in zip(x, y, strict=True))


def write(validated: Validated, folder: Path) -> None:
    """Write ``validate.json``, ``curves.csv``, ``report.html`` and ``figures/*.svg|png``."""
    _write_tables(validated, folder)
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    every = [COMPARED[name] for name in validated.flows]
    flows = [of for of in every if of.published is None]
    groups = benchmarks(every)
    html = frame.page(
        ASSETS,
        "validate",
        "good",
        engine=validated.engine.get("distribution", ""),
        validated=validated,
        flows=flows,
        groups=groups,
        files={name: _file(name) for name in groups},
        numbered=lambda columns: [f"#N = {n}" for n in columns],
        compared={name: compared(validated, of_one) for name, of_one in groups.items()},
        convergence={
            name: saved(convergence(validated, of_one), figures, _file(name)) for name, of_one in groups.items()
        },
        facts=validated.facts,
        pictures={of.name: saved(figure(validated, of), figures, of.name) for of in every if of.panels},
        stops={of.name: list(stops(validated, of)) for of in every},
        effects={of.name: list(effects(validated, of)) for of in every},
        value=lambda value: brief(value) if math.isfinite(value) else "",
        order=order,
        called=called,
        sides=(REFERENCE, LAMMPS),
        in_another_unit=any(run.side == UNIT for run in validated.runs),
        navigation=[(of.name, of.title) for of in flows] + [(_file(name), name) for name in groups],
        nan=math.nan,
    )
    write_atomically(folder / "report.html", html)


@dataclass(frozen=True)
class Effect:
    """A number that a user reads off a run, and the reference's at the same resolution, in words."""

    run: str
    n: int
    quantity: str
    found: str
    ours: str
    change: str
    published: str


def effects(validated: Validated, of: Flow) -> Iterator[Effect]:
    """Yield the effects of LAMMPS, and of each finding alone, on the quantities of a flow at its finest resolution.

    For a side that stopped, at the finest resolution at which it did not.
    """
    for side in validated.sides(of.name):
        run = next((run for run in reversed(validated.of(of.name, side)) if not run.message), None)
        if side == REFERENCE or run is None:
            continue
        ours_here = next((ours for ours in validated.of(of.name, REFERENCE) if ours.n == run.n), None)
        for quantity in of.quantities:
            if ours_here is not None and quantity.name in ours_here.quantities:
                ours, theirs = ours_here.quantities[quantity.name], run.quantities[quantity.name]
                yield Effect(
                    called(side),
                    run.n,
                    quantity.name,
                    quantity.absent if math.isnan(theirs) else number(theirs),
                    number(ours),
                    change(theirs, ours),
                    number(quantity.published),
                )


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


# --- benchmarks of the paper

PUBLISHED = "published"


def benchmarks(flows: Iterable[Flow]) -> dict[str, list[Flow]]:
    """Return the flows of every benchmark of the paper, in the paper's order."""
    groups: dict[str, list[Flow]] = {}
    for of in flows:
        if of.published:
            groups.setdefault(of.published.benchmark, []).append(of)
    return dict(sorted(groups.items(), key=lambda group: int(group[0].split()[0])))


def _file(benchmark: str) -> str:
    return "benchmark-" + benchmark.lower().replace(" ", "-")


@dataclass(frozen=True)
class Errors:
    """Errors of a benchmark's flow on one side, by N, and their order; of a measure other than the first in words."""

    flow: str
    side: str
    errors: Mapping[int, float]
    order: float
    printed: float = math.nan


def compared(validated: Validated, flows: Sequence[Flow]) -> list[Errors]:
    """Return the errors of all flows of a benchmark: reference, LAMMPS, published; further measures after them."""
    found = []
    for of in flows:
        runs = {side: validated.of(of.name, side) for side in (REFERENCE, LAMMPS)}
        measures = list(dict.fromkeys(name for side in runs.values() for run in side for name in run.errors))
        for measure in measures:
            for side, of_side in runs.items():
                errors = {run.n: run.errors[measure] for run in of_side if measure in run.errors}
                found.append(Errors(f"{of.title}: {measure}", side, errors, _order(errors)))
            if of.published and of.published.errors and measure == measures[0]:
                errors = dict(of.published.errors)
                found.append(Errors(f"{of.title}: {measure}", PUBLISHED, errors, _order(errors), of.published.order))
    return found


def first_measure(validated: Validated, flow: str) -> str:
    """Return the name of the first measure of a flow; empty if the reference has no run."""
    return next((name for run in validated.of(flow, REFERENCE) for name in run.errors), "")


def _order(errors: Mapping[int, float]) -> float:
    return fit(list(errors), list(errors.values())).order


def convergence(validated: Validated, flows: Sequence[Flow]) -> Figure:
    """Draw the errors of a benchmark's first measures against N: reference, LAMMPS, published."""
    colours = {REFERENCE: BLUE, LAMMPS: RED, PUBLISHED: "black"}
    styles = {REFERENCE: "-", LAMMPS: "--", PUBLISHED: ":"}
    first = {
        of.title: next((name for run in validated.of(of.name, REFERENCE) for name in run.errors), "") for of in flows
    }
    with matplotlib.rc_context(STYLE):
        drawn = Figure(figsize=(7.2, 3.4), layout="constrained")
        axis = drawn.subplots()
        for errors in compared(validated, flows):
            title, _, measure = errors.flow.partition(": ")
            if errors.errors and measure == first[title]:
                mark = _MARKS[list(first).index(title) % len(_MARKS)]
                axis.loglog(
                    *zip(*sorted(errors.errors.items()), strict=True),
                    color=colours[errors.side],
                    ls=styles[errors.side],
                    marker=mark,
                    ms=4,
                    mfc="white",
                    label=textwrap.fill(f"{title}, {errors.side}", 32),
                )
        axis.set(xlabel="N", ylabel="error")
        drawn.legend(loc="outside right center", frameon=False, fontsize=7)
        return drawn


# --- pictures


def figure(validated: Validated, of: Flow) -> Figure:
    """Draw every panel of a flow; the finest resolution of a side is thick, coarser ones are faint."""
    with matplotlib.rc_context(STYLE):
        count = len(of.panels)
        drawn = Figure(figsize=(3.6 * count + 2.3, 3.2), layout="constrained")
        axes = drawn.subplots(1, count, squeeze=False).ravel()
        for axis, panel in zip(axes, of.panels, strict=True):
            for side in validated.sides(of.name):
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
    for run in runs:
        last = run is runs[-1]
        style: dict[str, Any] = {
            "color": _COLOURS.get(side, _FINDING),
            "lw": 1.6 if last else 0.8,
            "alpha": 0.95 if last else 0.45,
            "ls": "-" if side == REFERENCE else "--" if side == LAMMPS else ":",
            "zorder": 3 if side == REFERENCE else 4,
        }
        axis.plot(*run.curves[panel.name], label=_label(side, run.n) if last else None, **style)


def _label(side: str, n: int) -> str:
    """Return a side and its resolution as lines of a legend."""
    return textwrap.fill(f"{called(side)}, N\u00a0=\u00a0{n}", 22, break_on_hyphens=False)


def _draw_known(axis: Any, known: ReferenceCurve, mark: str) -> None:
    if known.marks:
        style: dict[str, Any] = {"ls": "none", "marker": mark, "ms": 4.5, "mfc": "white", "mec": "black", "mew": 1}
    else:
        style = {"color": "black" if mark == _MARKS[0] else GREY, "lw": 1.0, "ls": "-" if mark == _MARKS[0] else "-."}
    axis.plot(known.x, known.y, label=known.label, zorder=5 if known.marks else 2, **style)
