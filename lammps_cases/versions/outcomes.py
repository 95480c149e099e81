"""One side of a comparison: the outcome of every case, and LAMMPS' arrays where they were kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import InputError
from lammps_cases.records.case_parts import digest
from lammps_cases.records.files import read_arrays
from lammps_cases.records.outcome import CRASHES, CaseOutcome, FieldOutcome
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord, read_run


@dataclass(frozen=True)
class Sample:
    """LAMMPS' array of a field, and its bound, at one step; shape (n,), or (n, components)."""

    step: int | None
    values_n: npt.NDArray[Any]
    bound_n: npt.NDArray[Any]
    id_n: npt.NDArray[Any] | None = None


class Samples:
    """The arrays that a side kept of a case, read when asked for.

    Parameters
    ----------
    path : Path, optional
        An npz file, which may be missing.
    side : str
        What LAMMPS' array is called after its field.
    steps : mapping, optional
        The step of every field's arrays, where it is not in the file itself as ``FIELD.step`` (-1: without steps).
    natoms : int, optional
        How many atoms the case has; of very many a run keeps some alone, which are none of all.
    """

    def __init__(
        self,
        path: Path | None = None,
        side: str = "",
        steps: Mapping[str, int | None] | None = None,
        natoms: int | None = None,
    ) -> None:
        self._path, self._side, self._steps, self._natoms = path, side, steps, natoms

    @cached_property
    def _arrays(self) -> Mapping[str, npt.NDArray[Any]]:
        return read_arrays(self._path) if self._path and self._path.exists() else {}

    def of(self, field: str) -> Sample | None:
        """Return the arrays of a field; None if there are none.

        Raises
        ------
        InputError
            The file is damaged.
        """
        arrays = self._arrays
        if f"{field}.bound" not in arrays:
            return None
        try:
            values_n, bound_n = arrays[f"{field}{self._side}"], arrays[f"{field}.bound"]
            step = int(arrays[f"{field}.step"]) if self._steps is None else self._steps.get(field)
        except (KeyError, ValueError) as error:
            raise InputError("arrays", f"are damaged: {error}", where=str(self._path)) from None
        numbers = all(np.issubdtype(array.dtype, np.number) for array in (values_n, bound_n))
        if not numbers or values_n.shape != bound_n.shape or not values_n.ndim:
            raise InputError("arrays", f"must hold numbers of {field} and a bound for each", where=str(self._path))
        if self._natoms not in (None, len(values_n)):
            return None
        return Sample(None if step == -1 else step, values_n, bound_n)

    def kept(self, field: str) -> list[Sample]:
        """Return samples of a deck, the first is of its set-up; none of a case. See `versions.decks`."""
        return []


@dataclass(frozen=True)
class Side:
    """A run or a baseline.

    Attributes
    ----------
    name : what the user called it: an engine or a folder
    versions : of the reference that judged
    samples : LAMMPS' arrays of a case at the worst steps of its fields, where they were kept
    folder : of a run or a baseline
    machine : of a baseline, what decides how LAMMPS rounds; see `lammps_cases.versions.baseline.Identity`
    program : the library and such a machine, of a run as well: what gives the same bits; empty if not known
    """

    name: str
    engine: EngineRecord
    versions: Mapping[str, str]
    cases: Mapping[str, CaseOutcome]
    samples: Callable[[str], Samples] = lambda case: Samples()
    folder: Path = Path()
    machine: str = ""
    program: str = ""

    @property
    def answered(self) -> bool:
        """Whether the engine works at all: one that dies on every case does not."""
        return not self.cases or any(case.ended not in CRASHES for case in self.cases.values())

    @property
    def title(self) -> str:
        """The name with the version that answered."""
        version = self.engine.version[1]
        return self.name if version in self.name else f"{self.name} ({version})"


def of_run(run: RunRecord, folder: Path, name: str = "") -> Side:
    """Return the side that a run with the arrays in its report folder is.

    Raises
    ------
    InputError
        A case whose name is no name of a file.
    """
    for record in run.cases:
        if not record.case.isprintable() or "/" in record.case or record.case.startswith("."):
            raise InputError("case", "must be a name without slashes", record.case, str(folder))
    worst = {record.case: {field.field: field.worst_step for field in record.fields} for record in run.cases}
    natoms = {record.case: record.natoms for record in run.cases}
    audited = {record.case for record in run.cases if record.checks}
    cases = {record.case: comparable(record) for record in run.cases}

    def samples(case: str) -> Samples:
        if case in audited:
            from lammps_cases.versions import decks  # here: it imports this module

            return decks.of_report(folder, case)
        return Samples(folder / "fields" / f"{case}.npz", ".lammps", worst.get(case), natoms.get(case))

    program = program_of(run.engine, run.machine.get("kind", ""))
    return Side(name or str(folder), run.engine, dict(run.reference), cases, samples, folder, program=program)


def program_of(engine: EngineRecord, machine: str) -> str:
    """Return what gives the same bits of the same deck: a library on a kind of machine; empty if not known."""
    return f"{engine.library_sha256} on {machine}" if engine.library_sha256 and machine else ""


def read(folder: Path) -> Side:
    """Read the side of a report folder; see `lammps_cases.records.run_record.read_run` for what it raises."""
    return of_run(read_run(folder), folder)


def comparable(record: CaseRecord) -> CaseOutcome:
    """Return the outcome of a case in the form that a baseline has: findings in the order of their names."""
    outcome = CaseOutcome.of(record)
    fields = {name: _comparable(each, bool(record.twin)) for name, each in outcome.fields.items()}
    return replace(outcome, explained_by=tuple(sorted(outcome.explained_by)), fields=fields)


def _comparable(field: FieldOutcome, twin: bool) -> FieldOutcome:
    ratio, bits, by_step = field.max_over_bound, field.digest, field.by_step
    if twin:  # a digest is that of the first of two runs; their difference stands for the second
        by_step = tuple(replace(s, digest=s.digest and digest(s.digest, repr(s.max_abs))) for s in by_step)
        bits = digest(*(s.digest for s in by_step)) if by_step and all(s.digest for s in by_step) else bits
    if ratio is not None and math.isnan(ratio):
        ratio = math.inf  # what is not a number is as far off as can be
    findings = tuple(sorted(field.explained_by))
    return replace(field, explained_by=findings, max_over_bound=ratio, digest=bits, by_step=by_step)
