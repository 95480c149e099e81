"""Versions of LAMMPS' manual: the pages of a later one may document another equation.

Each is named after the LAMMPS that it describes, in the form of a wheel's version.
"""

from __future__ import annotations

import re
from typing import Literal, get_args

Manual = Literal["2025.7.22", "2026.7.4"]
MANUALS: tuple[Manual, ...] = get_args(Manual)  # oldest first
FIRST = MANUALS[0]


def weighs_distance(manual: Manual) -> bool:
    """Return whether shift scale/cross/type sums r W, not W, for the support of a particle by its own type."""
    return MANUALS.index(manual) >= MANUALS.index("2026.7.4")


def manual_of(version: str) -> Manual:
    """Return the manual of a version of LAMMPS: the last one that is not later.

    Parameters
    ----------
    version : str
        As 2025.7.22.4.0, or LAMMPS' own number, as 20250722. What is neither has the first manual.
    """
    own = re.fullmatch(r"(\d{4})(\d\d)(\d\d)", version)
    parts = own.groups() if own else version.split(".")
    if not all(part.isdigit() for part in parts):
        return FIRST
    date = tuple(map(int, parts[:3]))
    return next((manual for manual in reversed(MANUALS) if tuple(map(int, manual.split("."))) <= date), FIRST)
