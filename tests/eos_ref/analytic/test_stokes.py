"""Slow flow through arrays of obstacles: the drag of the sources' series, and a field that solves the problem."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.analytic import stokes


@pytest.mark.parametrize("a", [0.02, 0.05, 1 / 12])
def test_drag_of_dilute_cylinders_is_that_of_the_series(a: float) -> None:
    phi = np.pi * a**2
    series = 4 * np.pi / (-0.5 * np.log(phi) - 0.738 + phi - 0.887 * phi**2 + 2.038 * phi**3)
    assert stokes.cylinders(a).drag == pytest.approx(series, rel=2e-4)  # its constant has three digits


@pytest.mark.parametrize("a", [0.02, 1 / 12, 0.2, 0.3])
def test_speed_between_cylinders_carries_the_flux_and_vanishes_on_them(a: float) -> None:
    flow = stokes.cylinders(a)
    x, weight = np.polynomial.legendre.leggauss(60)
    y = a + (0.5 - a) * (x + 1) / 2
    assert (0.5 - a) * (weight @ flow.speed(y)) == pytest.approx(1.0, abs=2e-5)
    near = flow.speed(np.array([0.0, a, a * (1 + 1e-6)]))
    assert near == pytest.approx(0.0, abs=1e-4)
    assert flow.speed(-y) == pytest.approx(flow.speed(y))


def test_number_of_modes_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    at_once = stokes.cylinders(1 / 12).drag
    monkeypatch.setattr(stokes, "MODES", stokes.MODES - 3)
    assert stokes.cylinders(1 / 12).drag == pytest.approx(at_once, rel=1e-6)


def test_drag_of_a_single_sphere_is_that_of_stokes() -> None:
    assert stokes.drag_of_sphere(1e-12) == pytest.approx(1 + 1.7601e-4, rel=1e-7)
    # Sangani & Acrivos (1982) tabulate 2.842 for a radius of a quarter of the cell.
    assert stokes.drag_of_sphere(4 / 3 * np.pi / 64) == pytest.approx(2.842, abs=5e-4)


@pytest.mark.parametrize("wrong", [0.0, 0.35, np.nan])
def test_radius_and_fraction_must_lie_in_their_range(wrong: float) -> None:
    with pytest.raises(InputError, match="must lie above 0"):
        stokes.cylinders(wrong)
    with pytest.raises(InputError, match="must lie above 0"):
        stokes.drag_of_sphere(wrong)
