"""Known engines, and on which of them each finding was seen, as written by ``eos-ref adopt``.

The list decides no verdict. It says which findings are new on an engine, so that a run fails, and which have gone.
"""

from __future__ import annotations

import json
from pathlib import Path

from packaging.version import InvalidVersion, Version

FILE = Path(__file__).with_name("engines.json")
_CONTENT = json.loads(FILE.read_text(encoding="utf-8"))
KNOWN: tuple[str, ...] = tuple(_CONTENT["engines"])  # versions, oldest first
SEEN_ON: dict[str, tuple[str, ...]] = {name: tuple(engines) for name, engines in _CONTENT["seen_on"].items()}
NEWEST = KNOWN[-1]


def nearest(version: str) -> str:
    """Return the known engine equal to a version, or else the last one before it, or else the first of all.

    An invalid version counts as the newest.
    """
    try:
        before = [one for one in KNOWN if Version(one) <= Version(version)]
    except InvalidVersion:
        return NEWEST
    return before[-1] if before else KNOWN[0]


def since(engines: tuple[str, ...]) -> str:
    """Return the first of some known engines, marked if no earlier one was tried; empty for no engines."""
    first = next((one for one in KNOWN if one in engines), "")
    return f"{first} or before" if first == KNOWN[0] else first


def document(engines: tuple[str, ...], seen_on: dict[str, tuple[str, ...]]) -> str:
    """Return the text of the file, a line for each finding."""
    order = sorted(engines, key=Version)
    lines = [
        f"  {json.dumps(name)}: {json.dumps([engine for engine in order if engine in engines_of])}"
        for name, engines_of in seen_on.items()
    ]
    body = ",\n".join(lines)
    return f'{{\n "engines": {json.dumps(order)},\n "seen_on": {{\n{body}\n }}\n}}\n'
