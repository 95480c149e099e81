"""One side of a comparison: the outcome of every case, and LAMMPS' arrays where they were kept.

For an audited deck samples and thermo output are kept as well: as arrays in its report, as text in a baseline, where
``decks/CASE/steps.tsv`` has a row per step with verdict and digest of every field, ``step-N.tsv`` a row per particle
of a sample, ``thermo.tsv`` the rows of thermo output: text, in which the first changed line is the first changed step.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from eos_ref import InputError
from lammps_cases.comparison.compare import excess
from lammps_cases.records.case_parts import VERDICTS, digest
from lammps_cases.records.files import MIB, csv_text, read_arrays, read_text, write_atomically
from lammps_cases.records.outcome import CRASHES, CaseOutcome, FieldOutcome, StepOutcome
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord, read_run

Array = npt.NDArray[Any]
DECKS, DECK_STEPS, THERMO = "decks", "steps.tsv", "thermo.tsv"
LARGEST = 256 * MIB
NOTHING = "-"
OUTPUT = "thermo"  # the name of thermo output among the fields
STATE = ("x", "v", "rho", "e")
PRINTED = 0.5e-7  # of a value: half a unit in the last of the 8 digits that LAMMPS prints in thermo output
T = TypeVar("T")


@dataclass(frozen=True)
class Sample:
    """LAMMPS' array of a field, and its bound, at one step; shape (n,), or (n, components)."""

    step: int | None
    values_n: npt.NDArray[Any]
    bound_n: npt.NDArray[Any]
    id_n: npt.NDArray[Any] | None = None


class Samples:
    """The arrays that a side kept of a case, read when they are needed.

    Parameters
    ----------
    path : Path, optional
        An npz file, which may be missing.
    side : str
        Suffix of LAMMPS' array after its field.
    steps : mapping, optional
        The step of every field's arrays, where it is not in the file itself as ``FIELD.step`` (-1: without steps).
    natoms : int, optional
        Number of atoms of the case; of very many a run keeps only some, which are then left out.
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
        """Return the arrays of a field; None if it has no arrays.

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
        """Return samples of a deck, the first from its set-up; empty for a case. See `DeckSamples`."""
        return []


@dataclass(frozen=True)
class Side:
    """A run or a baseline.

    Attributes
    ----------
    name : the user's name for it: an engine or a folder
    versions : of the reference that judged
    samples : LAMMPS' arrays of a case at the worst steps of its fields, where they were kept
    folder : of a run or a baseline
    machine : of a baseline, what determines LAMMPS' rounding; see `lammps_cases.versions.baseline.Identity`
    program : library and machine, also of a run: what gives the same bits; empty if not known
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
        """Whether the engine works at all, that is, does not die on every case."""
        return not self.cases or any(case.ended not in CRASHES for case in self.cases.values())

    @property
    def title(self) -> str:
        """The name with the version that answered."""
        version = self.engine.version[1]
        return self.name if version in self.name else f"{self.name} ({version})"


def of_run(run: RunRecord, folder: Path, name: str = "") -> Side:
    """Return the side of a run with the arrays in its report folder.

    Raises
    ------
    InputError
        A case whose name is not a file name.
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
            return of_report(folder, case)
        return Samples(folder / "fields" / f"{case}.npz", ".lammps", worst.get(case), natoms.get(case))

    program = program_of(run.engine, run.machine.get("kind", ""))
    return Side(name or str(folder), run.engine, dict(run.reference), cases, samples, folder, program=program)


def program_of(engine: EngineRecord, machine: str) -> str:
    """Return what gives the same bits for the same deck: a library on a kind of machine; empty if not known."""
    return f"{engine.library_sha256} on {machine}" if engine.library_sha256 and machine else ""


def read(folder: Path) -> Side:
    """Read the side of a report folder; raises as `lammps_cases.records.run_record.read_run`."""
    return of_run(read_run(folder), folder)


def comparable(record: CaseRecord) -> CaseOutcome:
    """Return the outcome of a case in the form of a baseline: findings in the order of their names."""
    outcome = CaseOutcome.of(record)
    fields = {name: _comparable(each, bool(record.twin)) for name, each in outcome.fields.items()}
    return replace(outcome, explained_by=tuple(sorted(outcome.explained_by)), fields=fields)


