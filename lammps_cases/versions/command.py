"""`compare`: what ``eos-ref compare`` does, as a function that returns the result and prints nothing.

Its page, ``compare.html``, opens offline: what changed in a few lines, a matrix, then every change.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.engine.installations import Engine
from lammps_cases.records import wording
from lammps_cases.records.checked import checked
from lammps_cases.records.files import write_atomically
from lammps_cases.records.headline import Headline
from lammps_cases.records.options import flat
from lammps_cases.records.outcome import ABOUT, CHANGE_KINDS, ChangeKind
from lammps_cases.records.progress import SILENT
from lammps_cases.records.wording import GIVEN, parted
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.frame import TableCell, TableRow
from lammps_cases.run.command import Result, html, remove_with, report_folder
from lammps_cases.run.options import CompareOptions, Names, several
from lammps_cases.scene.fields import place
from lammps_cases.versions import pairs, sources
from lammps_cases.versions.change import Policy, SideChange
from lammps_cases.versions.pairs import Pair, SideComparison
from lammps_cases.versions.timing import in_turns

if TYPE_CHECKING:  # slow to import, and only tables of a result need it
    import pandas as pd

ASSETS = Path(__file__).parent / "assets"
# One character per cell: no change, other bits, or the side closer to the reference.
MARKS: dict[ChangeKind, str] = {
    "same bits": "·",
    "same outcome": "·",
    "within bounds": "≈",
    "judged otherwise": "J",
    "cannot tell": "?",
}
CLOSER = {"both": "=", "neither": "×"}


@dataclass(frozen=True, eq=False, repr=False)
class ComparisonResult:
    """The changes from one side to another.

    Attributes
    ----------
    comparison : SideComparison
        The whole comparison, the content of compare.json.
    folder : Path
        Its report; a temporary folder exists as long as the result.
    """

    comparison: SideComparison
    folder: Path
    temporary: bool = False

    def __post_init__(self) -> None:
        remove_with(self, self.folder, self.temporary)

    @property
    def headline(self) -> Headline:
        """The headline: ``state`` is PASS, KNOWN BUGS, FAIL or EMPTY, ``sentence`` the reason."""
        return self.comparison.headline

    @property
    def exit_code(self) -> int:
        """The exit code of the command."""
        return self.comparison.exit_code

    @property
    def counts(self) -> dict[str, int]:
        """The number of fields of every kind of change."""
        return {str(kind): count for kind, count in self.comparison.pairs[0].changes.counts.items()}

    @property
    def fields(self) -> pd.DataFrame:
        """Every field of either side: case, field, change, which side is closer to the reference, verdicts, findings.

        ``over_bound`` are the largest ratios of error to bound of both sides, ``difference_over_bound`` is the largest
        difference between the sides over the smaller bound.
        """
        import pandas as pd

        rows = [pairs.row(change) for change in self.comparison.pairs[0].changes.fields]
        return pd.json_normalize(rows, sep="_")

    def to_pandas(self) -> pd.DataFrame:
        """Return the comparison as one table, `fields`."""
        return self.fields

    @property
    def findings(self) -> pd.DataFrame:
        """The findings that came or went, the most severe first: id and severity."""
        import pandas as pd

        known = self.comparison.moved
        return pd.DataFrame({"id": list(known), "severity": list(known.values())})

    def __repr__(self) -> str:
        return f"<{self.headline}>"

    def _repr_html_(self) -> str:
        return html(self.headline, self.findings)


@checked
@flat
def compare(
    a: str | Path | Result,
    b: str | Path | Result,
    names: Names = (),
    *,
    options: CompareOptions,
    timing: bool = False,
    out: str | Path | None = None,
) -> ComparisonResult:
    """Compare two sides, field by field, as ``eos-ref compare`` does.

    Parameters
    ----------
    a, b : str, path or Result
        An engine (env, pypi:VERSION, path:PLACE), which is run; the report folder of a run or its result; an accepted
        baseline.
    names, out :
        See `lammps_cases.run.command.run`.
    timing : bool
        Also measure which engine is slower; takes a minute.
    (options)

    Raises
    ------
    InputError
        Bad input, in one line.
    EngineMissing
        There is no LAMMPS with RHEO.
    """
    sides = [str(side.folder if isinstance(side, Result) else side) for side in (a, b)]
    chosen, tag = several(names), options.tag
    command = shlex.join(["eos-ref", "compare", *sides, *chosen, *(["--tag", tag] if tag else [])])
    how = sources.run_options(sides, options.processes, options.fresh, SILENT, command)
    with report_folder(out) as (folder, temporary):
        made = compare_into(folder, sides, chosen, options, how, timing)
        return ComparisonResult(made, folder, temporary)


def compare_into(
    out: Path,
    names: Sequence[str],
    cases: Sequence[str],
    options: CompareOptions,
    how: sources.RunTerms,
    timing: bool,
) -> SideComparison:
    """Compare sides by their names on some cases, and write compare.json, compare.html and summary.md into a folder."""
    selected = sources.select(names, cases, options.tag, options.paths, out, how)
    sides, turns = [selected.side(at) for at in range(len(names))], None
    engines = {sources.LABELS[at]: each for at, each in enumerate(selected.each) if isinstance(each, Engine)}
    if timing and len(engines) == len(sides) and all(side.answered for side in sides):
        turns = in_turns(engines, progress=how.progress)
    comparison = pairs.compared(sides, Policy(bits=options.strict), turns, timing, how.command, options.fail_on)
    write_atomically(out / "compare.json", json.dumps(pairs.document(comparison), indent=1) + "\n")
    write_atomically(out / "summary.md", pairs.summary(comparison))
    write_atomically(out / "compare.html", render(comparison))
    return comparison


@dataclass(frozen=True)
class PairView:
    """A pair as the page shows it: the matrix of cases and fields, and every change with its anchor.

    ``shown`` are the case and field of the changes shown at once: those that count, else all that differ.
    """

    pair: Pair
    columns: list[str]
    rows: list[TableRow]
    changes: list[tuple[str, SideChange]]
    shown: set[tuple[str, str]]

    def shows(self, change: SideChange) -> bool:
        """Return whether a change is shown at once."""
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
    """Return the characters of the matrix and their meanings."""
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
    rows = [_case_row(case, columns, of_case, anchors, closer, shown) for case, of_case in sorted(by_case.items())]
    changes.sort(key=lambda line: (not line[1].fault, -CHANGE_KINDS.index(line[1].kind), line[1].case))
    return PairView(pair, columns, rows, changes, shown)


def _columns(changes: Sequence[SideChange]) -> list[str]:
    """Sort the columns: cases as a whole, input, fields in the order of a step, state carried over stops."""
    computed = {change.field for change in changes if change.stage != "input"}

    def rank(field: str) -> tuple[int, int, str]:
        at_stop = parted(field)[1] not in ("", GIVEN)
        return (0 if not field else 3 if at_stop else 2 if field in computed else 1, place(field), field)

    return sorted({change.field for change in changes}, key=rank)


def _case_row(
    case: str,
    columns: Sequence[str],
    of_case: dict[str, SideChange],
    anchors: dict[tuple[str, str], str],
    closer: dict[str, str],
    shown: set[tuple[str, str]],
) -> TableRow:
    cells = [None if field not in of_case else _matrix_cell(of_case[field], anchors, closer) for field in columns]
    kinds = sorted({change.kind for change in of_case.values()}, key=CHANGE_KINDS.index)
    quiet = not any((case, field) in shown for field in of_case)
    return TableRow(case, cells, data={"kinds": "|".join(kinds)} | ({"quiet": ""} if quiet else {}), hidden=quiet)


def _matrix_cell(change: SideChange, anchors: dict[tuple[str, str], str], closer: dict[str, str]) -> TableCell:
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
