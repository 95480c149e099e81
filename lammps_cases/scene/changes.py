"""The catalogue of changes: ways in which the reference, or LAMMPS, could be wrong, as data (``changes.yaml``)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

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
    """One way in which the reference, or LAMMPS, could be wrong; `lammps_cases.comparison.changed` applies it.

    Attributes
    ----------
    what : the change, in words
    role : planted by `make power`; a mistake that the report looks for in every scene; or only a hypothesis about a red
        case. Other hypotheses are made as needed, see `lammps_cases.verdict.diagnosis`. A case may name any in
        ``exercises``.
    function : the function or method whose source it edits, ``MODULE:NAME``
    replace, by : the expression or the statements in it, and those in their place
    at : the number of the match, from 1; 0: all of them; None: there is exactly one
    laws : of a mistake in a law: an expression of a ``law`` of the ``table`` that it changes; empty: of every one
    shows, walls : of a mistake in the particle model: the quantities that it changes, and whether only near walls
    table : makes the equations of state of a scene others
    stages, stepping : class to put before the evaluator's or the simulation's
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    id: str
    what: str
    kind: Kind = "option"
    role: Literal["planted", "mistake", "hypothesis"] = "planted"
    function: str = ""
    replace: str = ""
    by: str = ""
    at: int | None = None
    laws: str = ""
    shows: tuple[str, ...] = ()
    walls: bool = False
    table: Callable[[Any], Any] | None = None
    stages: type[Any] | None = None
    stepping: type[Any] | None = None

    @property
    def sentence(self) -> str:
        """Return what completes "LAMMPS computes as if ..."."""
        return self.what if self.role == "hypothesis" else f"the reference made the mistake: {self.what}"


def hypothesis(what: str, **parts: Any) -> Change:
    """Return a change that is made as needed, in words that complete "LAMMPS computes as if ..."."""
    return Change(what, what, role="hypothesis", **parts)


@cache
def catalogue() -> dict[str, Change]:
    """Return all changes by their ids, in order."""
    every = TypeAdapter(list[Change]).validate_python(read_yaml(DATA / "changes.yaml", "changes"))
    named = {change.id: change for change in every}
    assert len(named) == len(every), "two changes of one id"
    return named