def _comparable(field: FieldOutcome, twin: bool) -> FieldOutcome:
    ratio, bits, by_step = field.max_over_bound, field.digest, field.by_step
    if twin:  # a digest is that of the first of two runs; their difference stands for the second
        by_step = tuple(replace(s, digest=s.digest and digest(s.digest, repr(s.max_abs))) for s in by_step)
        bits = digest(*(s.digest for s in by_step)) if by_step and all(s.digest for s in by_step) else bits
    if ratio is not None and math.isnan(ratio):
        ratio = math.inf  # NaN counts as infinitely far off
    findings = tuple(sorted(field.explained_by))
    return replace(field, explained_by=findings, max_over_bound=ratio, digest=bits, by_step=by_step)


@dataclass(frozen=True)
class BeyondBounds:
    """The first particle at which two samples differ by more than the bounds of both."""

    atom: int
    step: int
    was: float
    now: float
    ratio: float

    def __str__(self) -> str:
        off = f" ({self.ratio:.3g} x bound)" if self.ratio < np.inf else ""
        return f"atom {self.atom} at step {self.step}: {self.was:.10g}, now {self.now:.10g}{off}"


class DeckSamples(Samples):
    """The kept samples of a deck, read when needed; ``read`` returns the arrays of each by its step."""

    def __init__(self, read: Callable[[], Mapping[int, Mapping[str, Array]]]) -> None:
        super().__init__()
        self._read = read

    @cached_property
    def _by_step(self) -> Mapping[int, Mapping[str, Array]]:
        return self._read()

    def kept(self, field: str) -> list[Sample]:
        """Return the samples of a field, or of a part of the state, in the order of their steps."""
        name, _, of_type = field.partition(" (type ")
        return [
            _sample(step, arrays, name, int(of_type.rstrip(")") or 0))
            for step, arrays in sorted(self._by_step.items())
            if name in arrays
        ]


def _sample(step: int, arrays: Mapping[str, Array], name: str, of_type: int) -> Sample:
    values_n, id_n = arrays[name], arrays["id"].astype(int)
    bound_n = np.broadcast_to(arrays.get(f"{name}.bound", np.zeros((len(id_n), 1))), values_n.shape)
    rows_n = arrays["type"][:, 0] == of_type if of_type else slice(None)
    return Sample(step, values_n[rows_n], bound_n[rows_n], id_n[rows_n, 0])


def beyond(one: Sample, other: Sample) -> BeyondBounds | None:
    """Return the first particle whose values differ by more than both bounds; None without one.

    Both values lie within their bounds of the same prediction only if they differ by less.
    """
    if one.id_n is None or other.id_n is None or one.step is None or not np.array_equal(one.id_n, other.id_n):
        return None
    if one.step != other.step or one.values_n.shape != other.values_n.shape:
        return None
    ratio_nc = excess(one.values_n, other.values_n, one.bound_n + other.bound_n)[1]
    ratio_nc[np.isnan(one.values_n) & np.isnan(other.values_n)] = 0.0
    outside_n = ~(ratio_nc.max(axis=1, initial=0.0) <= 1)
    if not outside_n.any():
        return None
    at = int(np.argmax(outside_n))
    c = int(np.argmax(ratio_nc[at]))
    return BeyondBounds(
        int(one.id_n[at]), one.step, float(one.values_n[at, c]), float(other.values_n[at, c]), ratio_nc[at, c]
    )


def first_beyond(ours: Samples, theirs: Samples, field: str, every: bool) -> BeyondBounds | None:
    """Return the first particle beyond the bounds in the samples of the set-up, or in every sample."""
    pairs = zip(ours.kept(field), theirs.kept(field), strict=False)
    found = (beyond(one, other) for at, (one, other) in enumerate(pairs) if every or not at)
    return next((one for one in found if one is not None), None)


def thermo_parts(one: CaseOutcome, other: CaseOutcome) -> tuple[int, str, bool] | None:
    """Return where thermo output first differs: step, old and new value, whether in the digits that LAMMPS prints."""
    parted: list[tuple[int, str, bool]] = []
    for was, now in zip(one.thermo, other.thermo, strict=False):
        if was.keys() != now.keys():
            parted.append((int(now.get("Step", 0)), "other columns", True))
        for name in was.keys() & now.keys():
            a, b = was[name], now[name]
            if repr(a) != repr(b):
                shown = not abs(a - b) <= 2 * PRINTED * max(abs(a), abs(b))
                parted.append((int(now.get("Step", 0)), f"{name} {a:.8g}, now {b:.8g}", shown))
    if len(one.thermo) != len(other.thermo):
        parted.append((0, f"{len(one.thermo)} rows, now {len(other.thermo)}", True))
    return next((each for each in parted if each[2]), parted[0] if parted else None)


def of_report(folder: Path, case: str) -> DeckSamples:
    """Return the samples in the report of an audit."""
    return DeckSamples(lambda: _by_step(folder / "fields" / f"{case}@kept.npz"))


