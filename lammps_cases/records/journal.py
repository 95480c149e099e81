"""A journal: a file to which lines of JSON are appended, so that a kill costs at most the entry being written."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Generic, TypeVar, cast

from pydantic import ConfigDict, TypeAdapter, ValidationError

T = TypeVar("T")


@dataclass(frozen=True)
class Journal(Generic[T]):
    """Entries of one class, in the order of arrival."""

    file: Path
    model: type[T]

    @cached_property
    def _adapter(self) -> TypeAdapter[T]:
        return TypeAdapter(self.model)

    def append(self, entry: T) -> None:
        """Append an entry in one write, so that concurrent programs do not mix their lines."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.file, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            size = os.fstat(handle).st_size
            cut = size > 0 and os.pread(handle, 1, size - 1) != b"\n"  # a kill in the middle of a line
            os.write(handle, b"\n" * cut + self._adapter.dump_json(entry) + b"\n")
        finally:
            os.close(handle)

    def lines(self) -> Iterator[T | None]:
        """Yield the entry of every line; None for a damaged line.

        Raises
        ------
        OSError
            The file cannot be read.
        """
        for line in self.file.read_bytes().splitlines():
            try:
                yield self._adapter.validate_json(line)
            except ValidationError:
                yield None

    def entries(self) -> list[T]:
        """Return the entries, without lines that a kill cut short; none without a file."""
        return [entry for entry in self.lines() if entry is not None] if self.file.exists() else []


@dataclass(frozen=True)
class DonePart(Generic[T]):
    """A finished part of a study: the key of all it depends on, the result, the seconds since the part before."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="strings")

    key: str
    result: T
    seconds: float


class Parts(Generic[T]):
    """The journal of a study, from which an interrupted one is resumed; several threads may use it.

    Parameters
    ----------
    file : Path
    model : type
        Class of a result.
    """

    def __init__(self, file: Path, model: type[T]) -> None:
        self.file, self.journal = file, Journal(file, cast("type[DonePart[T]]", DonePart[model]))  # type: ignore[valid-type]
        self._lock = threading.Lock()
        self._taken: dict[str, float] = {}
        self._last = time.perf_counter()

    @cached_property
    def _done(self) -> dict[str, DonePart[T]]:
        return {part.key: part for part in self.journal.entries()}  # of several with one key the last counts

    def get(self, key: str) -> T | None:
        """Return the result of a finished part, None for others."""
        with self._lock:
            part = self._done.get(key)
            if part is None:
                return None
            self._taken.setdefault(key, part.seconds)
            return part.result

    def add(self, key: str, result: T) -> T:
        """Keep the result of a part that has just been finished, and return it."""
        with self._lock:
            now = time.perf_counter()
            part = self._done[key] = DonePart(key, result, now - self._last)
            self._taken[key], self._last = 0.0, now
            self.journal.append(part)
        return result

    @property
    def earlier(self) -> float:
        """Seconds that earlier calls of the command spent on the parts that were reused."""
        return sum(self._taken.values())

    @contextmanager
    def resumed(self, resume: bool) -> Iterator[None]:
        """Discard the parts unless the study is resumed; if the block is interrupted, report that they are kept."""
        if not resume:
            self.file.unlink(missing_ok=True)
        try:
            yield
        except KeyboardInterrupt:
            if not self.file.exists():
                raise
            how = "the same command, without --fresh, resumes"
            raise KeyboardInterrupt(f"interrupted: what is done is in {self.file}; {how}") from None
