"""The page of `eos-ref power`: what was caught and what was not, resolution, false alarms."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import jinja2
from markupsafe import Markup, escape

from lammps_cases.records.files import write_atomically
from lammps_cases.studies.mutation import source
from lammps_cases.studies.mutation.fault import ABOUT, FAMILIES, KINDS
from lammps_cases.studies.mutation.record import FaultRecord, Power
from lammps_cases.studies.mutation.resolution import Resolution

ASSETS = Path(__file__).parent / "assets"
SHARED = Path(__file__).parents[2] / "pages" / "assets"
BUSIEST = 20  # cases listed
LEFT, RIGHT, ROW = 230, 1180, 20  # of the drawing, in its units
FINEST = -16  # power of ten at the left edge; the right one is 1


def write(power: Power, folder: Path) -> None:
    """Write ``power.html``, one file that opens offline."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(ASSETS), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["size"] = lambda value: f"{value:.1e}"
    html = environment.get_template("power.html.j2").render(
        power=power,
        css=Markup((SHARED / "page.css").read_text(encoding="utf-8")),
        own_css=Markup((ASSETS / "power.css").read_text(encoding="utf-8")),
        verdict="WRONG" if power.complaints else "AS IT MUST BE",
        headline=_headline(power),
        facts=list(_facts(power)),
        families=FAMILIES,
        about=ABOUT,
        table=list(_table(power.faults)),
        controls={control.family: _control(control.cases, len(control.red)) for control in power.controls},
        verdicts=_verdicts(power.faults),
        busiest=_busiest(power.faults),
        excluded=source.EXCLUDED,
        excluded_assignments=source.EXCLUDED_ASSIGNMENTS,
        only=source.ONLY,
        drawing=Markup(_drawing(power.resolution)),
    )
    write_atomically(folder / "power.html", html)


def _headline(power: Power) -> str:
    parts = []
    total = len(power.faults)
    if total:
        parts.append(f"{power.caught} of {total} planted faults caught, {power.quick} by quick cases")
    if power.resolution:
        unseen = sum(r.best is None for r in power.resolution)
        parts.append(f"{len(power.resolution)} parameters, {unseen} of them seen by no case")
    if power.alarms:
        parts.append(f"{sum(run.false for run in power.alarms)} false alarms")
    return "; ".join(parts)


def _facts(power: Power) -> Iterator[tuple[str, str]]:
    yield "LAMMPS", power.engine.get("distribution") or power.engine.get("name", "")
    yield "cores", power.machine.get("cores", "")
    yield "took", f"{power.seconds:.0f} s" + (" (quick cases only)" if power.quick_only else "")
    if power.faults:
        yield "caught", f"{power.caught / len(power.faults):.1%}"
        yield "by quick cases", f"{power.quick / len(power.faults):.1%}"


def _table(faults: Sequence[FaultRecord]) -> Iterator[tuple[str, list[tuple[int, int, int]]]]:
    """By kind and family: caught, planted, caught by a quick case."""

    def cell(chosen: list[FaultRecord]) -> tuple[int, int, int]:
        return sum(bool(f.caught_by) for f in chosen), len(chosen), sum(f.quick for f in chosen)

    def row(of_kind: list[FaultRecord]) -> list[tuple[int, int, int]]:
        return [*(cell([f for f in of_kind if f.family == family]) for family in FAMILIES), cell(of_kind)]

    for kind in KINDS:
        of_kind = [fault for fault in faults if fault.kind == kind]
        if of_kind:
            yield kind, row(of_kind)
    yield "all kinds", row(list(faults))


def _control(cases: int, red: int) -> str:
    return f"Without a fault {red or 'none'} of {cases} cases turn{'s' * (red == 1)} red."


def _verdicts(faults: Sequence[FaultRecord]) -> str:
    counts = Counter(fault.seen[0].verdict for fault in faults if fault.seen)
    return ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())


def _busiest(faults: Sequence[FaultRecord]) -> list[tuple[str, int, bool]]:
    counts = Counter(case for fault in faults for case in fault.caught_by)
    quick = {fault.caught_by[0] for fault in faults if fault.quick}
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:BUSIEST]
    return [(case, count, case in quick) for case, count in ranked]


# --- drawing


def _drawing(resolution: Sequence[Resolution]) -> str:
    """Smallest visible changes along a logarithmic axis, a row per parameter, as SVG."""
    height = ROW * (len(resolution) + 2)
    parts = [f'<svg viewBox="0 0 {RIGHT + 60} {height}" role="img" aria-label="smallest visible relative changes">']
    for power in range(FINEST, 1, 2):
        x = _place(10.0**power)
        parts.append(f'<line x1="{x:.1f}" y1="{ROW}" x2="{x:.1f}" y2="{height - ROW}"/>')
        parts.append(f'<text class="tick" x="{x:.1f}" y="{height - 4}" text-anchor="middle">1e{power}</text>')
    for row, one in enumerate(resolution):
        parts += _row(one, ROW * (row + 1.5))
    return "".join([*parts, "</svg>"])


def _row(one: Resolution, y: float) -> Iterator[str]:
    yield f'<text x="{LEFT - 12}" y="{y + 4:.1f}" text-anchor="end">{escape(one.parameter)}</text>'
    if one.best is None:
        yield f'<text class="never" x="{LEFT + 4}" y="{y + 4:.1f}">seen by no case</text>'
        return
    x = _place(one.best.relative_change)
    if one.quick is not None:
        quick = _place(one.quick.relative_change)
        yield f'<line class="span" x1="{x:.1f}" y1="{y:.1f}" x2="{quick:.1f}" y2="{y:.1f}"/>'
        yield _dot("fast", quick, y, one.quick.case, one.quick.relative_change)
    yield _dot("best", x, y, one.best.case, one.best.relative_change)


def _dot(kind: str, x: float, y: float, case: str, change: float) -> str:
    radius = 4 if kind == "best" else 6
    title = f"<title>{escape(case)}: {change:.2g}</title>"
    return f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius}">{title}</circle>'


def _place(change: float) -> float:
    power = math.log10(max(change, 10.0**FINEST))
    return LEFT + (RIGHT - LEFT) * min((power - FINEST) / -FINEST, 1.0)
