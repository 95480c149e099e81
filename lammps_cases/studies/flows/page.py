"""The page of a validation, its document and its pictures."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import brief, number
from lammps_cases.report.pages import blocks
from lammps_cases.report.pages.blocks import (
    Block,
    Bullets,
    Details,
    Heading,
    PageSection,
    PageTable,
    Paragraph,
    Picture,
)
from lammps_cases.report.pages.figures import BLUE, GREY, RED, saved
from lammps_cases.studies import draw
from lammps_cases.studies.flows.catalogue import COMPARED
from lammps_cases.studies.flows.known import Flow, FlowPanel, ReferenceCurve
from lammps_cases.studies.flows.record import (
    DOCUMENT,
    LAMMPS,
    REFERENCE,
    START,
    UNIT,
    Validated,
    curves_csv,
    errors_csv,
)
from lammps_cases.studies.flows.solve import fit

PUBLISHED = "published"
_COLOURS = {REFERENCE: BLUE, LAMMPS: RED, UNIT: RED, PUBLISHED: "black"}
_SETUP, _FINDING = "#3a8f5c", "#d98200"
_LINES = {REFERENCE: "-", LAMMPS: "--", PUBLISHED: ":"}
_MARKS = ("o", "^", "s", "D")
BUGS = {bug.id: bug for of in COMPARED.values() for bug in (*of.findings, FORCE_PER_VOLUME)}
SPOILT = 0.01  # relative change of a number by a bug, from which on it is named
ABOUT = """Do fluids flow as experiments, tables and closed solutions say? Each figure has what is known in black
(white on a dark page), the reference in blue and LAMMPS in red, from the same particles. Red apart from blue: LAMMPS
differs from its manual, by the bugs named. Both apart from what is known: resolution, model or data. Nothing here is
a verdict."""
LEGEND = """N: particles per length of the flow; the finest is shown. ±: half the range of the reference's number over
starts whose fluid is displaced by up to a twentieth of a spacing, at the coarsest N. Order: the power of 1/N by which
a number approaches what is known, or an error falls; below 0 it departs, and where it is above that of theory, errors
of higher order still outweigh at these N. Errors are root mean squares over those of what is known. Thick lines are
the finest resolution, faint ones coarser; green is another set-up of the reference, orange the reference with a bug
of LAMMPS."""
ANOTHER_UNIT = """Particles 0.75 apart: the same flow in another unit of length, in which a particle's volume is not
1. That should change nothing."""


def called(side: str) -> str:
    """Return the name of a side in tables and legends."""
    if side == UNIT:
        return "LAMMPS, particles 0.75 apart"
    return side if side == PUBLISHED or side.startswith((REFERENCE, LAMMPS)) else f"reference with {side}"


def write(validated: Validated, folder: Path) -> None:
    """Write ``validate.json``, ``curves.csv``, ``errors.csv``, ``report.html`` and ``figures/*.svg|png``."""
    write_atomically(folder / "curves.csv", curves_csv(validated.runs))
    write_atomically(folder / "errors.csv", errors_csv(validated.runs))
    DOCUMENT.write(folder / "validate.json", validated)
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    every = [COMPARED[name] for name in validated.flows]
    groups = {of.name: [of] for of in every if of.published is None} | benchmarks(every)
    another = [Paragraph(ANOTHER_UNIT)] if any(run.side == UNIT for run in validated.runs) else []
    html = blocks.page(
        "validate",
        "Flows that others have measured, computed or solved",
        "flows with experiments, tables and solutions",
        [Paragraph(ABOUT, "about"), _summary(validated, groups), Paragraph(LEGEND), *another],
        [
            *(_section(validated, name, flows, figures) for name, flows in groups.items()),
            PageSection("bugs", "Bugs of LAMMPS named here", [Bullets(_bugs(validated, every))]),
        ],
        engine=validated.engine.get("distribution", ""),
        command=validated.command,
        facts=validated.facts,
    )
    write_atomically(folder / "report.html", html)


def _summary(validated: Validated, groups: Mapping[str, Sequence[Flow]]) -> PageTable:
    columns = ["flow", "what it validates", "number", "#known", "#N", "#reference", "#error", "#LAMMPS", "#order"]
    found = []
    for name, flows in groups.items():
        for of in flows:
            first = first_rows(validated, of)
            ours, theirs = first[REFERENCE], first[LAMMPS]
            spread, at = bar(validated, of), f" (N = {theirs.finest})" if theirs.finest != ours.finest else ""
            found.append(
                (
                    *(blocks.link(f"#{_file(name)}", of.heading), of.validates, ours.name),
                    *("" if ours.is_error else number(ours.known), ours.finest),
                    *(ours.shown(ours.finest) + (f" ± {spread}" if spread else ""), ours.missed),
                    theirs.shown(theirs.finest) + at if theirs.values else "stopped",
                    *(order(ours.order), _linked(spoils(validated, of)) or _no_bug(validated, of)),
                )
            )
    return PageTable([*columns, "LAMMPS' bug that spoils it"], found, "Summary")


def _no_bug(validated: Validated, of: Flow) -> str:
    tried = any(side == UNIT or side in BUGS for side in validated.sides(of.name))
    return "none found" if tried else "none tried"


def _linked(bugs: Iterable[str]) -> Markup:
    return Markup(", ").join(blocks.link(f"#bug-{bug}", bug) for bug in bugs)


def _bugs(validated: Validated, flows: Iterable[Flow]) -> list[str]:
    text = Markup(
        '<span id="bug-{0}"><b>{0}</b>: {1}. <code>eos-ref findings {0}</code> says what to do about it.</span>'
    )
    return [text.format(bug, BUGS[bug].title) for bug in sorted({b for of in flows for b in spoils(validated, of)})]


def _section(validated: Validated, name: str, flows: Sequence[Flow], figures: Path) -> PageSection:
    """Return a flow, or a benchmark of the paper: what is known, all numbers, pictures, and how its error falls."""
    parts: list[Block] = []
    several = len(flows) > 1
    if several:
        parts.append(Paragraph(" ".join(dict.fromkeys(of.published.meaning for of in flows if of.published))))
    else:
        parts += _described(validated, flows[0])
    parts.append(_numbers(validated, flows))
    for of in flows:
        if several:
            parts += [Heading(of.heading), *_described(validated, of)]
        if of.panels:
            parts.append(Picture(saved(figure(validated, of), figures, of.name)))
    if any(len(row.values) > 1 for of in flows for row in rows(validated, of)):
        parts.append(Picture(saved(convergence(validated, flows), figures, f"{_file(name)}-order")))
    parts += [_details(validated, of) for of in flows]
    title = COMPARED[name].heading if name in COMPARED else f"Benchmark {name}"
    return PageSection(_file(name), title, parts)


def _described(validated: Validated, of: Flow) -> Iterator[Block]:
    yield Paragraph(Markup("{} Again: <code>eos-ref validate {}</code>").format(of.about, of.name))
    described = [Markup("<b>{}:</b> {}").format(*pair) for pair in statements(validated, of)]
    bugs = spoils(validated, of).items()
    yield Bullets(
        [*described, *(Markup("<b>spoiled in LAMMPS by</b> {}: {}").format(_linked([b]), w) for b, w in bugs)]
    )
    yield from (Paragraph(f"{words}.", "warning") for words in stops(validated, of))


def _numbers(validated: Validated, flows: Sequence[Flow]) -> PageTable:
    """Return all numbers and errors by N, with what is known, the order, and for a benchmark the one printed."""
    every = [row for of in flows for row in rows(validated, of) if row.values and not row.side.startswith(START)]
    columns, several = sorted({n for row in every for n in row.values}), len(flows) > 1
    found, last = [], ("", "")
    for row in every:
        name, last = "" if (row.of, row.name) == last else row.name, (row.of, row.name)
        found.append(
            (
                *([row.of] if several else []),
                *(name, called(row.side), *(row.shown(n) for n in columns)),
                *("" if row.is_error else number(row.known), order(row.order)),
                *([order(row.printed)] if several else []),
            )
        )
    head = [*["flow"] * several, "number", "run", *(f"#N = {n}" for n in columns), "#known", "#order"]
    title = f"Numbers of {' and '.join(of.heading for of in flows)}"
    return PageTable([*head, *["#printed"] * several], found, title)


def _details(validated: Validated, of: Flow) -> Details:
    text = Markup("<b>{}</b> ({}): {}")
    sources = [
        text.format(known.label, panel.name, known.source + (f"; {known.scatter}" if known.scatter else ""))
        for panel in of.panels
        for known in panel.known
    ]
    sources += [text.format(q.name, number(q.published), q.source) for q in of.quantities if q.source]
    sources += [Markup("<b>Not compared:</b> {}").format(of.left_out)] if of.left_out else []
    runs = [
        (called(run.side), run.n, run.particles, run.steps, brief(run.seconds), run.message)
        for run in validated.runs
        if run.flow == of.name
    ]
    columns = ["run", "#N", "#particles", "#steps", "#seconds", "message"]
    table = PageTable(columns, runs, f"Runs of {of.heading}")
    return Details(f"{of.heading}: sources and runs", [Bullets(sources), table] if sources else [table])


# --- numbers


@dataclass(frozen=True)
class FlowNumber:
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

    def shown(self, n: int) -> str:
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


def rows(validated: Validated, of: Flow) -> list[FlowNumber]:
    """Return the numbers that a user reads off a flow, then its errors; of all sides, and those published."""
    runs = [run for run in validated.runs if run.flow == of.name]
    sides = validated.sides(of.name)

    def by_n(side: str, name: str, kind: str) -> dict[int, float]:
        return {run.n: getattr(run, kind)[name] for run in runs if run.side == side and name in getattr(run, kind)}

    found = [
        FlowNumber(of.heading, each.name, side, by_n(side, each.name, "quantities"), each.published, absent=each.absent)
        for each in of.quantities
        for side in sides
    ]
    measures = list(dict.fromkeys(name for run in runs for name in run.errors)) or [panel.name for panel in of.panels]
    for k, name in enumerate(measures or ["the flow"]):
        found += [FlowNumber(of.heading, f"error of {name}", side, by_n(side, name, "errors"), 0.0) for side in sides]
        if of.published and of.published.errors and not k:
            published = dict(of.published.errors)
            found.append(FlowNumber(of.heading, f"error of {name}", PUBLISHED, published, 0.0, of.published.order))
    return found


def first_rows(validated: Validated, of: Flow) -> dict[str, FlowNumber]:
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
    every = rows(validated, of)
    every = [row for row in every if not row.is_error] or every
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
        orders: dict[str, list[str]] = {}
        for row in rows(validated, of):
            if row.side in sides and math.isfinite(row.order):
                orders.setdefault(row.side, []).append(f"{order(row.order)} ({row.name})")
        if orders:
            yield title, "; ".join(f"{side}: {', '.join(words)}" for side, words in orders.items())
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
    curves = []
    for of, mark in zip(flows, itertools.cycle(_MARKS)):
        every = [row for row in rows(validated, of) if row.is_error]
        for row in (row for row in every if row.name == every[0].name and len(row.values) > 1):
            label = textwrap.fill(f"{of.heading}, {row.side}" if len(flows) > 1 else row.side, 32)
            style = {**_style(row.side), "marker": mark, "ms": 4, "mfc": "white"}
            n, errors = zip(*sorted(row.values.items()), strict=True)
            curves.append(draw.Curve(label, n, errors, style))
        if len(flows) == 1 and of.expected[0].isdigit() and every[0].values:
            finest, error = max(every[0].values.items())
            at = sorted(every[0].values)
            guide = [error * (finest / n) ** int(of.expected[0]) for n in at]
            curves.append(draw.Curve(f"order {of.expected[0]}", at, guide, {"color": GREY, "lw": 0.8, "ls": ":"}))
    ticks = sorted({n for curve in curves for n in curve.x})
    return draw.figure([draw.Panel("N", "error", curves, log="xy", ticks=ticks)], size=(5.0, 2.8))


def _style(side: str) -> dict[str, Any]:
    colour = _COLOURS.get(side, _SETUP if side.startswith(REFERENCE) else _FINDING)
    return {"color": colour, "ls": _LINES.get(side, "-." if side.startswith(REFERENCE) else ":")}


def figure(validated: Validated, of: Flow) -> Figure:
    """Draw every panel of a flow; the finest resolution of a side is thick, coarser ones are faint."""
    sides = [side for side in validated.sides(of.name) if not side.startswith(START)]
    panels = []
    for panel in of.panels:
        curves = [curve for side in sides for curve in _curves(validated, of.name, side, panel)]
        curves += [_known(known, mark) for known, mark in zip(panel.known, _MARKS, strict=False)]
        panels.append(draw.Panel(panel.x, panel.y, curves))
    return draw.figure(panels, size=(3.6, 2.8))


def _curves(validated: Validated, flow: str, side: str, panel: FlowPanel) -> Iterator[draw.Curve]:
    runs = [run for run in validated.of(flow, side) if panel.name in run.curves]
    for run in runs:
        last = run is runs[-1]
        label = textwrap.fill(f"{called(side)}, N\u00a0=\u00a0{run.n}", 22, break_on_hyphens=False) if last else ""
        thick = {"lw": 1.6, "alpha": 0.95} if last else {"lw": 0.8, "alpha": 0.45}
        style = {**_style(side), **thick, "zorder": 3 if side == REFERENCE else 4}
        yield draw.Curve(label, *run.curves[panel.name], style)


def _known(known: ReferenceCurve, mark: str) -> draw.Curve:
    first = mark == _MARKS[0]
    style: dict[str, Any] = {"color": "black" if first else GREY, "lw": 1.0, "ls": "-" if first else "-.", "zorder": 2}
    if known.marks:
        style = {"ls": "none", "marker": mark, "ms": 4.5, "mfc": "white", "mec": "black", "mew": 1, "zorder": 5}
    return draw.Curve(known.label, known.x, known.y, style)
