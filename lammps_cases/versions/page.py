"""``compare.html``: one page that opens offline; what changed in a few lines, a matrix, then every change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lammps_cases.records import wording
from lammps_cases.records.outcome import ABOUT, CHANGE_KINDS, ChangeKind
from lammps_cases.records.wording import GIVEN, parted
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.frame import TableCell, TableRow
from lammps_cases.scene.fields import place
from lammps_cases.versions import pairs
from lammps_cases.versions.change import SideChange
from lammps_cases.versions.pairs import Pair, SideComparison

ASSETS = Path(__file__).parent / "assets"
# One character for a cell: nothing to see, other bits, or which side is closer to the reference.
MARKS: dict[ChangeKind, str] = {
    "same bits": "·",
    "same outcome": "·",
    "within bounds": "≈",
    "judged otherwise": "J",
    "cannot tell": "?",
}
CLOSER = {"both": "=", "neither": "×"}


@dataclass(frozen=True)
class PairView:
    """A pair as the page shows it: the matrix of cases and fields, and every change with its anchor.

    ``shown`` are the case and field of what it shows at once: what counts, or where nothing does what differs at all.
    """

    pair: Pair
    columns: list[str]
    rows: list[TableRow]
    changes: list[tuple[str, SideChange]]
    shown: set[tuple[str, str]]

    def shows(self, change: SideChange) -> bool:
        """Return whether it shows a change at once."""
        return (change.case, change.field) in self.shown


def render(comparison: SideComparison) -> str:
    """Return the page of a comparison."""
    shown = [comparison.alone] if comparison.alone else pairs.shown(comparison)
    return frame.page(
        ASSETS,
        "compare",
        comparison.headline.look.css,
        engine=" → ".join(side.engine.label for side in comparison.sides.values()),
        scripts=[frame.FILTER],
        filters={"side": _side, "marks": _marks},
        comparison=comparison,
        headline=comparison.headline,
        described=wording.engine,
        table=[(pair, *pair.tally, pairs.ratio(pair)) for pair in comparison.pairs],
        views=[_view(pair) for pair in shown],
        about=ABOUT,
    )


def _marks(pair: Pair) -> list[tuple[str, str]]:
    """Return the characters of the matrix and their meaning."""
    changed = {pair.a: f"closer: {pair.a}", pair.b: f"closer: {pair.b}", "=": "both inside", "×": "neither"}
    return [("·", "same"), ("≈", "within bounds"), *((mark, f"changed, {words}") for mark, words in changed.items())]


def _view(pair: Pair) -> PairView:
    columns = _columns(pair.changes.fields)
    by_case: dict[str, dict[str, SideChange]] = {}
    for change in pair.changes.fields:
        by_case.setdefault(change.case, {})[change.field] = change
    changes = [(f"{pair.name}-{k}", change) for k, change in enumerate(pair.changes.different)]
    anchors = {(change.case, change.field): anchor for anchor, change in changes}
    closer = pair.names | CLOSER
    shown = {(change.case, change.field) for change in pair.changes.faults or pair.changes.different}
    rows = [_row(case, columns, of_case, anchors, closer, shown) for case, of_case in sorted(by_case.items())]
    changes.sort(key=lambda line: (not line[1].fault, -CHANGE_KINDS.index(line[1].kind), line[1].case))
    return PairView(pair, columns, rows, changes, shown)


def _columns(changes: Sequence[SideChange]) -> list[str]:
    """Sort the columns: cases as a whole, input, fields in the order of a step, what was carried over stops."""
    computed = {change.field for change in changes if change.stage != "input"}

    def rank(field: str) -> tuple[int, int, str]:
        at_stop = parted(field)[1] not in ("", GIVEN)
        return (0 if not field else 3 if at_stop else 2 if field in computed else 1, place(field), field)

    return sorted({change.field for change in changes}, key=rank)


def _row(
    case: str,
    columns: Sequence[str],
    of_case: dict[str, SideChange],
    anchors: dict[tuple[str, str], str],
    closer: dict[str, str],
    shown: set[tuple[str, str]],
) -> TableRow:
    cells = [None if field not in of_case else _cell(of_case[field], anchors, closer) for field in columns]
    kinds = sorted({change.kind for change in of_case.values()}, key=CHANGE_KINDS.index)
    quiet = not any((case, field) in shown for field in of_case)
    return TableRow(case, cells, data={"kinds": "|".join(kinds)} | ({"quiet": ""} if quiet else {}), hidden=quiet)


def _cell(change: SideChange, anchors: dict[tuple[str, str], str], closer: dict[str, str]) -> TableCell:
    anchor = anchors.get((change.case, change.field), "")
    mark = MARKS.get(change.kind, closer[change.closer])
    if not anchor:
        return TableCell(mark, "dot")
    return TableCell(mark, f"k-{change.kind.replace(' ', '-')}", pairs.fault(change), f"#{anchor}")


def _side(change: SideChange, side: int) -> str:
    """Describe a side: verdict, findings, distance from the reference."""
    ratio = change.over_bound[side]
    parts = [change.verdicts[side], ", ".join(change.findings[side])]
    return "; ".join(part for part in (*parts, "" if ratio is None else f"{wording.brief(ratio)} bounds") if part)
