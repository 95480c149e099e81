"""The numbers from which the page draws: a few hundred atoms of a case, the curves of its laws, its checks.

Arrays are encoded as base64 of little-endian floats, NaN and infinity included, the first bytes of all numbers before
their second ones: that, and digits that are zero, makes the page compressible. A prefix gives the size of each number:
``d:`` float64, ``f:`` float32, ``b:`` the upper half of a float32. A constant is one number. The drawing
itself happens in the browser, when a case is opened.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos.registry import LAWS
from eos_ref.eos.table import EOS, FloatArray
from eos_ref.errors import InputError
from lammps_cases.comparison.compare import excess
from lammps_cases.records import wording
from lammps_cases.records.case_parts import CheckRecord, FieldRecord
from lammps_cases.records.run_record import CaseRecord

Arrays = Mapping[str, npt.NDArray[Any]]
Differences = Mapping[str, tuple[FloatArray, FloatArray]]
ATOMS = 400  # atoms embedded per case
MODEL_ATOMS = 200  # for the particle model with a dozen fields
CHECKS = 600  # checks of an audit embedded per case
SINGLE = np.finfo(np.float32)
CURVE, VALUE, SIZE = 20, 14, 8  # binary digits of a curve, of a value, and of a size on a logarithmic scale
GRID = 200  # points of a curve
NEIGHBOURS = 40  # nearest neighbours listed for an atom


def payload(
    case: CaseRecord, arrays: Arrays | None, by_field: Differences, further: Arrays = MappingProxyType({})
) -> tuple[dict[str, Any] | None, dict[str, Any]]:
    """Return the JSON data from which the page draws a case, and more of it that a long page leaves out.

    None if there is nothing to draw. ``further`` are the arrays of other steps and of pairs.
    """
    data: dict[str, Any] = {}
    more: dict[str, Any] = {}
    if arrays is not None:
        data, more = _atoms(case, arrays, by_field, further)
        if first := more.pop(data.get("first", ""), None):
            data["fields"][data["first"]] |= first
        data |= _pairs(further)
    if case.checks:
        data["checks"] = _checks(case.checks)
    return data or None, more


def differences(arrays: Arrays) -> Differences:
    """Return the absolute difference and its ratio to the bound, shape (n,) each, with the rule of the comparison.

    For every field with both sides and the bound, in the order of the names.
    """
    names = sorted(name.removesuffix(".lammps") for name in arrays if name.endswith(".lammps"))
    sides = {field: [arrays.get(f"{field}.{side}") for side in ("lammps", "reference", "bound")] for field in names}
    return {
        field: excess(*(np.asarray(values, float) for values in arrays_of))
        for field, arrays_of in sides.items()
        if all(values is not None for values in arrays_of)
    }


def thinned(ratio_n: FloatArray, key_n: FloatArray, group_n: npt.NDArray[Any], limit: int) -> npt.NDArray[np.intp]:
    """Return positions of at most ``limit`` of n points: the worst quarter by ratio, others evenly by group and key."""
    if ratio_n.size <= limit:
        return np.arange(ratio_n.size)
    worst = np.argsort(-ratio_n, kind="stable")[: limit // 4]
    others = np.lexsort((key_n, group_n))
    kept = np.ones(ratio_n.size, bool)
    kept[worst] = False
    others = others[kept[others]]
    even = np.linspace(0, others.size - 1, limit - worst.size).astype(int)
    return np.sort(np.concatenate([worst, others[even]]))


def many_decades(values: FloatArray) -> bool:
    """Return whether a good part of the values lies three decades or more below the largest one."""
    sizes = np.abs(values[np.isfinite(values) & (values != 0)])
    fifth = sizes.size // 5
    return bool(sizes.size) and float(np.partition(sizes, fifth)[fifth]) < 1e-3 * float(sizes.max())


def scale_of(values: FloatArray) -> dict[str, Any]:
    """Choose a linear scale, or one logarithmic on both sides of zero (`symlog`), linear below its ``decade``."""
    if not many_decades(values):
        return {"kind": "linear"}
    sizes = np.abs(values[np.isfinite(values) & (values != 0)])
    # Never less than the smallest normal number, whose decade can still be divided by.
    return {"kind": "symlog", "decade": max(int(np.floor(np.log10(sizes.min()))), -307)}


def offsets(case: CaseRecord, type_n: npt.NDArray[Any], rho_n: FloatArray) -> FloatArray:
    """Return (rho - rho0)/rho0, shape (n,), with the rho0 of every atom's type; NaN for a type without a law."""
    delta_n = np.full(rho_n.shape, np.nan)
    for law in case.laws:
        of_type = type_n == law.type
        with np.errstate(all="ignore"):
            delta_n[of_type] = (rho_n[of_type] - law.rho0) / law.rho0
    return delta_n