def _by_step(path: Path) -> dict[int, dict[str, Array]]:
    by_step: dict[int, dict[str, Array]] = {}
    for key, values_n in (read_arrays(path) if path.exists() else {}).items():
        step, _, name = key.partition("/")
        by_step.setdefault(int(step), {})[name] = values_n
    return by_step


def write_deck(folder: Path, case: CaseOutcome, report: Path) -> None:
    """Write the kept data of a deck as text into a folder of a baseline; ``report`` is that of its audit."""
    fields = sorted(case.fields.values(), key=lambda field: field.name)
    at = {field.name: {s.step: f"{s.verdict}:{s.digest}" for s in field.by_step} for field in fields}
    steps = sorted({s.step for field in fields for s in field.by_step if s.step is not None})
    rows = ((str(step), *(of_field.get(step, NOTHING) for of_field in at.values())) for step in steps)
    write_atomically(folder / DECK_STEPS, csv_text([("step", *at), *rows], "\t"))
    names = list(dict.fromkeys(name for row in case.thermo for name in row))
    values = ([repr(row[name]) if name in row else NOTHING for name in names] for row in case.thermo)
    write_atomically(folder / THERMO, csv_text([names, *values], "\t"))
    for step, arrays in _by_step(report / "fields" / f"{case.case}@kept.npz").items():
        write_atomically(folder / f"step-{step}.tsv", csv_text(_particles(arrays), "\t"))


def _particles(arrays: Mapping[str, Array]) -> Iterator[Sequence[str]]:
    """Yield names of columns, then a row per particle; numbers read back as the same doubles, bounds are rounded."""
    order = [*("id", "type"), *(name for name in STATE if name in arrays)]
    order += sorted(arrays.keys() - set(order))
    columns = {}
    for name in order:
        whole, bound, parts = name in ("id", "type"), name.endswith(".bound"), arrays[name].shape[1]
        for k in range(parts):
            values = arrays[name][:, k].tolist()
            text = map(str, map(int, values)) if whole else (f"{1.01 * b:.2e}" if bound else repr(b) for b in values)
            columns[name if parts == 1 else f"{name}[{k + 1}]"] = list(text)
    yield list(columns)
    yield from zip(*columns.values(), strict=True)


def read_deck(folder: Path, case: CaseOutcome) -> CaseOutcome:
    """Return a case with the steps and the thermo output from a folder of a baseline.

    Raises
    ------
    InputError
        A damaged file: its name and line.
    """

    def look(step: int, cell: str) -> StepOutcome:
        verdict, _, bits = cell.partition(":")
        return StepOutcome(step, VERDICTS[VERDICTS.index(verdict)], bits)

    rows = _deck_table(folder / DECK_STEPS, lambda row: {name: cell for name, cell in row.items() if cell != NOTHING})
    try:
        steps = {name: tuple(look(int(row["step"]), row[name]) for row in rows if name in row) for name in case.fields}
    except (ValueError, KeyError) as error:
        raise InputError("baseline", f"is damaged: {error}", where=str(folder / DECK_STEPS)) from None
    fields = {name: replace(each, by_step=steps[name]) for name, each in case.fields.items()}
    thermo = _deck_table(
        folder / THERMO, lambda row: {name: float(cell) for name, cell in row.items() if cell != NOTHING}
    )
    return replace(case, fields=fields, thermo=tuple(thermo))


def of_baseline(folder: Path) -> DeckSamples:
    """Return the samples in a folder of a baseline."""
    return DeckSamples(
        lambda: {int(path.stem.removeprefix("step-")): _deck_arrays(path) for path in folder.glob("step-*")}
    )


def _deck_arrays(path: Path) -> dict[str, Array]:
    rows = _deck_table(path, lambda row: {name: float(cell) for name, cell in row.items()})
    columns: dict[str, list[list[float]]] = {}
    for name in rows[0] if rows else ():
        columns.setdefault(name.partition("[")[0], []).append([row[name] for row in rows])
    return {name: np.array(parts).T for name, parts in columns.items()}


def _deck_table(path: Path, of_row: Callable[[dict[str, str]], T]) -> list[T]:
    head, *rows = list(csv.reader(read_text(path, "baseline", LARGEST).splitlines(), delimiter="\t")) or [[]]
    made = []
    for number, row in enumerate(rows, 2):
        try:
            made.append(of_row(dict(zip(head, row, strict=True))))
        except ValueError as error:
            raise InputError("line", f"is damaged: {error}", where=f"{path}, line {number}") from None
    return made
