"""The catalogue of changes: ways in which the reference, or LAMMPS, could be wrong, as data (``changes.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

from pydantic import ConfigDict, TypeAdapter

from lammps_cases.records.files import DATA
from lammps_cases.records.yaml_files import read_yaml

Kind = Literal[
    "constant",
    "sign",
    "exponent",
    "units",
    "missing term",
    "exchanged",
    "type range",
    "option",
    "volume or mass",
    "stale",
    "neighbours",
    "order of operations",
    "single precision",
    "unset",
    "last digits",
]


@dataclass(frozen=True)
class Change:
    """One way in which the reference could be wrong; `lammps_cases.comparison.changed` applies it.

    Attributes
    ----------
    what : the change, in words
    mistake : a law or a stage of `lammps_cases.verdict.mistakes`, named by ``what``; otherwise
        an edit of the source:
    function : the function or method, ``eos_ref.MODULE:NAME``
    replace, by : the expression or the statements in it, and those in their place
    at : the number of the match, from 1; None: there is exactly one
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    id: str
    kind: Kind
    what: str
    mistake: Literal["law", "stage", ""] = ""
    function: str = ""
    replace: str = ""
    by: str = ""
    at: int | None = None


@cache
def catalogue() -> dict[str, Change]:
    """Return all changes by their ids, in order."""
    every = TypeAdapter(list[Change]).validate_python(read_yaml(DATA / "changes.yaml", "changes"))
    named = {change.id: change for change in every}
    assert len(named) == len(every), "two changes of one id"
    return named
