"""Types that tests share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from lammps_cases.engine.session import Answer, Job

Solver = Callable[[Job], Answer]


class Outcome(NamedTuple):
    """The result of a command: exit code and the two streams."""

    code: int
    out: str
    err: str
