"""``history.html``, or ``cases.html`` of some cases: runs, what changed, and how cases went; opens offline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lammps_cases.records.files import write_atomically
from lammps_cases.records.outcome import PARTS, Part
from lammps_cases.records.wording import brief
from lammps_cases.report.history.draw import points
from lammps_cases.report.history.views import CaseView, EngineChange, RunLine
from lammps_cases.report.pages import frame

ASSETS = Path(__file__).parent / "assets"


@dataclass(frozen=True)
class Step:
    """What changed from one engine to the next: the cases of every kind of change, and all changes of every case."""

    engine: str
    before: str
    counts: dict[Part, int]
    cases: dict[str, list[EngineChange]]

    @property
    def ordered_counts(self) -> dict[Part, int]:
        """The counts, verdicts first."""
        return {kind: self.counts[kind] for kind in PARTS if kind in self.counts}


def steps(views: Sequence[CaseView]) -> list[Step]:
    """Collect the changes of some cases by the pair of engines."""
    by_engines: dict[tuple[str, str], Step] = {}
    for view in views:
        for change in view.changes:
            step = by_engines.setdefault((change.engine, change.before), Step(change.engine, change.before, {}, {}))
            of_case = step.cases.setdefault(change.case, [])
            if all(change.kind != other.kind for other in of_case):
                step.counts[change.kind] = step.counts.get(change.kind, 0) + 1
            of_case.append(change)
    return list(by_engines.values())


def write(
    folder: Path, lines: Sequence[RunLine], views: Sequence[CaseView], labels: Sequence[str], pictured: bool
) -> Path:
    """Write the page of some runs and cases; with pictures of every case, or the changes alone."""
    pictures = []
    if pictured:
        from lammps_cases.report.history import figures

        for view in views:
            errors = figures.errors(points(view), f"errors-{view.case}")
            pictures.append((view, errors, figures.times(view.times, f"times-{view.case}")))
    html = frame.page(
        ASSETS,
        "history",
        lines=lines,
        labels=labels,
        steps=[step for label in labels for step in steps(views) if step.engine == label],
        changed=[view for view in views if pictured or view.changes],
        total=len(views),
        pictures=pictures,
        filters={"findings": findings, "error": error},
    )
    path = folder / ("cases.html" if pictured else "history.html")
    write_atomically(path, html)
    return path


def error(ratio: float | None) -> str:
    """Return difference/bound for a narrow cell; ``=`` for none."""
    return "=" if ratio == 0 else brief(ratio)


def findings(changes: Sequence[EngineChange]) -> list[tuple[str, str]]:
    """List every pair of findings before and after, once."""
    return list(dict.fromkeys((change.was, change.now) for change in changes if change.kind == "finding"))
