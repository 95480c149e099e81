"""Engines in the order of their versions, and what they are called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from packaging.version import InvalidVersion, Version

from lammps_cases.history.model import StoredRun

_HASH = 8  # digits shown of a library's hash


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
    names = [_name(group) for group in groups]
    lines = []
    for name, group in zip(names, groups, strict=True):
        engine = group[0].engine
        hash_digits = f" {engine.library_sha256[:_HASH]}"
        unique = names.count(name) == 1 or name.endswith(hash_digits)
        lines.append(EngineRuns(engine.key, name if unique else name + hash_digits, tuple(group)))
    return lines


def _release(group: Sequence[StoredRun]) -> str:
    """Return the version of a distribution; empty for a build of one's own."""
    return next((run.engine.distribution for run in group if not run.engine.name.startswith("path:")), "")


def _place(group: Sequence[StoredRun]) -> tuple[object, ...]:
    release = _release(group)
    return (0, natural(release), group[0].date) if release else (1, group[0].date, group[0].engine.key)


def _name(group: Sequence[StoredRun]) -> str:
    engine = group[-1].engine
    if release := _release(group):
        return release
    if engine.name.startswith("path:"):
        return f"{Path(engine.name.removeprefix('path:')).name or engine.name} {engine.library_sha256[:_HASH]}".rstrip()
    return " ".join(part for part in (engine.name, engine.version_string) if part)
