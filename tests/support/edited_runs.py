"""Edits of the record of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

NAMES = ("defaults.linear", "images.quintic.two", "near-rho0.linear.2d", "refused.type-zero")
Edit = Callable[[dict[str, Any]], None]


def of_field(name: str, **changes: Any) -> Edit:
    """An edit of one field of a case, at all of its steps."""

    def edit(record: dict[str, Any]) -> None:
        field = next(field for field in record["fields"] if field["field"] == name)
        field.update(changes)
        for step in field["steps"]:
            step.update({key: changes[key] for key in ("digest", "verdict") if key in changes})

    return edit
