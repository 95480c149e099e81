"""`run`: the function behind ``eos-ref run``, which prints nothing and returns record, report and tables."""

from __future__ import annotations

import shlex
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import escape

from eos_ref.errors import InputError, unknown
from lammps_cases.comparison.store import open_store
from lammps_cases.engine import forkserver, installations
from lammps_cases.findings import check_names
from lammps_cases.records.checked import checked
from lammps_cases.records.files import read_arrays
from lammps_cases.records.headline import Headline
from lammps_cases.records.options import flat
from lammps_cases.records.run_record import RunRecord
from lammps_cases.report.findings import Outcome, outcome
from lammps_cases.run import campaign, tables
from lammps_cases.run.options import RunOptions, several
from lammps_cases.scene import casefile

if TYPE_CHECKING:  # pandas and ASE are imported only for tables and atoms
    import ase
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The result of `run` and `audit`: a run, or the audit of a deck, which is a run of one case.

    Attributes
    ----------
    record : RunRecord
        The complete record, the content of run.json.
    folder : Path
        Its report; a temporary folder lives as long as the result.
    """

    record: RunRecord
    folder: Path
    temporary: bool = False

    def __post_init__(self) -> None:
        remove_with(self, self.folder, self.temporary)

    @cached_property
    def outcome(self) -> Outcome:
        """Return the findings of the ledger in this run, and the run's result from them."""
        return outcome(self.record)

    @property
    def headline(self) -> Headline:
        """Return the headline: ``state`` is PASS, KNOWN BUGS, FAIL or EMPTY, ``sentence`` says why."""
        return self.outcome.headline

    @property
    def exit_code(self) -> int:
        """Return the exit code of the command."""
        return self.outcome.exit_code

    @property
    def verdicts(self) -> dict[str, int]:
        """Return the number of cases of every verdict."""
        return self.record.summary

    @property
    def cases(self) -> pd.DataFrame:
        """Return the table of cases; see `lammps_cases.run.tables.cases`."""
        return tables.cases(self.record)

    @property
    def fields(self) -> pd.DataFrame:
        """Return the table of fields; see `lammps_cases.run.tables.fields`."""
        return tables.fields(self.record)

    @property
    def findings(self) -> pd.DataFrame:
        """Return the table of findings; see `lammps_cases.run.tables.findings`."""
        return tables.findings(self.record)

    def to_pandas(self) -> pd.DataFrame:
        """Return the run as one table, `fields`; the others are `cases`, `findings`, `values` and `particles`."""
        return self.fields

    def values(self, select: str | Iterable[str] = "*") -> pd.DataFrame:
        """Return the table of values; see `lammps_cases.run.tables.values`."""
        return tables.values(self.folder, select)

    def particles(self, case: str | None = None) -> pd.DataFrame:
        """Return the table of particles; see `lammps_cases.run.tables.particles`; by default those of the only case."""
        return tables.particles(self.folder, self._case(case))

    def atoms(self, case: str | None = None) -> ase.Atoms:
        """Return the atoms of a case; see `lammps_cases.scene.ase_io.as_atoms`; by default those of the only case."""
        from lammps_cases.scene.ase_io import as_atoms

        return as_atoms(read_arrays(self.folder / "fields" / f"{self._case(case)}.npz"))

    def _case(self, name: str | None) -> str:
        names = [case.case for case in self.record.cases]
        if name is None and len(names) == 1:
            return names[0]
        if name is None:
            raise InputError("case", f"must be named, as there are {len(names)}")
        if name not in names:
            raise unknown("case", name, names).at("of this run")
        return name

    def __repr__(self) -> str:
        return f"<{self.headline}>"

    def _repr_html_(self) -> str:
        return html(self.headline, self.findings.drop(columns="cases"))


def html(headline: Headline, findings: pd.DataFrame) -> str:
    """Return a headline, and the findings below it, as a notebook shows them."""
    import pandas as pd

    with pd.option_context("display.max_colwidth", None):
        table = "" if findings.empty else findings.to_html(index=False)
    return f"<p><b>{headline.state}</b>: {escape(headline.sentence)}</p>{table}"


@contextmanager
def report_folder(out: str | Path | None) -> Iterator[tuple[Path, bool]]:
    """Yield the folder for a report, and whether it is temporary; in that case the result owns it."""
    if out is not None:
        yield Path(out), False
        return
    parent = Path(tempfile.mkdtemp(prefix="eos-ref-"))
    try:
        yield parent / "report", True
    except BaseException:
        shutil.rmtree(parent, ignore_errors=True)
        raise


def remove_with(result: object, folder: Path, temporary: bool) -> None:
    """Remove a temporary report together with its result."""
    if temporary:
        weakref.finalize(result, shutil.rmtree, folder.parent, ignore_errors=True)


@checked
@flat
def run(options: RunOptions, *, out: str | Path | None = None) -> Result:
    """Run cases against LAMMPS and compare them atom by atom, as ``eos-ref run`` does.

    Parameters
    ----------
    out : path, optional
        Folder of the report; by default a temporary one, removed with the result.
    (options)

    Raises
    ------
    InputError
        Bad input, in one line.
    EngineMissing
        LAMMPS with RHEO is missing.
    """
    chosen, allowed, engine = several(options.names), several(options.allow), options.engine
    given = [
        ("--allow", allowed),
        ("--tag", [options.tag] if options.tag else []),
        ("--cases", map(str, options.paths)),
    ]
    words = [*chosen, *(word for option, values in given for value in values for word in (option, value))]
    check_names(allowed)
    command = shlex.join(["eos-ref", "run", *words, *([] if engine == "env" else ["--engine", engine])])
    forkserver.start_for_judging()
    selected = casefile.select(casefile.load(options.paths), chosen, options.tag)
    resolved, store = installations.resolve(engine), open_store(options.fresh)
    asked = campaign.Request(command, options.level, allow=allowed)
    with report_folder(out) as (folder, temporary):
        record = campaign.run_cases(selected, resolved, options.processes, folder, asked, store=store)
        return Result(record, folder, temporary)
