"""Runs and audits as pandas tables, for notebooks, and the units that fields are measured in.

Every table has the units of its columns in ``.attrs["units"]``; those of `values` by case and field.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from eos_ref.errors import InputError, unknown
from eos_ref.model.quantities import DENSITY, ENERGY, PRESSURE, QUANTITIES, VISCOSITY, Dimension
from eos_ref.model.units import KINDS
from lammps_cases.comparison.compare import excess
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.files import read_arrays
from lammps_cases.records.run_record import CaseRecord, RunRecord, read_run
from lammps_cases.records.wording import parted
from lammps_cases.report.findings import outcome

if TYPE_CHECKING:  # imported where a table is made
    import pandas as pd

Arrays = dict[str, npt.NDArray[Any]]
SIDES = ("lammps", "reference", "bound")
OF_ALL = ("box", "step", "periodic")  # arrays that do not belong to a single particle
VALUE_COLUMNS = ("case", "step", "id", "type", "field", "component", *SIDES, "ratio", "verdict")
# Units of length, mass, time and temperature; those of lj are defined by the user.
BASE = {
    "lj": ("length", "mass", "time", "temperature"),
    "si": ("m", "kg", "s", "K"),
    "cgs": ("cm", "g", "s", "K"),
    "micro": ("um", "pg", "us", "K"),
    "nano": ("nm", "ag", "ns", "K"),
    "real": ("Angstrom", "(g/mol)", "fs", "K"),
    "metal": ("Angstrom", "(g/mol)", "ps", "K"),
}
OWN = {
    "real": {"energy": "kcal/mol", "pressure": "atm", "density": "g/cm^3", "viscosity": "Poise"},
    "metal": {"energy": "eV", "pressure": "bar", "density": "g/cm^3", "viscosity": "Poise"},
}
_OF_KIND = {"energy": ENERGY, "pressure": PRESSURE, "density": DENSITY, "viscosity": VISCOSITY}
_OF_TEMPERATURE = {"temperature": 1, "cv": -1, "conductivity": -1}
_OTHER_NAMES = {"esph": "energy"}


def cases(run: str | Path | RunRecord) -> pd.DataFrame:
    """Tabulate the cases of a run: verdict, whether it is as expected, findings, particles, steps, message, times.

    Raises
    ------
    InputError
        The folder holds no run.
    """
    record = _record(run)
    names = ("case", "verdict", "as_expected", "natoms", "steps", "dimension", "units", "twin", "message")
    rows = [
        {name: getattr(case, name) for name in names}
        | {"tags": ", ".join(case.tags), "findings": ", ".join(case.findings)}
        | {"seconds_lammps": case.seconds.lammps, "seconds_reference": case.seconds.reference}
        for case in record.cases
    ]
    return _frame(rows, {"seconds_lammps": "s", "seconds_reference": "s"})


def fields(run: str | Path | RunRecord) -> pd.DataFrame:
    """Tabulate the compared fields of a run: case, field, stage, verdict, errors, findings, digits lost.

    Errors are those of the worst step, in the unit of the column ``unit``; ``step`` is that step.

    Raises
    ------
    InputError
        The folder holds no run.
    """
    names = {"field", "stage", "verdict", "max_abs", "max_over_bound", "bound", "worst_id"}
    rows = [
        {
            "case": case.case,
            "units": case.units,
            "natoms": case.natoms,
            "type": field.atom_type or 0,
            **field.model_dump(include=names),
            "step": _step(case, field),
            "unit": _unit(case, field.field),
            "explained_by": ", ".join(field.explained_by),
            "digits_lost_lammps": field.digits_lost.lammps,
            "digits_lost_reference": field.digits_lost.reference,
        }
        for case in _record(run).cases
        for field in case.fields
    ]
    return _frame(rows, dict.fromkeys(("max_abs", "bound"), "of the column unit"))


def findings(run: str | Path | RunRecord) -> pd.DataFrame:
    """Tabulate the findings that a run shows, the most severe first: id, severity, title, effect, workaround, cases."""
    of_run = outcome(_record(run))
    rows = [
        {name: getattr(one.entry, name) for name in ("id", "severity", "title", "effect", "workaround")}
        | {"severity": of_run.known[one.entry.id], "effect": of_run.effect(one), "cases": ", ".join(one.cases)}
        for one in of_run.shown
    ]
    return _frame(rows, {}, ("id", "severity", "title", "effect", "workaround", "cases"))


def particles(run: str | Path, case: str) -> pd.DataFrame:
    """Tabulate the particles of a case, one a row: id, type, position, density and both sides of every compared field.

    Components of vectors and tensors have separate columns: ``f/x.lammps``, ``grad/v/xy.bound``. Fields are those
    of the step at which they come closest to their bounds, see ``.attrs["step"]``.

    Raises
    ------
    InputError
        The folder holds no run, or no arrays of such a case.
    """
    import pandas as pd

    record = _case(_record(run), case)
    arrays = _arrays(Path(run), record.case)
    columns: dict[str, npt.NDArray[Any]] = {}
    units: dict[str, str] = {}
    for name in arrays:
        if name not in (*OF_ALL, "x"):
            new = _columns(name, arrays[name])
            field = name.rpartition(".")[0] if name.rpartition(".")[2] in SIDES else name
            columns |= new
            units |= dict.fromkeys(new, _unit(record, field))
    columns |= dict(zip("xyz", arrays["x"].T, strict=True))
    units |= dict.fromkeys("xyz", _unit(record, "x"))
    frame = pd.DataFrame(columns).sort_values("id", ignore_index=True)
    frame.attrs = {"units": units, "step": {f.field: _step(record, f) for f in record.fields}}
    return frame


def values(run: str | Path, select: str | Iterable[str] = "*") -> pd.DataFrame:
    """Tabulate every value compared, one a row: `VALUE_COLUMNS`.

    ``step`` is the one at which the field comes closest to its bound (none for values carried over a stop), and
    ``verdict`` that of the field there; for a single value ``ratio``, the difference over the bound, shows whether it
    is inside (at most 1). For a twin ``reference`` is the other run of LAMMPS.

    Parameters
    ----------
    select : str or iterable of str
        Names of cases, or patterns.

    Raises
    ------
    InputError
        The folder holds no run, or a name that no case has.
    """
    import pandas as pd

    record = _record(run)
    parts = [
        part
        for case in _selected(record, select)
        for part in _long(case, _arrays(Path(run), case.case) if case.fields else {})
    ]
    counts = [len(part["id"]) for part in parts]
    columns: dict[str, Any] = {}
    for name in VALUE_COLUMNS:
        column = [part[name] for part in parts]
        if name in ("case", "field", "component"):
            columns[name] = pd.Categorical(np.repeat(np.array(column, str), counts))
        elif name == "step":
            columns[name] = pd.array(list(itertools.chain(*map(itertools.repeat, column, counts))), dtype="Int64")
        else:
            columns[name] = np.concatenate(column) if column else np.empty(0)
    columns["verdict"] = pd.Categorical(columns["verdict"])
    frame = pd.DataFrame(columns)
    frame.attrs = {"units": {c.case: {f.field: _unit(c, f.field) for f in c.fields} for c in record.cases}}
    return frame


def write(frame: pd.DataFrame, path: str | Path) -> None:
    """Write a table: ``.parquet`` with its units, or ``.csv``.

    Raises
    ------
    InputError
        Another suffix, a file that cannot be written, or no pyarrow for Parquet.
    """
    path = Path(path)
    try:
        if path.suffix == ".parquet":
            frame.to_parquet(path, index=False, engine="pyarrow")
        elif path.suffix == ".csv":
            frame.to_csv(path, index=False)
        else:
            raise InputError("table", "must be written to a file .parquet or .csv", str(path))
    except ImportError:
        raise InputError("table", "needs pyarrow for Parquet: pip install 'eos-ref[parquet]'", str(path)) from None
    except OSError as error:
        raise InputError("table", f"cannot be written: {error.strerror or error}", str(path)) from None


def unit(field: str, style: str, dimension: int) -> str:
    """Return the unit of a field in a system of units: ``kg m^-1 s^-2``; 1 for counts, classes and ratios.

    Parameters
    ----------
    field : str
        By its name in a record; see `lammps_cases.records.wording`.
    style : str
        As in the command units.
    dimension : int
        2 or 3: densities, pressures and stresses are per area or per volume.
    """
    name, _ = parted(field)
    name = _OTHER_NAMES.get(name, name)
    if name == "e":  # energy per mass
        return _product(style, Dimension(2, 0, -2), dimension, "")
    if name not in QUANTITIES:
        return "1"
    powers = QUANTITIES[name].dimension
    kind = next((kind for kind in OWN.get(style, {}) if name in KINDS[kind]), None)  # type: ignore[index]
    if kind is None:
        return _product(style, powers, dimension, "", _OF_TEMPERATURE.get(name, 0))
    rest = Dimension(*(a - b for a, b in zip(powers, _OF_KIND[kind], strict=True)))
    return _product(style, rest, dimension, OWN[style][kind], _OF_TEMPERATURE.get(name, 0))


def _product(style: str, powers: Dimension, dimension: int, own: str, temperature: int = 0) -> str:
    """Return a separate unit times powers of base units."""
    of_base = (powers.mass, powers.length + dimension * powers.volume, powers.time, temperature)
    length, mass, time, kelvin = BASE[style]
    factors = [own] * bool(own)
    for base, power in zip((mass, length, time, kelvin), of_base, strict=True):
        if power:
            factors.append(base if power == 1 else f"{base}^{power}")
    return " ".join(factors) or "1"


def _record(run: str | Path | RunRecord) -> RunRecord:
    return run if isinstance(run, RunRecord) else read_run(Path(run))


def _case(record: RunRecord, name: str) -> CaseRecord:
    for case in record.cases:
        if case.case == name:
            return case
    raise unknown("case", name, [case.case for case in record.cases]).at("of this run")


def _selected(record: RunRecord, select: str | Iterable[str]) -> list[CaseRecord]:
    patterns = [select] if isinstance(select, str) else list(select)
    for pattern in patterns:
        if not any(_named(case.case, pattern) for case in record.cases):
            raise unknown("case", pattern, [case.case for case in record.cases]).at("of this run")
    return [case for case in record.cases if any(_named(case.case, pattern) for pattern in patterns)]


def _named(case: str, pattern: str) -> bool:
    return fnmatchcase(case, pattern) or case.startswith(f"{pattern}.")


def _arrays(run: Path, case: str) -> Arrays:
    return read_arrays(run / "fields" / f"{case}.npz")


def _frame(rows: list[dict[str, Any]], units: dict[str, str], columns: Iterable[str] = ()) -> pd.DataFrame:
    import pandas as pd

    frame = pd.DataFrame(rows, columns=list(columns) or None)
    frame.attrs = {"units": units}
    return frame


def _unit(case: CaseRecord, field: str) -> str:
    return unit(field, case.units or "lj", case.dimension or 3)


def _step(case: CaseRecord, field: FieldRecord) -> int | None:
    """Return the step of a field's arrays: for a law that after all steps, for input that before them."""
    if field.worst_step is not None:
        return field.worst_step
    laws = all(other.worst_step is None for other in case.fields)
    return case.steps if laws else 0 if field.stage == "input" else None


