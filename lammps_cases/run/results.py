"""What `lammps_cases.run` and `lammps_cases.audit` return: the record of a run, its report, and its tables."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lammps_cases.records.headline import Headline
from lammps_cases.records.run_record import RunRecord
from lammps_cases.run import tables

if TYPE_CHECKING:
    import ase
    import pandas as pd

    from lammps_cases.report.findings import Outcome


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """A run, or the audit of a deck, which is a run of one case.

    Attributes
    ----------
    record : RunRecord
        All that is known of it, the content of run.json.
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
        """The findings of the ledger in this run, and what follows from them."""
        from lammps_cases.report.findings import outcome

        return outcome(self.record)

    @property
    def headline(self) -> Headline:
        """The headline: ``state`` is PASS, KNOWN BUGS, FAIL or EMPTY, ``sentence`` says why."""
        return self.outcome.headline

    @property
    def exit_code(self) -> int:
        """The exit code of the command."""
        return self.outcome.exit_code

    @property
    def verdicts(self) -> dict[str, int]:
        """The number of cases of every verdict."""
        return self.record.summary

    @property
    def cases(self) -> pd.DataFrame:
        """See `lammps_cases.run.tables.cases`."""
        return tables.cases(self.record)

    @property
    def fields(self) -> pd.DataFrame:
        """See `lammps_cases.run.tables.fields`."""
        return tables.fields(self.record)

    @property
    def findings(self) -> pd.DataFrame:
        """See `lammps_cases.run.tables.findings`."""
        return tables.findings(self.record)

    def values(self, select: str | Iterable[str] = "*") -> pd.DataFrame:
        """See `lammps_cases.run.tables.values`."""
        return tables.values(self.folder, select)

    def particles(self, case: str | None = None) -> pd.DataFrame:
        """See `lammps_cases.run.tables.particles`; by default those of the only case."""
        return tables.particles(self.folder, self._case(case))

    def atoms(self, case: str | None = None) -> ase.Atoms:
        """See `lammps_cases.scene.ase_io.as_atoms`; by default those of the only case."""
        from lammps_cases.records.files import read_arrays
        from lammps_cases.scene.ase_io import as_atoms

        return as_atoms(read_arrays(self.folder / "fields" / f"{self._case(case)}.npz"))

    def _case(self, name: str | None) -> str:
        from eos_ref.errors import InputError, unknown

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


@contextmanager
def report_folder(out: str | Path | None) -> Iterator[tuple[Path, bool]]:
    """Yield the folder to write a report into, and whether it is temporary; then it is left to the result."""
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
    """Remove a temporary report when its result is gone."""
    if temporary:
        weakref.finalize(result, shutil.rmtree, folder.parent, ignore_errors=True)
