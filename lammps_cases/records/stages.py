"""Where the processor time of a process goes: by stage, of everything that is judged in it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

WHOLE = ("variants",)  # whatever is done within them counts as theirs
REST = "rest"

_spent: dict[str, float] = {}
_open: list[str] = []
_last = {"time": 0.0, "taken": 0.0}


def _charge() -> None:
    """Add the time since the last change to the stage that is open, if any."""
    now = time.process_time()
    if _open:
        _spent[_open[-1]] = _spent.get(_open[-1], 0.0) + now - _last["time"]
    _last["time"] = now


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Count the time of a block as that of a stage; a stage within it takes its time from it."""
    _charge()
    _open.append(_open[-1] if _open and _open[-1] in WHOLE else name)
    try:
        yield
    finally:
        _charge()
        _open.pop()


def taken() -> dict[str, float]:
    """Return the seconds of every stage since this was last asked, and the rest of this process' time; begin anew."""
    _charge()
    now = _last["time"]
    found = {**_spent, REST: max(now - _last["taken"] - sum(_spent.values()), 0.0)}
    _spent.clear()
    _last["taken"] = now
    return {name: round(seconds, 4) for name, seconds in found.items()}
