"""`compare`: what ``eos-ref compare`` does, as a function that returns the result and prints nothing."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.engine.installations import Engine
from lammps_cases.records.checked import checked
from lammps_cases.records.files import write_atomically
from lammps_cases.records.headline import Headline
from lammps_cases.records.options import flat
from lammps_cases.records.progress import SILENT
from lammps_cases.run.command import Result, remove_with, report_folder
from lammps_cases.run.options import CompareOptions, Names, several
from lammps_cases.versions import page, pairs, sources
from lammps_cases.versions.change import Policy
from lammps_cases.versions.pairs import SideComparison

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class ComparisonResult:
    """What changed from one side to another.

    Attributes
    ----------
    comparison : SideComparison
        All that is known of it, the content of compare.json.
    folder : Path
        Its report; a temporary folder lives as long as the result.
    """

    comparison: SideComparison
    folder: Path
    temporary: bool = False

    def __post_init__(self) -> None:
        remove_with(self, self.folder, self.temporary)

    @property
    def headline(self) -> Headline:
        """The headline: ``state`` is PASS, KNOWN BUGS, FAIL or EMPTY, ``sentence`` says why."""
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

    @property
    def findings(self) -> pd.DataFrame:
        """The findings that came or went, the most severe first: id and severity."""
        import pandas as pd

        known = self.comparison.moved
        return pd.DataFrame({"id": list(known), "severity": list(known.values())})

    def __repr__(self) -> str:
        return f"<{self.headline}>"


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
        Ask as well which engine is slower; takes a minute.
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
        from lammps_cases.versions import timing as timings

        turns = timings.in_turns(engines, progress=how.progress)
    comparison = pairs.compared(sides, Policy(bits=options.strict), turns, timing, how.command, options.fail_on)
    write_atomically(out / "compare.json", json.dumps(pairs.document(comparison), indent=1) + "\n")
    write_atomically(out / "summary.md", pairs.summary(comparison))
    write_atomically(out / "compare.html", page.render(comparison))
    return comparison
