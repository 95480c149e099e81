"""Faults of the harness after cases are judged: each costs a part of the report, which reports the loss in a line."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from pydantic import Field

from lammps_cases.records.documents import Record

T = TypeVar("T")
U = TypeVar("U")
LONGEST = 300  # characters of an exception's text
ROOT = Path(__file__).parents[2]


class MissingPart(Record):
    """A part that is missing in a report, and why."""

    part: str
    cases: list[str] = Field([], description="whose part it is; empty: of the run")
    exception: str
    text: str
    trace: list[str] = Field([], description="lines of eos-ref that were being executed, the one that failed last")


def part(name: str, faults: list[MissingPart], make: Callable[[], T], otherwise: U, cases: Sequence[str] = ()) -> T | U:
    """Return what ``make`` returns; if it fails, note that as the fault of this part and return ``otherwise``.

    The fault of an earlier attempt at the part, which is made in one place only, is dropped.
    """
    faults[:] = [fault for fault in faults if (fault.part, fault.cases) != (name, [*cases])]
    try:
        return make()
    except Exception as error:
        text = " ".join(str(error).split())[:LONGEST]
        said = {"exception": type(error).__name__, "text": text, "trace": _trace(error)}
        faults.append(MissingPart(part=name, cases=[*cases], **said))
        return otherwise


def _trace(error: Exception) -> list[str]:
    """Return the lines of this project in a traceback, as diagnosis/laws.py:62."""
    frames = [(Path(frame.filename), frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    ours = [(path.relative_to(ROOT).parts, line) for path, line in frames if path.is_relative_to(ROOT)]
    return [f"{'/'.join(parts[1:])}:{line}" for parts, line in ours if parts[0] in ("eos_ref", "lammps_cases")]
