"""A progress bar that records its calls."""

from __future__ import annotations

from lammps_cases.records.progress import Progress


class Steps(Progress):
    """Every call, in order."""

    def __init__(self) -> None:
        self.done: list[tuple[int, int | None, str]] = []

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        self.done.append((done, total, label))
