"""Positions and values of the particles of a scene: what each model refuses, and the choice of kinds of positions."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from lammps_cases.scene.particles import (
    FromData,
    FromDump,
    FromXYZ,
    Lattice,
    Listed,
    Offset,
    Positions,
    Values,
    Velocity,
    check_tilt,
)

SQ: dict[str, Any] = {"lattice": "sq", "spacing": 1.0, "cells": [2, 2]}
LISTED: dict[str, Any] = {"x": [[0.0, 0.0], [0.5, 0.5]], "low": [0.0, 0.0], "high": [1.0, 1.0]}
BAD: list[tuple[type, dict[str, Any], str]] = [
    (Lattice, SQ | {"cells": [2, 2, 2]}, "cells needs 2 numbers for sq, a lattice in 2D, found 3"),
    (Lattice, SQ | {"lattice": "fcc"}, "cells needs 3 numbers for fcc, a lattice in 3D, found 2"),
    (Lattice, SQ | {"cells": [2, 0]}, r"cells must be at least 1 .*found \[2, 0\]"),
    (Lattice, SQ | {"periodic": [True]}, "periodic needs 2 flags"),
    (Lattice, SQ | {"disorder": 0.5}, "less than 0.5"),
    (Lattice, SQ | {"regions": [{"type": 1, "low": [0, 0, 0], "high": [1, 1, 1]}]}, "a region need 2 numbers for sq"),
    (Lattice, SQ | {"regions": [{"type": 1, "low": [0, 0.5], "high": [1, 0.5]}]}, "a region needs low < high"),
    (Lattice, SQ | {"tilt": [0.1], "periodic": [True, False]}, "0 but between periodic axes"),
    (Listed, LISTED | {"high": [1.0, 1.0, 1.0]}, "x, low and high need the same number of components, 2"),
    (Listed, LISTED | {"high": [1.0, 0.0]}, "the box needs low < high"),
    (Listed, LISTED | {"types": [1]}, r"types needs one value per particle \(2\), found 1"),
    (Listed, LISTED | {"periodic": [True] * 3}, "periodic needs 2 flags, found 3"),
    (Listed, LISTED | {"tilt": [0.1, 0.0, 0.0]}, "tilt needs 1 numbers in 2D, found 3"),
    (Offset, {"low": 2.0, "high": 1.0}, "low must not exceed high"),
    (Values, {}, "needs exactly one of .*found none"),
    (Values, {"constant": 1.0, "range": [1.0, 2.0]}, "found constant, range"),
    (Values, {"range": [-1.0, 2.0], "spacing": "log"}, "two ends of one sign, not 0"),
    (Values, {"ratio": [0.0, 2.0], "spacing": "log"}, "two ends of one sign, not 0"),
    (Velocity, {"values": [[0.0, 0.0]], "random": 1.0}, "values goes with neither random nor uniform"),
]


@pytest.mark.parametrize(("model", "content", "rule"), BAD)
def test_malformed_particles_are_refused(model: Any, content: dict[str, Any], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        model.model_validate(content)


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (SQ, Lattice),
        (LISTED, Listed),
        ({"extxyz": "a.xyz"}, FromXYZ),
        ({"data": "a.data"}, FromData),
        ({"dump": "a.dump", "step": 5}, FromDump),
    ],
)
def test_one_key_determines_the_kind_of_positions(content: dict[str, Any], kind: type) -> None:
    adapter = TypeAdapter(Positions)
    positions = adapter.validate_python(content)
    assert type(positions) is kind and adapter.validate_python(positions) == positions
    with pytest.raises(ValidationError) as refused:
        adapter.validate_python(content | {"odd": 1})
    assert [each["type"] for each in refused.value.errors()] == ["extra_forbidden"], "a mistake of one kind alone"


def test_only_periodic_axes_may_be_tilted() -> None:
    check_tilt(None, (False, False), 2)
    check_tilt((0.0, 0.2, 0.0), (True, False, True), 3)
    check_tilt((0.1, 0.0, 0.0), None, 3)  # periodic by default
    with pytest.raises(ValueError, match="tilt must be 0"):
        check_tilt((0.0, 0.0, 0.2), (True, False, True), 3)


def test_logarithmic_spacing_needs_ends_of_equal_sign() -> None:
    assert Values(range=(-1.0, -2.0), spacing="log").range == (-1.0, -2.0)
