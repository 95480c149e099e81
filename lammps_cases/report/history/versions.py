"""Engines in the order of their versions, and what they are called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from packaging.version import InvalidVersion, Version

from lammps_cases.records.run_record import HASH
from lammps_cases.report.history.model import StoredRun


@dataclass(frozen=True)
class EngineRuns:
    """An engine and its runs, by date; ``label`` distinguishes it from all others."""

    key: str
    label: str
    runs: tuple[StoredRun, ...]


def natural(version: str) -> tuple[bool, Version | list[tuple[int, str]]]:
    """Return the key by which versions sort: 1.2 < 1.10rc1 < 1.10 < 1.10.post1; labels that are none come first.

    Numbers within such labels sort as people count, between words in the order of the alphabet.
    """
    try:
        return True, Version(version)
    except InvalidVersion:
        parts = re.findall(r"\d+|[a-z]+", version.lower())
        return False, [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def engines(runs: Sequence[StoredRun]) -> list[EngineRuns]:
    """Sort runs by engine: releases by version, then what was built here by the date of its first run."""
    of: dict[str, list[StoredRun]] = {}
    for run in sorted(runs, key=lambda run: (run.date, run.id)):
        of.setdefault(run.engine.key, []).append(run)
    groups = sorted(of.values(), key=_place)
    labels = [_release(group) or group[-1].engine.label for group in groups]
    lines = []
    for label, group in zip(labels, groups, strict=True):
        engine = group[0].engine
        hash_digits = f" {engine.library_sha256[:HASH]}"
        unique = labels.count(label) == 1 or label.endswith(hash_digits)
        lines.append(EngineRuns(engine.key, label if unique else label + hash_digits, tuple(group)))
    return lines


def _release(group: Sequence[StoredRun]) -> str:
    """Return the release that a library is of, under whatever name it was run; empty for a build of one's own."""
    return next((run.engine.release for run in group if run.engine.release), "")


def _place(group: Sequence[StoredRun]) -> tuple[object, ...]:
    release = _release(group)
    return (0, natural(release), group[0].date) if release else (1, group[0].date, group[0].engine.key)
