"""Kept measurements, one line of JSON each, and the comparison of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.records.journal import Journal
from lammps_cases.records.measure import Answer, ConfidenceInterval, machine, verdict
from lammps_cases.studies.chart.bench import Ratio


@dataclass(frozen=True)
class SpeedEntry:
    """One run of the benchmarks."""

    time: str
    machine: dict[str, str | float | int]
    label: str
    ratios: tuple[Ratio, ...]


@dataclass(frozen=True)
class SpeedChange:
    """Change of one ratio from one entry to another: the factor of growth, and the resulting answer."""

    scene: str
    peer: str
    before: ConfidenceInterval
    after: ConfidenceInterval
    factor: ConfidenceInterval
    answer: Answer


def append(path: Path, label: str, ratios: Sequence[Ratio]) -> SpeedEntry:
    """Add an entry to a history."""
    entry = SpeedEntry(datetime.now(UTC).isoformat(timespec="seconds"), machine(), label, tuple(ratios))
    Journal(path, SpeedEntry).append(entry)
    return entry


def read(path: Path) -> list[SpeedEntry]:
    """Return all entries of a history.

    Raises
    ------
    InputError
        No such file, or a line that is not an entry.
    """
    entries = []
    try:
        for number, entry in enumerate(Journal(path, SpeedEntry).lines(), 1):
            if entry is None:
                raise InputError("history", "is not a measurement of eos-ref bench", where=f"{path}, line {number}")
            entries.append(entry)
    except OSError as error:
        raise InputError("history", f"cannot be read: {error.strerror}", where=str(path)) from None
    return entries


def pick(entries: Sequence[SpeedEntry], which: str, path: Path) -> SpeedEntry:
    """Return an entry by its number, 1 the first and -1 the last, or by its label (the last of that name).

    Raises
    ------
    InputError
    """
    labelled = [entry for entry in entries if entry.label == which]
    if labelled:
        return labelled[-1]
    try:
        number = int(which)
        return entries[number - 1 if number > 0 else number]
    except (ValueError, IndexError):
        rule = f"must be a label, or a number from 1 to {len(entries)} (-1: the last)"
        raise InputError("measurement", rule, which, str(path)) from None


def changes(before: SpeedEntry, after: SpeedEntry) -> list[SpeedChange]:
    """Return the changes of the ratios that both entries have.

    Every entry measured its peer in the same run, so that another machine changes both sides. The interval of the
    factor combines the extremes of both intervals; one that holds 1 is inconclusive.
    """
    old = {(ratio.scene, ratio.peer): ratio.ratio for ratio in before.ratios}
    rows = []
    for ratio in after.ratios:
        if was := old.get((ratio.scene, ratio.peer)):
            now = ratio.ratio
            factor = ConfidenceInterval(now.median / was.median, now.low / was.high, now.high / was.low)
            rows.append(SpeedChange(ratio.scene, ratio.peer, was, now, factor, verdict(factor)))
    return rows
