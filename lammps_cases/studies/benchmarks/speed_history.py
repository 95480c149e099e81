"""Measurements kept, one line of JSON each, and two of them compared."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from eos_ref.errors import InputError
from lammps_cases.studies.benchmarks.bench import Ratio
from lammps_cases.studies.benchmarks.measure import Answer, Interval, machine, verdict


@dataclass(frozen=True)
class Entry:
    """One run of the benchmarks."""

    time: str
    machine: dict[str, str | float | int]
    label: str
    ratios: tuple[Ratio, ...]


@dataclass(frozen=True)
class Change:
    """What became of one ratio from one entry to another: the factor by which it grew, and what that says."""

    scene: str
    peer: str
    before: Interval
    after: Interval
    factor: Interval
    answer: Answer


_ADAPTER = TypeAdapter(Entry)


def append(path: Path, label: str, ratios: Sequence[Ratio]) -> Entry:
    """Add an entry to a history; a line is written in one piece, so that a kill leaves whole lines."""
    path.parent.mkdir(parents=True, exist_ok=True)
    entry = Entry(datetime.now(UTC).isoformat(timespec="seconds"), machine(), label, tuple(ratios))
    line = json.dumps(asdict(entry), separators=(",", ":")) + "\n"
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        os.write(descriptor, line.encode())
    finally:
        os.close(descriptor)
    return entry


def read(path: Path) -> list[Entry]:
    """All entries of a history.

    Raises
    ------
    InputError
        No such file, or a line that is no entry.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError("history", f"cannot be read: {error.strerror}", where=str(path)) from None
    entries = []
    for k, line in enumerate(lines, 1):
        try:
            entries.append(_ADAPTER.validate_json(line))
        except ValidationError:
            raise InputError("history", "is not a measurement of eos-ref bench", where=f"{path}, line {k}") from None
    return entries


def pick(entries: Sequence[Entry], which: str, path: Path) -> Entry:
    """An entry by its number, 1 the first and -1 the last, or by its label (the last of that name).

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


def changes(before: Entry, after: Entry) -> list[Change]:
    """Ratios to the same peer that both entries have.

    Every entry measured its peer in the same run, so that another machine changes both sides. The interval of the
    factor takes the worst of both intervals; one that holds 1 says nothing.
    """
    old = {(ratio.scene, ratio.peer): ratio.ratio for ratio in before.ratios}
    return list(_changes(old, after.ratios))


def _changes(old: dict[tuple[str, str], Interval], ratios: Iterable[Ratio]) -> Iterable[Change]:
    for ratio in ratios:
        was, now = old.get((ratio.scene, ratio.peer)), ratio.ratio
        if was is not None:
            factor = Interval(now.median / was.median, now.low / was.high, now.high / was.low)
            yield Change(ratio.scene, ratio.peer, was, now, factor, verdict(factor))
