"""Named mistakes in the formulas, which the mistaken reference makes when it stands in for LAMMPS.

Those that the lint knows (`lammps_cases.verdict.law_mistakes`, `lammps_cases.verdict.model_mistakes`), and changes of
the reference's source written down in ``formula.yaml``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.records.yaml_files import read_yaml
from tests.workshop.faults.edits import edited, split_name, text_of
from tests.workshop.faults.fault import Fault, Kind, by_id
from tests.workshop.faults.source import SourceFault
from lammps_cases.verdict import law_mistakes, model_mistakes

EDITS = Path(__file__).with_name("formula.yaml")


class Edit(BaseModel):
    """A mistake as ``formula.yaml`` holds it."""

    model_config = ConfigDict(extra="forbid")

    id: str
    kind: Kind
    what: str
    function: str
    replace: str
    by: str
    at: int | None = Field(None, ge=1)


@dataclass(frozen=True)
class LintFault(Fault):
    """A mistake that the lint knows, by its name there: in a law, or in a stage of the model."""

    table: Literal["law", "stage"]
    name: str


# What the lint's mistakes are; any other is a missing term.
_KINDS: dict[str, Kind] = {
    "cs instead of cs^2": "exponent",
    "rho0 and cs exchanged": "exchanged",
    "cs off by 1e-6": "constant",
    "sign of the pressure": "sign",
    "background subtracted": "sign",
    "A3 of the wrong sign": "sign",
    "exponent 7 for every Tait law": "exponent",
    "exponent off by one": "exponent",
    "linear instead of Tait or cubic": "option",
    "gamma instead of gamma - 1": "constant",
    "energy not per unit mass": "volume or mass",
    "types exchanged": "exchanged",
    "density in float32": "single precision",
    "pressure in float32": "single precision",
    "masses ignored": "volume or mass",
    "rho0 for rho in volumes": "volume or mass",
    "V_i for V_j": "volume or mass",
    "no volume in the force": "volume or mass",
    "temperature of the whole energy": "volume or mass",
    "one conductivity for all types": "exchanged",
}


@cache
def faults() -> dict[str, SourceFault | LintFault]:
    """Return all faults of this family by their id, in order."""
    planted: list[SourceFault | LintFault] = []
    for table, names in (("law", law_mistakes.MUTANTS), ("stage", model_mistakes.MUTANTS)):
        for name in names:
            fault = f"formula.lint-{_slug(name)}"
            planted.append(LintFault(fault, _KINDS.get(name, "missing term"), f"{name} (lint)", table, name))  # type: ignore[arg-type]
    for fault, edit in edits().items():
        module, name = split_name(edit.function)
        text = edited(text_of(module), name, edit.replace, edit.by, edit.at, f"{EDITS.name}, {edit.id}")
        planted.append(SourceFault(fault, edit.kind, edit.what, module, text))
    return by_id(planted)


@cache
def edits() -> dict[str, Edit]:
    """Return the changes of the reference's source by the ids of their faults, in order."""
    every = TypeAdapter(list[Edit]).validate_python(read_yaml(EDITS, "faults"))
    named = {f"formula.{edit.id}": edit for edit in every}
    assert len(named) == len(every), "two faults of one id"
    return named


def stages(fault: Fault) -> type[ArrayEvaluator] | None:
    """Return the stages that make a mistake of the lint's."""
    in_lint = isinstance(fault, LintFault) and fault.table == "stage"
    return model_mistakes.MUTANTS[fault.name].stages if in_lint else None  # type: ignore[attr-defined]


def _slug(name: str) -> str:
    return "-".join(re.findall(r"[^\W_]+", name.lower()))
