"""The data that the page draws a case from, made of its per-atom arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import excess, worst_component
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.report import plots
from lammps_cases.verdict.case_arrays import SIDES, read


@dataclass(frozen=True)
class WorstAtom:
    """Exact numbers of the worst atom of a field."""

    field: str
    values: dict[str, str]


@dataclass(frozen=True)
class Drawn:
    """The data that the page draws a case from, as JSON; the fields in it; exact numbers of worst atoms.

    ``more``: the other steps of fields but that in which a difference enters, whose steps are in the data.
    """

    data: Markup | None = None
    more: Markup | None = None
    fields: tuple[str, ...] = ()
    worst: tuple[WorstAtom, ...] = ()


def drawn(case: CaseRecord, arrays: plots.Arrays, beside: plots.Arrays = MappingProxyType({})) -> Drawn:
    """Return the data drawn from the arrays of a case, which may be empty, and from its file ``CASE@page.npz``."""
    # A case without fields was not compared in this run: a file of its name is left over from an earlier one.
    at_hand = bool(case.fields) and "id" in arrays and bool(arrays["id"].size)
    reduced = one_per_atom({name: np.asarray(arrays[name]) for name in sorted(arrays)}) if at_hand else None
    differences = {} if reduced is None else plots.differences(reduced)
    data, more = plots.payload(case, reduced, differences, beside)
    fields = tuple((data or {}).get("fields", ()))
    # Of the model only the field in which a difference enters: it has a dozen.
    stepped = any(record.steps for record in case.fields)
    if stepped:
        exact_numbers = [name for name in fields if name == (data or {})["first"]]
    else:
        exact_numbers = [name for name, (difference_n, _) in differences.items() if difference_n.any()]
    return Drawn(
        None if data is None else embedded(data),
        embedded(more) if more else None,
        fields,
        tuple(_worst(case, reduced, name, *differences[name]) for name in exact_numbers) if reduced else (),
    )


def drawn_from(case: CaseRecord, fields: Path, every_step: bool = True) -> Drawn:
    """Return what is shown of the arrays of a case in the folder ``fields``, at the worst step of a field or at all."""
    own, beside = read(fields, case.case) if case.fields else ({}, {})
    shown = beside if every_step else {name: values for name, values in beside.items() if name.startswith("@pairs ")}
    return drawn(case, own, shown)


def one_per_atom(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Reduce compared vectors and tensors, shape (n, ...), to their component closest to its bound, shape (n,)."""
    reduced = dict(arrays)
    for name in arrays:
        field, _, side = name.rpartition(".")
        sides = [f"{field}.{of}" for of in SIDES]
        if side != "lammps" or arrays[name].ndim == 1 or not all(of in arrays for of in sides):
            continue
        lammps_n, reference_n, bound_n = (np.asarray(arrays[of], float) for of in sides)
        ratio_n = excess(lammps_n, reference_n, bound_n)[1]
        for of, values_n in zip(sides, (lammps_n, reference_n, bound_n), strict=True):
            reduced[of] = worst_component(values_n, ratio_n)
    return reduced


def embedded(data: Any) -> Markup:
    """Return JSON that cannot end the script element it stands in, nor open a comment there."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _worst(
    case: CaseRecord, arrays: plots.Arrays, field: str, difference_n: FloatArray, ratio_n: FloatArray
) -> WorstAtom:
    at = int(np.argmax(ratio_n))
    names = ("id", "type", "rho", "e", f"{field}.lammps", f"{field}.reference", f"{field}.bound")
    values = {name.removeprefix(f"{field}."): repr(arrays[name][at].item()) for name in names if name in arrays}
    values |= {"difference": repr(difference_n[at].item()), "difference/bound": repr(ratio_n[at].item())}
    delta_n = plots.offsets(case, arrays["type"][at : at + 1], np.asarray(arrays["rho"][at : at + 1], float))
    values |= {"(rho - rho0)/rho0": repr(delta_n[0].item())}
    values["position"] = ", ".join(repr(float(c)) for c in arrays["x"][at])
    return WorstAtom(field, values)
