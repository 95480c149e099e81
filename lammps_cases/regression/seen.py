"""One side of a comparison: how every case ended, and the digest of every field of LAMMPS."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import InputError
from lammps_cases.records.run_record import (
    CaseRecord,
    Ended,
    EngineRecord,
    FieldRecord,
    RunRecord,
    Verdict,
    digest,
    read_run,
)
from lammps_cases.records.wording import INSIDE, field_name

CRASHES: tuple[Ended, ...] = ("crashed", "timeout", "error")


@dataclass(frozen=True)
class At:
    """A field at one step (None: the only one of a case without steps): verdict, difference over bound, digest."""

    step: int | None
    verdict: Verdict
    over_bound: float | None
    digest: str


@dataclass(frozen=True)
class FieldSeen:
    """A field of a case; ``digest`` is empty in runs of before there were digests."""

    field: str
    stage: str
    verdict: Verdict
    findings: tuple[str, ...] = ()
    over_bound: float | None = None
    digest: str = ""
    steps: tuple[At, ...] = ()

    @property
    def at(self) -> tuple[At, ...]:
        """Every step; the field as a whole where there is but one evaluation."""
        return self.steps or (At(None, self.verdict, self.over_bound, self.digest),)


@dataclass(frozen=True)
class CaseSeen:
    """A case: how it ended, and its fields by name.

    Attributes
    ----------
    expects : text of the refusal that the case is for; empty: none
    message : LAMMPS' words, or the blame; empty in a baseline
    seconds : wall time of LAMMPS; 0 where it is not known
    """

    case: str
    ended: Ended
    verdict: Verdict
    findings: tuple[str, ...] = ()
    expects: str = ""
    message: str = ""
    seconds: float = 0.0
    fields: Mapping[str, FieldSeen] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """Whether it ended as the manual says."""
        return self.verdict in INSIDE or (self.verdict == "refused" and bool(self.expects))


@dataclass(frozen=True)
class Sample:
    """LAMMPS' array of a field, and its bound, at one step."""

    step: int | None
    values_n: npt.NDArray[Any]
    bound_n: npt.NDArray[Any]


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
    """

    def __init__(self, path: Path | None = None, side: str = "", steps: Mapping[str, int | None] | None = None) -> None:
        self._path, self._side, self._steps = path, side, steps

    @cached_property
    def _arrays(self) -> Any:
        return np.load(self._path) if self._path and self._path.exists() else {}

    def of(self, field: str) -> Sample | None:
        """The arrays of a field; None if there are none.

        Raises
        ------
        InputError
            The file is damaged.
        """
        try:
            if f"{field}.bound" not in self._arrays:
                return None
            values_n, bound_n = self._arrays[f"{field}{self._side}"], self._arrays[f"{field}.bound"]
            step = int(self._arrays[f"{field}.step"]) if self._steps is None else self._steps.get(field)
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise InputError("arrays", f"are damaged: {error}", where=str(self._path)) from None
        numbers = all(np.issubdtype(array.dtype, np.number) for array in (values_n, bound_n))
        if not numbers or values_n.shape != bound_n.shape or not values_n.ndim:
            raise InputError("arrays", f"must hold numbers of {field} and a bound for each", where=str(self._path))
        return Sample(None if step == -1 else step, values_n, bound_n)


@dataclass(frozen=True)
class Side:
    """A run or a baseline.

    Attributes
    ----------
    name : what the user called it: an engine or a folder
    versions : of the reference that judged
    samples : LAMMPS' arrays of a case at the worst steps of its fields, where they were kept
    """

    name: str
    engine: EngineRecord
    versions: Mapping[str, str]
    cases: Mapping[str, CaseSeen]
    samples: Callable[[str], Samples] = lambda case: Samples()

    @property
    def answered(self) -> bool:
        """Whether the engine works at all: one that dies on every case does not."""
        return not self.cases or any(case.ended not in CRASHES for case in self.cases.values())

    @property
    def title(self) -> str:
        """The name with the version that answered."""
        version = self.engine.distribution or self.engine.git or self.engine.library_sha256[:16]
        return self.name if not version or version in self.name else f"{self.name} ({version})"


def of_run(run: RunRecord, folder: Path, name: str = "") -> Side:
    """A run with the arrays in its report folder.

    Raises
    ------
    InputError
        A case whose name is no name of a file.
    """
    for record in run.cases:
        if not record.case.isprintable() or "/" in record.case or record.case.startswith("."):
            raise InputError("case", "must be a name without slashes", record.case, str(folder))
    worst = {record.case: {found.field: found.worst_step for found in record.fields} for record in run.cases}
    cases = {record.case: case_seen(record) for record in run.cases}

    def samples(case: str) -> Samples:
        return Samples(folder / "fields" / f"{case}.npz", ".lammps", worst.get(case))

    return Side(name or str(folder), run.engine, dict(run.reference), cases, samples)


def read(folder: Path) -> Side:
    """The side of a report folder; see `lammps_cases.records.run_record.read_run` for what it raises."""
    return of_run(read_run(folder), folder)


def case_seen(record: CaseRecord) -> CaseSeen:
    """A case of a run."""
    return CaseSeen(
        case=record.case,
        ended="answered" if record.fields else record.ended,
        verdict=record.verdict,
        findings=tuple(sorted(record.explained_by)),
        expects=record.expects,
        message=record.message,
        seconds=record.seconds.lammps,
        fields={_name(found): _field(found, bool(record.twin)) for found in record.fields},
    )


def _name(record: FieldRecord) -> str:
    return field_name(record.field, record.atom_type)


def _field(record: FieldRecord, twin: bool) -> FieldSeen:
    # The digest of a twin's field is that of the first of two runs; their difference stands for the second.
    def whole(bits: str, difference: float | None) -> str:
        return digest(bits, repr(difference)) if twin and bits else bits

    steps = tuple(At(s.step, s.verdict, s.max_over_bound, whole(s.digest, s.max_abs)) for s in record.steps)
    bits = digest(*(s.digest for s in steps)) if twin and steps and all(s.digest for s in steps) else record.digest
    return FieldSeen(
        field=_name(record),
        stage=record.stage,
        verdict=record.verdict,
        findings=tuple(sorted(record.explained_by)),
        over_bound=_number(record.max_over_bound),
        digest=bits,
        steps=steps,
    )


def _number(ratio: float | None) -> float | None:
    """A ratio for ordering: what is not a number is as far off as can be."""
    return math.inf if ratio is not None and math.isnan(ratio) else ratio