def _atoms(
    case: CaseRecord, arrays: Arrays, by_field: Differences, further: Arrays
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the data drawn of the atoms of a case; empty for a model case whose fields all have the same bits.

    The other steps of every field are returned, too.
    """
    stepped = {record.field: record for record in case.fields if record.steps}
    law = "pressure" in by_field and not stepped
    worst = "" if stepped else _worst(case, by_field)
    fields = _drawn_fields(case, by_field, ["pressure", worst] if law else [worst])
    if stepped and not fields:
        return {}, {}
    type_n, rho_n = arrays["type"], np.asarray(arrays["rho"], float)
    ratio_n = np.max([by_field[field][1] for field in fields], axis=0) if fields else np.zeros(rho_n.shape)
    picked = thinned(ratio_n, rho_n, type_n, MODEL_ATOMS if stepped else ATOMS)
    data = _particles(case, arrays, picked) | {
        "fields": {field: _field(arrays, field, picked, bool(stepped)) for field in fields},
        "laws": _curves(case, arrays) if law else [],
    }
    if stepped:
        data |= _of_model(case, arrays, fields, picked)
    else:
        data["rho"] = _column(rho_n[picked])
        data |= _of_audit(case, arrays, fields, worst)
    if "e" in arrays:
        data["energy"] = _column((rho_n * arrays["e"])[picked])
    return data, _other_steps(further, fields, picked)


def _drawn_fields(case: CaseRecord, by_field: Differences, always: list[str]) -> list[str]:
    """List the fields with a picture, in the order of the record, which is that of a step.

    An input that LAMMPS holds exactly as given has none, nor has a field of the model with the same bits.
    """
    recorded = dict.fromkeys(record.field for record in case.fields if record.field in by_field)
    return [field for field in {**recorded, **by_field} if field in always or by_field[field][0].any()]


def _particles(case: CaseRecord, arrays: Arrays, picked: npt.NDArray[np.intp]) -> dict[str, Any]:
    """Return the box, and number, id, type and position of the selected atoms."""
    x_nc = np.asarray(arrays["x"], float)[picked]
    dimension = case.dimension or (3 if np.ptp(x_nc[:, 2]) > 0 else 2)
    return {
        "natoms": max(case.natoms, int(arrays["rho"].size)),  # of very many atoms not all are kept
        "n": int(picked.size),
        "types": [int(t) for t in np.unique(arrays["type"])],
        "rho0": {str(law.type): law.rho0 for law in case.laws if math.isfinite(law.rho0)},
        "x": [_column(x_nc[:, c], VALUE) for c in range(dimension)],
        "box": _packed(arrays["box"]) if "box" in arrays else None,
        "id": _column(arrays["id"][picked]),
        "type": _column(arrays["type"][picked]),
    }


def _of_model(case: CaseRecord, arrays: Arrays, fields: list[str], picked: npt.NDArray[np.intp]) -> dict[str, Any]:
    """Return the additional data of the particle model: steps, the first field outside its bound, phases."""
    data: dict[str, Any] = {
        "steps": {record.field: record.worst_step for record in case.fields if record.steps and record.field in fields},
        "other": "twin" if case.twin else "reference",
        "compared": len({at.step for record in case.fields for at in record.steps}),
        "first": _first(case, fields),
    }
    if "phase.lammps" in arrays:
        data["phase"] = _column(arrays["phase.lammps"][picked])
    return data


def _worst(case: CaseRecord, fields: Collection[str]) -> str:
    """Return the field to blame, of those drawn: worst verdict, then largest ratio; pressure if all are the same."""
    records = [record for record in case.fields if record.field in fields]
    first = sorted(records, key=lambda record: record.field != "pressure")
    return max(first, key=wording.how_bad).field if first else ""


def _of_audit(case: CaseRecord, arrays: Arrays, fields: list[str], first: str) -> dict[str, Any]:
    """Return the field to begin with; for an audit also the step of the arrays, and the fields worse at other steps."""
    data: dict[str, Any] = {"first": first} if first in fields else {}
    if "step" not in arrays:
        return data
    step = int(arrays["step"])
    worst: dict[str, FieldRecord] = {}
    for record in sorted(case.fields, key=wording.how_bad):
        worst[record.field] = record
    elsewhere = {
        field: [worst[field].worst_step, _packed([worst[field].max_over_bound or 0.0])]
        for field in fields
        if field in worst and worst[field].max_over_bound and worst[field].worst_step not in (None, step)
    }
    return data | {"step": step, "elsewhere": elsewhere}


def _first(case: CaseRecord, fields: list[str]) -> str:
    """Return the field in which a difference enters: at the earliest step, the first that is outside its bound."""
    outside = [
        (at.step, place, record.field)
        for place, record in enumerate(case.fields)
        for at in record.steps
        if record.field in fields and at.verdict not in ("exact", "pass")
    ]
    if outside:
        return min(outside)[2]
    ratios = {record.field: record.max_over_bound or 0.0 for record in case.fields if record.field in fields}
    return max(fields, key=lambda field: ratios.get(field, 0.0))


def _field(arrays: Arrays, field: str, picked: npt.NDArray[np.intp], model: bool) -> dict[str, Any]:
    sides = (np.asarray(arrays[f"{field}.{side}"], float)[picked] for side in ("lammps", "reference", "bound"))
    lammps_n, reference_n, bound_n = sides
    with np.errstate(all="ignore"):
        difference_n = lammps_n - reference_n
        difference_n[~(np.isfinite(lammps_n) & np.isfinite(reference_n))] = np.inf
        # Few digits suffice, unless they decide on which side of the bound an atom is: each may be off by half a unit.
        decided = np.abs(np.abs(difference_n) / bound_n - 1) > 2.0 ** (2 - SIZE)
        digits = SIZE if bool(np.all(decided | (difference_n == 0))) else None
    return {
        "lammps": _column(lammps_n, VALUE if model else None),
        "difference": _column(difference_n, digits),
        "bound": _column(bound_n, digits),
        "scale": scale_of(lammps_n),
    }


def _other_steps(further: Arrays, fields: list[str], picked: npt.NDArray[np.intp]) -> dict[str, Any]:
    """Return the other steps of every field drawn, by field and step, of the atoms drawn."""
    others: dict[str, Any] = {}
    for name in sorted(name for name in further if " lammps " in name):
        step, field = name.removeprefix("@").split(" lammps ")
        if field in fields:
            sides = {f"{field}.{side}": further[f"@{step} {side} {field}"] for side in ("lammps", "reference", "bound")}
            others.setdefault(field, {"at": {}})["at"][step] = _field(sides, field, picked, True)
    return others


def _pairs(further: Arrays) -> dict[str, Any]:
    """Return the nearest pairs of the selected atoms, with the contributions of each, and the sums over all pairs."""
    if "@pairs step" not in further:
        return {}
    of = {name.removeprefix("@pairs "): values for name, values in further.items() if name.startswith("@pairs ")}
    names, begin_k = of["names"].tolist(), np.cumsum(of["count"]) - of["count"]
    shown_k = np.minimum(of["count"], NEIGHBOURS)
    rows = np.concatenate([np.arange(a, a + n) for a, n in zip(begin_k, shown_k, strict=True)]).astype(int)
    # If all of the force is due to pressure, it is given once.
    columns = [k for k, name in enumerate(names) if not name.startswith("pressure_force") or not _same(of, names, k)]
    return {
        "pairs": {
            **{name: of[name].tolist() for name in ("atom", "step", "count")},
            "shown": shown_k.tolist(),
            "names": [names[k] for k in columns],
            "id": _column(of["id"][rows]),
            "r": _column(of["r"][rows], VALUE),
            "pair": [_column(of["pair"][rows, k], SIZE) for k in columns],
            "sum": [_column(of["sum"][:, k], VALUE) for k in columns],
        }
    }


def _same(of: Arrays, names: list[str], k: int) -> bool:
    force = names.index(names[k].removeprefix("pressure_"))
    return bool(np.array_equal(of["pair"][:, k], of["pair"][:, force]))


def _curves(case: CaseRecord, arrays: Arrays) -> list[dict[str, Any]]:
    curves = []
    for record in case.laws:
        of_type = (arrays["type"] == record.type) & np.isfinite(arrays["rho"])
        rho_n = np.asarray(arrays["rho"], float)[of_type]
        energy_n = rho_n * arrays["e"][of_type] if "e" in arrays else None
        if not rho_n.size or (energy_n is None and LAWS[record.style].needs_energy):
            continue
        try:
            law = EOS(record.style, record.rho0, record.cs, record.parameter, record.background)
        except InputError:  # a scene may test parameters outside the law's domain: no curve
            continue
        named = {"type": record.type, "style": record.style, "rho0": record.rho0}
        curves.append(named | _curve(law, rho_n, energy_n))
    return curves


def _curve(law: EOS, rho_n: FloatArray, energy_n: FloatArray | None) -> dict[str, Any]:
    """Return the pressure of a law on a grid over the data, against the quantity that shows it best.

    The law is evaluated by its numpy body: a curve is not worth loading the compiled one.
    """
    with np.errstate(all="ignore"):
        if law.needs_energy and energy_n is not None:  # one line for all energies: P against rho e
            quantity, scale = "energy", scale_of(energy_n)
            grid = _grid(energy_n, scale)
            p = law.evaluate(grid, np.ones_like(grid))
        else:
            quantity, scale = _abscissa(law.rho0, rho_n)
            delta_n = (rho_n - law.rho0) / law.rho0
            rho = {
                "delta": lambda: law.rho0 * (1 + _grid(delta_n, scale)),
                "ratio": lambda: law.rho0 * _grid(rho_n / law.rho0, scale),
                "rho": lambda: _grid(rho_n, scale),
            }[quantity]()
            p = law.evaluate(rho)
            # From the rounded density, so that points and curve agree even where rho - rho0 has few digits.
            grid = {"delta": (rho - law.rho0) / law.rho0, "ratio": rho / law.rho0, "rho": rho}[quantity]
    return {
        "quantity": quantity,
        "scale": scale,
        "x": _column(grid, CURVE),
        "p": _column(p, CURVE),
        "pscale": scale_of(p),
    }


def _abscissa(rho0: float, rho_n: FloatArray) -> tuple[str, dict[str, Any]]:
    """Choose the offset from rho0 if that is small or spans many decades, rho/rho0 if that does, else the density."""
    delta_n = (rho_n - rho0) / rho0
    if many_decades(delta_n) or float(np.abs(delta_n).max()) <= 1e-3:
        return "delta", scale_of(delta_n)
    if rho_n.min() > 0 and rho_n.max() > 100 * rho_n.min():
        return "ratio", {"kind": "log"}
    return "rho", {"kind": "linear"}


def _grid(values: FloatArray, scale: dict[str, Any]) -> FloatArray:
    """Return a grid over the values, shape (`GRID`,), uniform on the axis they are drawn on."""
    low, high = float(values.min()), float(values.max())
    if scale["kind"] == "log":
        return np.geomspace(low, high, GRID)
    if scale["kind"] == "linear":
        return np.linspace(low, high, GRID)
    small = 10.0 ** scale["decade"]
    ends = np.array([low, high])
    with np.errstate(divide="ignore"):
        beyond = np.sign(ends) * (1 + np.log10(np.abs(ends) / small))
    first, last = np.where(np.abs(ends) > small, beyond, ends / small)
    even = np.linspace(float(first), float(last), GRID)
    return np.asarray(np.where(np.abs(even) > 1, np.sign(even) * small * 10 ** (np.abs(even) - 1), even * small))


def _checks(checks: list[CheckRecord]) -> dict[str, Any]:
    picked = [checks[i] for i in thinned_checks(checks, CHECKS)]
    columns = {name: _packed([getattr(check, name) for check in picked]) for name in ("step", "run", "type")}
    named: dict[str, Any] = {"field": [check.field for check in picked], "total": len(checks)}
    return columns | named | {"ratio": _packed([check.max_over_bound for check in picked])}


def thinned_checks(checks: list[CheckRecord], limit: int) -> list[int]:
    """Return positions of at most ``limit`` checks of an audit: the worst, others evenly over field, type and time."""
    ratio = np.array([check.max_over_bound for check in checks], float)
    ratio[np.isnan(ratio)] = np.inf  # NaN is the worst
    group = np.unique([f"{check.field} {check.type}" for check in checks], return_inverse=True)[1]
    return [int(i) for i in thinned(ratio, np.arange(len(checks), dtype=float), group, limit)]


def _column(values: npt.ArrayLike, digits: int | None = None) -> str | float:
    """Pack a column of atoms into as few bytes as its values need, or as their first binary ``digits`` need."""
    exact = np.asarray(values, "<f8")
    if exact.size and math.isfinite(exact[0]) and bool((exact == exact[0]).all()):
        return float(exact[0])
    with np.errstate(all="ignore"):
        single = exact.astype("<f4")
        if digits is not None and _fits(exact):
            return _shortened(single, digits)
        if np.array_equal(single, exact, equal_nan=True):
            return "f:" + _planes(single)
    return _packed(exact)


def _fits(values: FloatArray) -> bool:
    """Return whether float32 holds values with all of its digits, and rounding them up does not overflow."""
    sizes = np.abs(values[np.isfinite(values) & (values != 0)])
    return bool(np.all((sizes > SINGLE.tiny) & (sizes < SINGLE.max / 2)))


def _shortened(single: npt.NDArray[np.float32], digits: int) -> str:
    """Pack float32 rounded to so many binary digits, the leading one included; NaN and infinity stay."""
    zeroed = np.uint32(SINGLE.nmant + 1 - digits)  # last digits of the 24 in float32
    bits = np.where(np.isnan(single), np.float32("nan"), single).view("<u4")
    half, kept = np.uint32(1) << (zeroed - np.uint32(1)), np.uint32(0xFFFFFFFF) << zeroed
    rounded = np.where(np.isfinite(single), (bits + half) & kept, bits & kept).astype("<u4")
    return "b:" + _planes((rounded >> np.uint32(16)).astype("<u2")) if zeroed >= 16 else "f:" + _planes(rounded)


def _packed(values: npt.ArrayLike) -> str:
    return "d:" + _planes(np.asarray(values, "<f8"))


def _planes(values: npt.NDArray[Any]) -> str:
    """Return the bytes of numbers as base64: the first of each, then the second of each, and so on."""
    one_by_one = np.ascontiguousarray(values).reshape(-1, 1).view(np.uint8)
    return base64.b64encode(one_by_one.T.tobytes()).decode("ascii")
