"""The names of fields in a record: a quantity's, and of input in brackets which input it is."""

from __future__ import annotations

GIVEN = "given"


def given(quantity: str) -> str:
    """Name the input of a scene: ``rho (given)``."""
    return f"{quantity} ({GIVEN})"


def carried(quantity: str, by: str, step: int) -> str:
    """Name the state after a stop, which a route has carried on: ``rho (restart at 2)``."""
    return f"{quantity} ({by} at {step})"


def parted(name: str) -> tuple[str, str]:
    """Return the quantity, and which input it is: `GIVEN`, the route and step of a stop; empty of other fields."""
    quantity, _, which = name.partition(" (")
    return quantity, which.removesuffix(")")
