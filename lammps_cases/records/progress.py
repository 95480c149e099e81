"""Progress of a long task, as a command shows it, and the processor time of a process by stage."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:  # imported where a terminal shows a bar
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

PLAIN_EVERY = 5.0  # seconds between two plain lines
WHOLE = ("variants",)  # stages: all that is done within them counts for them
REST = "rest"


class Progress:
    """Receiver of the reports of a long task; this one shows nothing."""

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        """Report the progress of a task.

        Parameters
        ----------
        done, total : int
            Parts done, and their total number (None: unknown).
        label : str
            The part that is finished, or that comes next.
        complaint : str, optional
            What went wrong in this part.
        """


SILENT = Progress()


def duration(seconds: float) -> str:
    """Return a duration in one unit: s below two minutes, min below two hours, h."""
    unit, size = next(((unit, size) for unit, size in (("s", 1), ("min", 60)) if seconds < 120 * size), ("h", 3600))
    return f"{max(1, round(seconds / size))} {unit}"


class Bar(Progress):
    """Progress on standard error: a bar on a terminal, occasional plain lines elsewhere; a context manager.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    prefix : str
        Precedes every label.
    complaints : bool
        Show complaints too; they stay on a terminal, above the bar.
    """

    def __init__(self, quiet: bool = False, prefix: str = "", complaints: bool = False) -> None:
        self._bar: RichProgress | None = None
        self._task: TaskID | None = None
        self._quiet, self._prefix, self._complaints = quiet, prefix, complaints
        self._printed = time.monotonic()
        self._first = (0, self._printed)  # parts done, and when, at the first report of this total
        self._total: int | None = None
        if not quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as RichProgress

            columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
            self._bar = RichProgress(*columns, console=Console(stderr=True), transient=True)

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        """Move the bar, or print a line."""
        complaint = complaint if self._complaints else ""
        label = f"{self._left(done, total)}{self._prefix}{label}"
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, total=total, description=label)
            if complaint:
                self._bar.console.print(complaint, style="red", highlight=False, markup=False)
        elif not self._quiet and (complaint or time.monotonic() - self._printed > PLAIN_EVERY):
            self._printed = time.monotonic()
            print(complaint or f"{done}/{total or '?'} {label}", file=sys.stderr, flush=True)

    def _left(self, done: int, total: int | None) -> str:
        """Estimate the time left from the parts done since the first report; parts found in a folder cost none."""
        now, (first, begin) = time.monotonic(), self._first
        if total != self._total or done < first:
            self._first, self._total = (done, now), total
        elif total is not None and first < done < total:
            return f"about {duration((now - begin) * (total - done) / (done - first))} left: "
        return ""

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._task = self._bar.add_task("starting LAMMPS", total=None)
            self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._bar is not None:
            self._bar.stop()


class Stages:
    """Time by stage, of a clock that measures seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._spent: dict[str, float] = {}
        self._open: list[str] = []
        self._last = self._taken = 0.0  # when a stage began or ended, and when `taken` was called

    def _charge(self) -> None:
        """Add the time since the last change to the stage that is open, if any."""
        now = self._clock()
        if self._open:
            self._spent[self._open[-1]] = self._spent.get(self._open[-1], 0.0) + now - self._last
        self._last = now

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a block for a stage; a nested stage's time is subtracted."""
        self._charge()
        self._open.append(self._open[-1] if self._open and self._open[-1] in WHOLE else name)
        try:
            yield
        finally:
            self._charge()
            self._open.pop()

    def taken(self) -> dict[str, float]:
        """Return the seconds of every stage since the last call, and the rest."""
        self._charge()
        seconds = {**self._spent, REST: max(self._last - self._taken - sum(self._spent.values()), 0.0)}
        self._spent.clear()
        self._taken = self._last
        return {name: round(each, 4) for name, each in seconds.items()}


_of_process = Stages(time.process_time)
stage, taken = _of_process.stage, _of_process.taken
