"""Tests of the workshop run by `make workshop` alone."""

from __future__ import annotations

from pathlib import Path

import pytest

OTHERS = {"kills", "slurm", "soak"}  # with a make target of their own


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents and not OTHERS & {mark.name for mark in item.iter_markers()}:
            item.add_marker("workshop")
