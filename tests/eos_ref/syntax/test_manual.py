"""Versions of the manual, and the differences between them."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from eos_ref import parse_fix_rheo
from eos_ref.syntax.manual import FIRST, MANUALS, Manual, manual_of, weighs_distance
from tests.support.particle_scenes import bounded, recipe

LINE = "fix 1 all rheo 3.0 RK1 10 shift exclude/type 2*4 scale/cross/type 0.05 0.02 0.5"


@pytest.mark.parametrize(
    ("version", "manual"),
    [
        ("2025.7.22.4.0", "2025.7.22"),
        ("2026.7.3", "2025.7.22"),
        ("2026.7.4", "2026.7.4"),
        ("20260704", "2026.7.4"),
        ("20250722", "2025.7.22"),
        ("20260930", "2026.7.4"),
        ("2024.8.29", "2025.7.22"),
        ("", FIRST),
        ("fork", FIRST),
    ],
)
def test_manual_of_a_version(version: str, manual: Manual) -> None:
    assert manual_of(version) == manual


def test_meaning_of_a_line_depends_on_the_manual() -> None:
    assert get_args(Manual) == MANUALS
    for manual in MANUALS:
        shift = parse_fix_rheo(LINE, 4, manual).shift
        assert shift is not None and shift.scale_cross_type == (0.05, 0.02, 0.5)
        assert shift.weighs_distance == weighs_distance(manual) == (manual != "2025.7.22")


@pytest.mark.parametrize("dimension", [2, 3])
def test_two_sums_shift_different_particles(dimension: int) -> None:
    """Both are compared with the double loop wherever all recipes are; here, a recipe distinguishes them."""
    shifts = [bounded(recipe(name, dimension))["shift/v"][0] for name in ("cross", "cross, by distance")]
    still = [np.all(shift_nc == 0, axis=1) for shift_nc in shifts]
    assert still[0].any() and still[1].any() and np.any(still[0] != still[1])
