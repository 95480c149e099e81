"""A journal: a file that grows by a line of JSON at a time, so that a kill costs the entry being written at most."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import TypeAdapter, ValidationError

T = TypeVar("T")


@dataclass(frozen=True)
class Journal(Generic[T]):
    """Entries of one class in the order in which they came."""

    file: Path
    model: type[T]

    @cached_property
    def _adapter(self) -> TypeAdapter[T]:
        return TypeAdapter(self.model)

    def append(self, entry: T) -> None:
        """Add an entry, in one piece: programs that write at the same time do not mix their lines."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.file, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            size = os.fstat(handle).st_size
            cut = size > 0 and os.pread(handle, 1, size - 1) != b"\n"  # a kill in the middle of a line
            os.write(handle, b"\n" * cut + self._adapter.dump_json(entry) + b"\n")
        finally:
            os.close(handle)

    def lines(self) -> Iterator[T | None]:
        """Yield the entry of every line; None for a line that is none.

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
        """Return the entries, without lines that a kill cut short; none where there is no file."""
        return [entry for entry in self.lines() if entry is not None] if self.file.exists() else []

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Have an interruption of the block say that the entries stay, and how to go on."""
        try:
            yield
        except KeyboardInterrupt:
            if not self.file.exists():
                raise
            how = "the same command, without --fresh, resumes"
            raise KeyboardInterrupt(f"interrupted: what is done is in {self.file}; {how}") from None

    def forget(self) -> None:
        """Take all entries away."""
        self.file.unlink(missing_ok=True)
