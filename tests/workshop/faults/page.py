"""The page of `eos-ref power`: what was caught and what was not, resolution, false alarms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from lammps_cases.pages import frame
from lammps_cases.pages.figures import DIFFERS, FAINT, INK, OF, PAPER, THEMED, plain_text, themed
from lammps_cases.records.files import write_atomically
from lammps_cases.records.levels import FailOn
from tests.workshop.faults import source
from tests.workshop.faults.coverage import coverage
from tests.workshop.faults.fault import ABOUT, FAMILIES, KINDS
from tests.workshop.faults.record import FaultRecord, Power
from tests.workshop.faults.resolution import Resolution

ASSETS = Path(__file__).parent / "assets"
BUSIEST = 20  # cases listed
FINEST = 1e-16  # the left edge of the drawing


def write(power: Power, folder: Path, fail_on: FailOn = "new") -> None:
    """Write ``power.html``, one file that opens offline."""
    headline = power.headline(fail_on)
    html = frame.page(
        ASSETS,
        "power",
        headline.look.css,
        scripts=[frame.FILTER],
        power=power,
        headline=headline,
        facts=list(_facts(power)),
        families=FAMILIES,
        about=ABOUT,
        table=list(_table(power.faults)),
        controls={control.family: _control(control.cases, len(control.red)) for control in power.controls},
        verdicts=_verdicts(power.faults),
        busiest=_busiest(power.faults),
        coverage=coverage(),
        excluded_assignments=source.EXCLUDED_ASSIGNMENTS,
        drawing=_drawing(power.resolution) if power.resolution else "",
    )
    write_atomically(folder / "power.html", html)


def _facts(power: Power) -> Iterator[tuple[str, str]]:
    yield "LAMMPS", power.engine.get("distribution") or power.engine.get("name", "")
    yield "cores", power.machine.get("cores", "")
    yield "took", f"{power.seconds:.0f} s" + (" (quick cases only)" if power.quick_only else "")
    if power.faults:
        yield "caught", f"{power.caught / len(power.faults):.1%}"
        yield "by quick cases", f"{power.quick / len(power.faults):.1%}"
        yield "by a single file", str(len(power.single))
        yield "functions not mutated", str(coverage().unmutated)


def _table(faults: Sequence[FaultRecord]) -> Iterator[tuple[str, list[tuple[int, int, int]]]]:
    """Yield rows by kind, with caught, planted and caught by a quick case for each family."""

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


def _drawing(resolution: Sequence[Resolution]) -> Markup:
    """Draw the smallest visible changes along a logarithmic axis, a row per parameter."""
    marks = {}
    with matplotlib.rc_context(THEMED):
        figure = Figure(figsize=(12.0, 0.21 * (len(resolution) + 3)), layout="constrained")
        axis = figure.subplots()
        axis.set(xscale="log", xlim=(0.5 * FINEST, 2.0), ylim=(len(resolution) - 0.5, -0.5))
        axis.set_yticks(range(len(resolution)), [plain_text(one.parameter) for one in resolution])
        axis.tick_params(axis="y", length=0, labelcolor=INK)
        axis.grid(False, axis="y")
        for row, one in enumerate(resolution):
            if one.best is None:
                axis.text(FINEST, row, "seen by no case", color=DIFFERS, weight="bold", va="center")
                continue
            ends = [(kind, change) for kind, change in (("quick", one.quick), ("best", one.best)) if change]
            drawn = [(kind, max(change.relative_change, FINEST), change) for kind, change in ends]
            axis.plot([x for _, x, _ in drawn], [row] * len(drawn), color=FAINT, lw=1.5)
            for kind, x, change in drawn:
                face, size = (PAPER, 9) if kind == "quick" else (OF, 4)
                axis.plot([x], [row], "o", ms=size, mfc=face, mec=OF, mew=1.5, gid=f"{kind}-{row}")
                css = "v-explained" if kind == "quick" else "v-exact"
                marks[f"{kind}-{row}"] = css, f"{change.case}: {change.relative_change:.2g}"
    return themed(figure, "resolution", "smallest visible relative changes", marks)