def _long(case: CaseRecord, arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Yield the columns of `values` for every component of every field that was compared for all particles."""
    for name in dict.fromkeys(field.field for field in case.fields):
        if f"{name}.bound" not in arrays:
            continue  # an audit compared it only for some atoms
        sides = [np.asarray(arrays[f"{name}.{side}"], float) for side in SIDES]
        field = next(field for field in case.fields if field.field == name)
        one: dict[str, Any] = {"case": case.case, "field": name, "id": arrays["id"], "type": arrays["type"]}
        one["step"] = int(arrays["step"]) if case.checks else _step(case, field)
        one["verdict"] = _verdicts(case, field, arrays["type"])
        for component, parts in _components(*sides, excess(*sides)[1]):
            yield one | dict(zip((*SIDES, "ratio"), parts, strict=True), component=component)


def _verdicts(case: CaseRecord, field: FieldRecord, type_n: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the verdict of a field at the step of its arrays for every particle; that of its type in an audit."""
    at_step = next((at.verdict for at in field.steps if at.step == field.worst_step), field.verdict)
    verdict_n = np.full(len(type_n), at_step, "<U9")
    for check in case.checks:  # the last check comes last
        if check.field == field.field:
            verdict_n[type_n == check.type if check.type else slice(None)] = check.verdict
    return verdict_n


def _components(*arrays: npt.NDArray[Any]) -> Iterator[tuple[str, list[npt.NDArray[Any]]]]:
    """Yield the components of some fields of one shape, by their axes; "" for a scalar."""
    first = arrays[0]
    axes = itertools.product("xyz"[: first.shape[-1]] if first.ndim > 1 else "", repeat=first.ndim - 1)
    for at, axis in enumerate(axes):
        yield "".join(axis), [array.reshape(len(array), -1)[:, at] for array in arrays]


def _columns(name: str, values: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    if values.ndim == 1:
        return {name: values}
    field, dot, side = name.rpartition(".")
    whole, end = (field, f"{dot}{side}") if side in SIDES else (name, "")
    return {f"{whole}/{component}{end}": part for component, (part,) in _components(values)}
