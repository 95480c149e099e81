"""Kinds of twins, each with a value."""

from __future__ import annotations

from typing import Any

PLAIN: dict[str, Any] = {
    "translate": [2.3, -3.1],
    "boost": [0.8, -0.45],
    "relabel": True,
    "rescale": 4.0,
    "units": "micro",
    "newton": False,
    "split": True,
}
KINDS: dict[str, Any] = PLAIN | {"skin": 0.7, "rebuild": {"every": 1, "check": False}, "ranks": 2, "tilt": [1]}
