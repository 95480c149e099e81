"""Comparison of two reports: records and arrays, bit for bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

MADE = ("seconds", "date", "command", "shard", "divided", "predictions")


def results(report: Path) -> dict[str, Any]:
    """Return a run's record without its origin: date, command, and which predictions were cached."""
    document: dict[str, Any] = json.loads((report / "run.json").read_text())
    for key in MADE:
        document.pop(key)
    for case in document["cases"]:
        del case["seconds"], case["predictions"]
    return document


def assert_same(one: Path, other: Path) -> None:
    """Fail unless two reports hold the same results and the same arrays."""
    assert results(one) == results(other)
    names = {path.name for path in (one / "fields").iterdir()}
    assert names == {path.name for path in (other / "fields").iterdir()}
    for name in names:
        assert (one / "fields" / name).read_bytes() == (other / "fields" / name).read_bytes(), name
