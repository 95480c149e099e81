"""Types that tests share."""

from __future__ import annotations

from typing import NamedTuple


class Outcome(NamedTuple):
    """What a command left: exit code and the two streams."""

    code: int
    out: str
    err: str
