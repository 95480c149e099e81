"""Find the first of several engines that changed, with as few runs as possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from eos_ref import InputError
from lammps_cases.engine.session import EngineMissing
from lammps_cases.records.documents import SCHEMAS
from lammps_cases.versions import pairs
from lammps_cases.versions.change import Policy, groups
from lammps_cases.versions.changes import Changes, compare
from lammps_cases.versions.outcomes import Side

SideOf = Callable[[int], Side]


@dataclass(frozen=True)
class Bisection:
    """The result of a bisection.

    Attributes
    ----------
    first : index of the first side that changed, None if the last agrees with the first
    ran : the indices that were compared, in that order
    changes : from the side before the first changed one to it; from the first to the last if they agree
    """

    first: int | None
    ran: tuple[int, ...]
    changes: Changes


def bisect(names: Sequence[str], side_of: SideOf, policy: Policy, fields: Sequence[str] = ()) -> Bisection:
    """Bisect a list of sides to the first that differs from the one before it.

    Assumes, as ``git bisect`` does, that sides before the change equal the first and those after it do not: if
    a change comes and goes, one of its appearances is found.

    Parameters
    ----------
    names : sequence of str
        Names of the sides, at least two.
    side_of : callable
        Returns the side of an index.
    policy : Policy
        What counts as a change.
    fields : sequence of str
        Compare only these; cases that end without numbers always count.

    Raises
    ------
    InputError
        A field that no case compares.
    EngineMissing
        An engine that dies on every case.
    """
    sides: dict[int, Side] = {}

    def side(at: int) -> Side:
        if at not in sides:
            sides[at] = side_of(at)
            if not sides[at].answered:
                raise EngineMissing(f"{names[at]} failed on every case")
            for field in fields:
                if not any(field in case.fields for case in sides[at].cases.values()):
                    raise InputError("field", "is compared by none of the cases", field, names[at])
        return sides[at]

    def changes(one: int, other: int) -> Changes:
        return only(compare(side(one), side(other), policy), fields)

    low, high = 0, len(names) - 1
    between = changes(low, high)
    if not between.faults:
        return Bisection(None, tuple(sides), between)
    while high - low > 1:
        middle = (low + high) // 2
        if changes(0, middle).faults:
            high = middle
        else:
            low = middle
    return Bisection(high, tuple(sides), changes(low, high))


def only(changes: Changes, fields: Sequence[str]) -> Changes:
    """Return the changes of some fields, and of cases as a whole."""
    if not fields:
        return changes
    kept = tuple(change for change in changes.fields if not change.field or change.field in fields)
    return Changes(changes.a, changes.b, kept, changes.notes)


def document(bisection: Bisection, names: Sequence[str], command: str = "") -> dict[str, Any]:
    """Return the content of bisect.json."""
    return {
        "schema": SCHEMAS["bisect"],
        "command": command,
        "engines": list(names),
        "ran": [names[at] for at in bisection.ran],
        "first_changed": None if bisection.first is None else names[bisection.first],
        "last_unchanged": names[-1] if bisection.first is None else names[bisection.first - 1],
        "counts": bisection.changes.counts,
        "groups": [group.sentence(*side_names(bisection, names)) for group in groups(bisection.changes.fields)],
        "fields": [pairs.row(change, *side_names(bisection, names)) for change in bisection.changes.faults],
    }


def side_names(bisection: Bisection, names: Sequence[str]) -> tuple[str, str]:
    """Return the two sides whose changes are shown."""
    return (names[0], names[-1]) if bisection.first is None else (names[bisection.first - 1], names[bisection.first])
