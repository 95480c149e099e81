"""Several things that wait for workers, advanced at the same time."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, TypeVar

from lammps_cases.engine.workers import Workers

T = TypeVar("T")
Asking = Generator[Future[Any], Any, T]  # waits for one future at a time, and gets its outcome


def together(workers: Workers, asking: Iterable[Asking[T]], most: int) -> Iterator[T]:
    """Advance generators, at most so many at a time; yield their results as they come."""
    ahead = iter(asking)
    waiting: dict[Future[Any], Asking[T]] = {}
    ready: list[tuple[Asking[T], Any]] = []
    while True:
        while len(waiting) + len(ready) < most and (one := next(ahead, None)) is not None:
            ready.append((one, None))
        if not ready and not waiting:
            return
        for one, outcome in ready:
            try:
                waiting[one.send(outcome)] = one
            except StopIteration as end:
                yield end.value
        done = wait(waiting, return_when=FIRST_COMPLETED).done
        ready = [(waiting.pop(future), workers.outcome(future)) for future in done]
