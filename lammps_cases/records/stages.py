"""Where the processor time of a process goes: by stage, of everything that is judged in it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

WHOLE = ("variants",)  # whatever is done within them counts as theirs
REST = "rest"


class Stages:
    """Time by stage, of a clock that measures seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._spent: dict[str, float] = {}
        self._open: list[str] = []
        self._last = self._taken = 0.0  # when a stage began or ended, and when `taken` was asked

    def _charge(self) -> None:
        """Add the time since the last change to the stage that is open, if any."""
        now = self._clock()
        if self._open:
            self._spent[self._open[-1]] = self._spent.get(self._open[-1], 0.0) + now - self._last
        self._last = now

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a block as that of a stage; a stage within it takes its time from it."""
        self._charge()
        self._open.append(self._open[-1] if self._open and self._open[-1] in WHOLE else name)
        try:
            yield
        finally:
            self._charge()
            self._open.pop()

    def taken(self) -> dict[str, float]:
        """Return the seconds of every stage since this was last asked, and the rest; begin anew."""
        self._charge()
        seconds = {**self._spent, REST: max(self._last - self._taken - sum(self._spent.values()), 0.0)}
        self._spent.clear()
        self._taken = self._last
        return {name: round(each, 4) for name, each in seconds.items()}


_of_process = Stages(time.process_time)
stage, taken = _of_process.stage, _of_process.taken
