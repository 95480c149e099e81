"""Equality up to a counted number of roundings."""

from __future__ import annotations

from typing import Any

import pytest

HALF_EPS = 2.0**-53  # the largest relative error of one rounding


def rounded(value: Any, count: int, terms: float = 0.0) -> Any:
    """A value that equals numbers within so many roundings, of it or of larger terms that cancel."""
    return pytest.approx(value, rel=count * HALF_EPS, abs=count * HALF_EPS * terms)
