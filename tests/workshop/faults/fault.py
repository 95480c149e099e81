"""Planted faults."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar, get_args

from lammps_cases.scene.changes import Kind

SECTIONS = ("faults", "resolution", "alarms")  # of a measurement
Family = Literal["told", "read", "formula"]
FAMILIES: tuple[Family, ...] = get_args(Family)
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Fault:
    """A planted fault.

    Attributes
    ----------
    id : family and name, as in `told.cs-doubled`
    what : the change, in words
    """

    id: str
    kind: Kind
    what: str

    @property
    def family(self) -> Family:
        """Return the way in which it is planted: the first part of the id."""
        return next(family for family in FAMILIES if self.id.startswith(f"{family}."))


F = TypeVar("F", bound=Fault)


def by_id(faults: Iterable[F]) -> dict[str, F]:
    """Return faults by their id, in order; no two of them have the same."""
    every = list(faults)
    named = {fault.id: fault for fault in every}
    assert len(named) == len(every), "two faults of one id"
    return named


@dataclass(frozen=True)
class Detection:
    """A case that detects a fault: its verdict (as expected without the fault), and the field that shows it.

    Attributes
    ----------
    field : first field outside its bound; empty if LAMMPS gave no numbers
    manual : whether the mistaken reference stood in for a LAMMPS without the engine's findings, which hide the fault
    """

    case: str
    verdict: str
    field: str
    message: str
    manual: bool = False


def files(detections: Sequence[Detection]) -> set[str]:
    """Return the case files whose cases detect a fault: cases of one file count as one scene."""
    return {detection.case.partition(".")[0] for detection in detections}
